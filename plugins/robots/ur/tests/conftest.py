"""An emulator a test, and a session that nothing may move in."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest
from vrbench_ur.testing import MOUNTING, Emulator

from vrbench.devices.host import RealClock
from vrbench.devices.permit import Permit
from vrbench.devices.ports import Session


@pytest.fixture
def emulators() -> Iterator[Callable[..., Emulator]]:
    """Starts emulators, with arguments; they end with the test."""
    with ExitStack() as stack:
        yield lambda *arguments: stack.enter_context(Emulator(*arguments))


@pytest.fixture
def emulator(emulators: Callable[..., Emulator]) -> Emulator:
    return emulators()


@pytest.fixture
def session() -> Session:
    return Session(RealClock(), MOUNTING, seed=1, permit=Permit())
