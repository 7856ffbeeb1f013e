"""A person moves the headset: what that asks of the rig, and how a simulated person does it."""

from __future__ import annotations

from collections.abc import Generator
from typing import Protocol

from vrbench.config.rig import Rig
from vrbench.config.suite import Step, Suite
from vrbench.devices.ports import Session
from vrbench.devices.simulated.robot import START_EYE
from vrbench.errors import ConfigError
from vrbench.motion.files import given
from vrbench.motion.generators import generate
from vrbench.motion.motion import digest_of_name
from vrbench.running.movers import Movement
from vrbench.trajectory import Trajectory

STEP_S = 1.0


class Person(Protocol):
    """Who wears the headset."""

    def ready(self, step: Step) -> None:
        """Told what comes; returns when they are ready."""
        ...

    def perform(self, step: Step, session: Session) -> Generator[float, None, None]:
        """Moves while it is iterated, many times a second where time is real."""
        ...


class SimulatedPerson:
    """Moves on the stage as generated motions do: all axes to calibrate, else as in a game."""

    def ready(self, step: Step) -> None:
        pass

    def perform(self, step: Step, session: Session) -> Generator[float, None, None]:
        motion = generate(
            "saturate-1" if step.case.role == "calibration" else "shooter-1"
        ).trajectory
        hand = session.mounting.inverse()
        path = motion.mapped(lambda pose: START_EYE @ pose @ hand)
        session.stage.move(Trajectory(path.t + session.host.now(), path.pose))
        done, duration = 0.0, path.duration_s + 1.0
        while done < duration:
            session.host.wait(STEP_S)
            done += STEP_S
            yield min(1.0, done / duration)


class PersonMover:
    """A person moves: a `Mover` whose motion is known by name only."""

    def __init__(self, suite: Suite, person: Person, session: Session) -> None:
        self._suite, self._person, self._session = suite, person, session

    def begin(self) -> None:
        """Nobody has to allow a person to move."""

    def ready(self, step: Step) -> Movement:
        """Tells them what comes, and waits until they are ready."""
        self._person.ready(step)
        motion = self._suite.motions[step.case.motion]
        steps = self._person.perform(step, self._session)
        return Movement(motion, digest_of_name(motion), steps)


def persons_references(
    suite: Suite,
    rig: Rig,
    rig_name: str,
    licence: str | None,
    consent: str | None,
    *,
    simulated: bool,
) -> list[str]:
    """The reference of a suite that a person moves: motion capture.

    Raises:
        ConfigError: the rig has none, or a real person's motion has no licence or consent.
    """
    if rig.mocap is None:
        raise ConfigError(
            f"suite {suite.label} needs motion capture, the rig has none",
            file=rig_name,
            field="mocap",
        )
    if not simulated and not (given(licence) and given(consent)):
        raise ConfigError(
            f"suite {suite.label} records a person's motion: it needs a licence and their consent",
            field="--licence, --consent",
            fix="say what was agreed with the person",
        )
    return ["mocap"]
