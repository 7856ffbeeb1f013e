"""What a plugin does is given a limit: one that hangs is told, and where."""

from __future__ import annotations

import sys
import sysconfig
import threading
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from vrbench.plugin.testing.verdicts import NonconformityError

Result = TypeVar("Result")
# Told what is begun, in a word or two: `start`, `read`.
Tell = Callable[[str], None]

OURS = Path(__file__).parents[2]
STANDARD = Path(sysconfig.get_path("stdlib"))
_hanging: list[threading.Thread] = []


def limited(make: Callable[[Tell], Result], patience_s: float) -> Result:
    """What `make(tell)` gives, made in a thread that is waited for so long.

    Args:
        make: is given a function that it tells what it begins.
        patience_s: the limit [s].

    Raises:
        NonconformityError: it takes longer; says what had begun, and in which line it is.
        Exception: what `make` raised.
    """
    begun = ["opening"]
    made: list[Result] = []
    raised: list[BaseException] = []

    def work() -> None:
        try:
            made.append(make(begun.append))
        except BaseException as error:  # a plugin may raise anything
            raised.append(error)

    thread = threading.Thread(target=work, name="vrbench conformance", daemon=True)
    thread.start()
    thread.join(patience_s)
    if not made and not raised:
        _hanging.append(thread)
        raise NonconformityError(
            f"{begun[-1]} hangs{_where(thread)}: it didn't end in {patience_s:g} s",
            "Give every wait a timeout, and raise vrbench.errors.DeviceError(what, fix=what to do) "
            "when it has passed.",
        )
    if raised:
        raise raised[0]
    return made[0]


def hanging() -> bool:
    """Whether something is still going on that was given up."""
    return any(thread.is_alive() for thread in _hanging)


def _where(thread: threading.Thread) -> str:
    """The line that it is in: the plugin's own, or else the innermost."""
    frame = sys._current_frames().get(thread.ident or 0)
    stack = traceback.extract_stack(frame) if frame is not None else []
    own = [at for at in stack if not Path(at.filename).is_relative_to(STANDARD)]
    theirs = [at for at in own if not Path(at.filename).is_relative_to(OURS)]
    at = (theirs or own or list(stack))[-1:]
    return f" at {at[0].filename}:{at[0].lineno}" if at else ""
