"""Who allows a real robot to move: a person, who names the plans and types that they may be run.

Nothing moves without both. `--execute HASH` names all plans of a run by one hash, which exists
before anything moves; `confirm` then asks at the terminal. `--yes` does not answer it, nor does a
pipe. Whatever lets people near the robot, such as an operator's prompt, revokes the permit, and it
is asked for again.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable
from typing import TextIO

from vrbench.errors import ConfigError

SHOWN = 12
"""Characters of a hash that people are shown, type, and give to `--execute`."""


class Permit:
    """The plans that may be carried out now."""

    def __init__(self) -> None:
        self._plans: frozenset[str] = frozenset()

    def grant(self, plans: Iterable[str]) -> None:
        """Allows the plans of these hashes, and no others."""
        self._plans = frozenset(plans)

    def revoke(self) -> None:
        """Allows nothing."""
        self._plans = frozenset()

    def allows(self, plan: str) -> bool:
        """Whether the plan of this hash may be carried out."""
        return plan in self._plans


def run_hash(plans: Iterable[str]) -> str:
    """One hash over the hashes of all plans of a run, whatever their order or number."""
    return hashlib.sha256("\n".join(sorted(set(plans))).encode()).hexdigest()


def require(given: str | None, plans: Iterable[str]) -> str:
    """The run's hash, if `given` names it; at least its first 12 characters.

    Raises:
        ConfigError: none is given, which makes this a dry run, or it is of other plans.
    """
    wanted = run_hash(plans)
    fix = f"nothing has moved; to run these plans: --execute {wanted[:SHOWN]}"
    if given is None:
        raise ConfigError("dry run: the plans are sound", field="--execute", fix=fix)
    if len(given) < SHOWN or not wanted.startswith(given.lower()):
        raise ConfigError(
            f"{given!r} is not the hash of this run's plans", field="--execute", fix=fix
        )
    return wanted


def confirmation(robot: str, wanted: str, plans: int) -> str:
    """What a person is asked before a robot moves."""
    what = "1 plan" if plans == 1 else f"{plans} plans"
    return (
        f"{robot} is about to move ({what}). Is the cell empty, the emergency stop in reach?\n"
        f"This software is not safety-rated. Type {wanted[:SHOWN]} to let it move: "
    )


def confirm(
    robot: str,
    plans: Iterable[str],
    permit: Permit,
    *,
    source: TextIO | None = None,
    sink: TextIO | None = None,
) -> None:
    """Asks a person at the terminal, and grants the plans where they type the run's hash.

    Args:
        robot: what moves, and where: `ur5e at 192.168.1.20`.
        plans: hashes of all plans of the run.
        permit: of the session; revoked first.
        source: the terminal that is read; standard input.
        sink: where the question goes; standard error.

    Raises:
        ConfigError: there is no terminal, or something else was typed.
    """
    permit.revoke()
    source, sink = source or sys.stdin, sink or sys.stderr
    plans = sorted(set(plans))
    wanted = run_hash(plans)
    if not source.isatty():
        raise ConfigError(
            "a person must allow the robot to move, and there is no terminal to ask at",
            fix="run vrbench at a terminal; --yes and pipes don't answer this",
        )
    sink.write(confirmation(robot, wanted, len(plans)))
    sink.flush()
    if source.readline().strip() != wanted[:SHOWN]:
        raise ConfigError("not confirmed", fix="nothing has moved")
    permit.grant(plans)
