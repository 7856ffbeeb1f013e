"""Nothing real moves but by a person's word, typed at a terminal."""

import io
import os
import sys

import pytest

from vrbench.devices.permit import SHOWN, Permit, confirm, confirmation, require, run_hash
from vrbench.errors import ConfigError

PLANS = ["b" * 64, "a" * 64]


@pytest.fixture
def terminal():
    """A pseudo-terminal: what is written to the first is typed at the second."""
    pty = pytest.importorskip("pty", reason="no pseudo-terminals here")
    keys, screen = pty.openpty()
    with os.fdopen(keys, "w", encoding="utf-8") as typed, os.fdopen(screen) as read:
        yield typed, read


def typed_at(terminal, text):
    typed, read = terminal
    typed.write(text + "\n")
    typed.flush()
    return read


def test_one_hash_names_all_plans_in_any_order_and_number():
    assert run_hash(PLANS) == run_hash(reversed(PLANS)) == run_hash([*PLANS, PLANS[0]])
    assert run_hash(PLANS) != run_hash(PLANS[:1])


def test_without_a_hash_it_is_a_dry_run_that_says_which_hash_would_do():
    with pytest.raises(ConfigError, match=f"dry run.*--execute {run_hash(PLANS)[:SHOWN]}"):
        require(None, PLANS)


def test_a_hash_of_other_plans_or_too_short_a_one_is_refused():
    wanted = run_hash(PLANS)
    assert require(wanted[:SHOWN], PLANS) == require(wanted, PLANS) == wanted
    for given in (run_hash(PLANS[:1]), wanted[: SHOWN - 1], ""):
        with pytest.raises(ConfigError, match="is not the hash of this run's plans"):
            require(given, PLANS)


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
def test_the_typed_hash_grants_these_plans_and_no_others(terminal):
    permit, sink = Permit(), io.StringIO()
    source = typed_at(terminal, run_hash(PLANS)[:SHOWN])
    confirm("ur5e at 10.0.0.1", PLANS, permit, source=source, sink=sink)
    assert all(permit.allows(plan) for plan in PLANS)
    assert not permit.allows("c" * 64)
    assert sink.getvalue() == confirmation("ur5e at 10.0.0.1", run_hash(PLANS), 2)
    permit.revoke()
    assert not any(permit.allows(plan) for plan in PLANS)


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
@pytest.mark.parametrize("text", ["", "y", "yes", "Y", run_hash(PLANS)[: SHOWN - 1]])
def test_anything_else_typed_grants_nothing_and_takes_back_what_was_granted(terminal, text):
    permit = Permit()
    permit.grant(PLANS)
    with pytest.raises(ConfigError, match="not confirmed"):
        confirm("ur5e", PLANS, permit, source=typed_at(terminal, text), sink=io.StringIO())
    assert not permit.allows(PLANS[0])


def test_a_pipe_is_no_person():
    permit = Permit()
    source = io.StringIO(run_hash(PLANS)[:SHOWN] + "\n")
    with pytest.raises(ConfigError, match="no terminal to ask at"):
        confirm("ur5e", PLANS, permit, source=source, sink=io.StringIO())
    assert not permit.allows(PLANS[0])
