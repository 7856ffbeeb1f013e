"""What moves the headset while a take is recorded: a robot here, a person in `capture`."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass
from typing import Protocol

from vrbench.config.case import ALL, OPENING, UNCOVERED
from vrbench.config.rig import Rig
from vrbench.config.suite import Case, Step, Suite
from vrbench.devices.ports import Occlusion, Operator, Plan, Robot, Session
from vrbench.devices.specs import HeadsetProfile
from vrbench.errors import ConfigError
from vrbench.motion.motion import at_speed
from vrbench.recording.interrupt import Interrupt
from vrbench.running.course import Course, Diary, told
from vrbench.running.permission import Permission


@dataclass(frozen=True, slots=True)
class Movement:
    """What moves the headset in one take, about to begin.

    Attributes:
        motion: the motion's name.
        digest: and its digest.
        steps: moves while it is iterated, and yields the part done, 0..1; closed, it stops.
        plan: that a robot carries out; a person has none.
        diary: of what happens meanwhile.
    """

    motion: str
    digest: str
    steps: Generator[float]
    plan: Plan | None = None
    diary: Diary | None = None


class Mover(Protocol):
    """Moves the headset through a suite."""

    def begin(self) -> None:
        """Before the first take: leave to move is asked for here."""
        ...

    def ready(self, step: Step) -> Movement:
        """Gets ready for a step: what a take of it will record."""
        ...


class RobotMover:
    """Carries motions out by a robot; an operator fixes the headset anew, and covers its cameras.

    Args:
        suite: whose motions.
        robot: connected.
        session: that it was opened with.
        profile: of the headset.
        operator: does by hand what must be done.
        permission: to move a real robot; asked for at the start and after every prompt.
        mount: that the headset is fixed in now.
        level: of the cameras that are covered now; None where nobody knows.
    """

    def __init__(
        self,
        suite: Suite,
        robot: Robot,
        session: Session,
        profile: HeadsetProfile,
        operator: Operator,
        permission: Permission | None,
        *,
        mount: int = 1,
        level: str | None = UNCOVERED,
    ) -> None:
        self._motions = {name: suite.motion(name) for name in suite.motions}
        self._robot, self._session, self._profile = robot, session, profile
        self._operator, self._permission = operator, permission
        self._mount, self._level = mount, level

    def begin(self) -> None:
        """Asks for leave to move."""
        if self._permission is not None:
            self._permission.again(self._session.permit)

    def ready(self, step: Step) -> Movement:
        """Has done by hand what the step wants, and goes to where it starts.

        Raises:
            ConfigError: the headset has no such occlusion level, or nobody is there.
        """
        case, session = step.case, self._session
        if step.mount != self._mount:
            self._mount = step.mount
            session.permit.revoke()
            self._operator.remount(step.mount)
            self.begin()
        if case.occlude != self._level:
            self.cover(self._occlusion(case.occlude))
        motion = self._motions[case.motion]
        plan = self._robot.plan(at_speed(motion, case.speed))
        opening = None
        self._go_to(plan)
        if case.looped:
            # its own first pass is over by now: a robot may be slow in it, and none is in the take
            opening = self._robot.plan(self._motions[OPENING].trajectory)
            self._go_to(opening)
        diary = Diary(session.host)
        if case.occlude != UNCOVERED:
            diary.before("occlusion", **told(self._occlusion(case.occlude)))
        course = Course(
            *(case, plan, opening),
            robot=self._robot,
            host=session.host,
            hands=self,
            occlusion=self._occlusion,
            diary=diary,
        )
        return Movement(motion.name, motion.digest, course.run(), plan, diary)

    def _go_to(self, plan: Plan) -> None:
        """Goes to where a plan begins; Ctrl-C ends the way there."""
        with Interrupt() as interrupt, closing(self._robot.prepare(plan)) as way:
            for _ in way:
                interrupt.check()

    def cover(self, occlusion: Occlusion) -> None:
        """Has cameras covered: hands are at the headset, so nothing may move before it is allowed.

        Raises:
            ConfigError: nobody is there.
        """
        self._session.permit.revoke()
        self._operator.cover(occlusion)
        self._level = occlusion.level
        self.begin()

    def recentre(self) -> None:
        """Has the headset's world recentred, from outside the robot's reach."""
        self._operator.recentre()

    def _occlusion(self, level: str) -> Occlusion:
        found = self._profile.covered(level)
        if found is None:
            raise ConfigError(lacking_level(level, self._profile), field="occlude")
        return found


def lacking(case: Case, profile: HeadsetProfile) -> str | None:
    """Why a case can't be recorded with this headset: an occlusion level it lacks; or None."""
    levels = [case.occlude, *(cue.level for cue in case.events if cue.level is not None)]
    absent = [level for level in levels if profile.covered(level) is None]
    return lacking_level(absent[0], profile) if absent else None


def lacking_level(level: str, profile: HeadsetProfile) -> str:
    """What to say of an occlusion level that a headset lacks."""
    known = ", ".join(dict.fromkeys((UNCOVERED, *profile.occlusion, ALL)))
    return f"the headset's profile has no occlusion level {level!r}: it has {known}"


def robots_references(suite: Suite, rig: Rig, rig_name: str) -> list[str]:
    """The references of a suite that a robot moves which the rig has.

    Raises:
        ConfigError: the rig has none of them, or no robot.
    """
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
            "the rig has none of that",
            file=rig_name,
            field="mocap",
        )
    return list(references)
