"""What moves the headset while a take is recorded: a robot here, a person in `vrbench.capture`."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Protocol

from vrbench.config.rig import Rig
from vrbench.config.suite import Step, Suite
from vrbench.devices.ports import Operator, Plan, Robot, Session
from vrbench.errors import ConfigError
from vrbench.motion.generators import generate
from vrbench.motion.motion import at_speed
from vrbench.permission import Permission


@dataclass(frozen=True, slots=True)
class Movement:
    """What moves the headset in one take, about to begin.

    Attributes:
        motion: the motion's name.
        digest: and its digest.
        steps: moves while it is iterated, and yields the part done, 0..1; closed, it stops.
        plan: that a robot carries out; a person has none.
    """

    motion: str
    digest: str
    steps: Generator[float]
    plan: Plan | None = None


class Mover(Protocol):
    """Moves the headset through a suite."""

    def begin(self) -> None:
        """Before the first take: leave to move is asked for here."""
        ...

    def ready(self, step: Step) -> Movement:
        """Gets ready for a step: what a take of it will record."""
        ...


class RobotMover:
    """Carries motions out by a robot; an operator fixes the headset anew between mounts.

    Args:
        suite: whose motions.
        robot: connected.
        session: that it was opened with.
        operator: does by hand what must be done.
        permission: to move a real robot; asked for at the start and after every prompt.
    """

    def __init__(
        self,
        suite: Suite,
        robot: Robot,
        session: Session,
        operator: Operator,
        permission: Permission | None,
    ) -> None:
        self._motions = {name: generate(motion) for name, motion in suite.motions.items()}
        self._robot, self._session = robot, session
        self._operator, self._permission = operator, permission
        self._mount = 1

    def begin(self) -> None:
        """Asks for leave to move."""
        if self._permission is not None:
            self._permission.again(self._session.permit)

    def ready(self, step: Step) -> Movement:
        """Has the headset fixed anew where the step wants that, and goes to where it starts."""
        if step.mount != self._mount:
            self._mount = step.mount
            self._session.permit.revoke()
            self._operator.remount(step.mount)
            self.begin()
        motion = self._motions[step.case.motion]
        plan = self._robot.plan(at_speed(motion, step.case.speed))
        for _ in self._robot.prepare(plan):
            pass
        return Movement(motion.name, motion.digest, self._robot.execute(plan), plan)


def robots_references(suite: Suite, rig: Rig, rig_name: str) -> list[str]:
    """The references of a suite that a robot moves which the rig has.

    Raises:
        ConfigError: the rig has none of them, or no robot.
    """
    if suite.mover != "robot":
        raise ConfigError(
            f"suite {suite.label} is moved by: {suite.mover}",
            field="mover",
            fix="this vrbench records suites that a robot or a person moves; "
            "import the others' recordings",
        )
    if rig.robot is None:
        raise ConfigError(
            f"suite {suite.label} is moved by a robot, the rig has none",
            file=rig_name,
            field="robot",
        )
    references = [name for name in suite.references if getattr(rig, name) is not None]
    if not references:
        raise ConfigError(
            f"suite {suite.label} is scored against {' or '.join(suite.references)}, "
            "the rig has neither",
            file=rig_name,
            field="mocap",
        )
    return list(references)
