"""Cases and conditions of a suite: the closed set of knobs that say how a motion is run."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StringConstraints, model_validator

from vrbench.config.quantity import Duration
from vrbench.config.strict import Strict

Name = Annotated[str, StringConstraints(pattern=r"^[a-z0-9][a-z0-9_-]*$")]
Need = Literal["x", "clock", "y"]
# What of a take lies between runs of its motion.
Stretch = Literal["opening", "gap", "hold"]
Repeats = Annotated[int, Field(ge=1, le=1000)]
Remounts = Annotated[int, Field(ge=0, le=100)]
Speed = Annotated[float, Field(ge=0.05, le=10.0)]
Loops = Annotated[int, Field(ge=1, le=10000)]
Positive = Annotated[Duration, Field(gt=0.0)]
Hold = Annotated[Duration, Field(ge=0.0)]

UNCOVERED, ALL = "none", "all"
"""Occlusion levels that every headset has; the others are its profile's."""
OPENING = "opening"
"""The motion that looped cases begin with."""


class Cue(Strict):
    """Something done to the headset within a take, by hand.

    Attributes:
        do: `occlude` covers the cameras of a level, `uncover` goes back to what the condition has
            covered, `recentre` gives the headset a new origin.
        after: how many runs of the motion are over by then; the robot rests.
        at: or how long after the first run began [s]; the robot moves.
        level: what `occlude` covers.
    """

    do: Literal["occlude", "uncover", "recentre"]
    after: Annotated[int, Field(ge=0, le=10000)] | None = None
    at: Annotated[Duration, Field(ge=0.0)] | None = None
    level: Name | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Cue:
        if (self.after is None) == (self.at is None):
            raise ValueError("an event has one time: give after (runs of the motion) or at (10 s)")
        if (self.level is None) == (self.do == "occlude"):
            raise ValueError(
                "an event that occludes, and no other, has a level: "
                "write {after: 1, do: occlude, level: all}"
            )
        if self.at is not None and self.do != "recentre":
            raise ValueError(
                f"{self.do} takes a hand at the headset, so the robot must rest: "
                "give after (runs of the motion), not at"
            )
        return self


class Case(Strict):
    """One motion of a suite, and how it is to be run.

    Attributes:
        id: what the case is called; takes are named after it.
        motion: which of the suite's `motions`.
        role: `calibration` is run first and last in every mount, `check` opens every condition.
        repeats: how often it is run in a mount.
        remounts: how often the headset is taken off and fixed again for it: 1 is two mounts.
        speed: of the motion, 1 as it was made.
        loops: runs of the motion in one take.
        duration: how long a take is looped, in place of `loops`: 2 h.
        hold: how long the head rests after each run of the motion: 60 s.
        occlude: which level of cameras is covered; the headset's profile says which they are.
        events: what happens in a take, and when.
        needs: what it can't be scored without: x, clock, y.
        anchor: the first seconds, from which Y is taken and which aren't scored: 10 s.
        exclude: stretches of a take that aren't scored.
    """

    id: Name
    motion: Name
    role: Literal["calibration", "check", "scored"] = "scored"
    repeats: Repeats = 1
    remounts: Remounts = 0
    speed: Speed = 1.0
    loops: Loops = 1
    duration: Positive | None = None
    hold: Hold = 0.0
    occlude: Name = UNCOVERED
    events: tuple[Cue, ...] = ()
    needs: tuple[Need, ...] = ()
    anchor: Positive | None = None
    exclude: tuple[Stretch, ...] = ()

    @property
    def looped(self) -> bool:
        """Whether its takes hold the motion more than once."""
        return self.loops > 1 or self.duration is not None


class Condition(Strict):
    """A variation of all scored cases: the knobs it sets replace theirs.

    Attributes:
        id: what the condition is called.
        baseline: whether the others are compared with it.
    """

    id: Name
    baseline: bool = False
    repeats: Repeats | None = None
    remounts: Remounts | None = None
    speed: Speed | None = None
    loops: Loops | None = None
    duration: Positive | None = None
    hold: Hold | None = None
    occlude: Name | None = None
    events: tuple[Cue, ...] | None = None
    needs: tuple[Need, ...] | None = None
    anchor: Positive | None = None
    exclude: tuple[Stretch, ...] | None = None

    def of(self, case: Case) -> Case:
        """The case under this condition."""
        names = (name for name in Condition.model_fields if name not in ("id", "baseline"))
        own = {name: getattr(self, name) for name in names}
        return case.model_copy(update={k: v for k, v in own.items() if v is not None})


def check_case(case: Case, mover: str) -> None:
    """Whether a case's knobs go together.

    Raises:
        ValueError: they don't: which, and what to do.
    """
    name = f"case {case.id}"
    if case.role != "scored":
        moving = case.looped or case.hold or case.events or case.exclude
        if case.repeats > 1:
            raise ValueError(
                f"{name} is a calibration, run first and last: no repeats"
                if case.role == "calibration"
                else f"{name} is a check, run once where a condition begins: no repeats"
            )
        if moving or case.occlude != UNCOVERED or (case.role == "check" and case.remounts):
            raise ValueError(
                f"{name} is a {case.role}, its motion run once: it takes motion, speed and needs"
            )
    if case.loops > 1 and case.duration is not None:
        raise ValueError(f"{name} has both loops and duration: give one, the other follows")
    lacking = [part for part in case.exclude if not _has(case, part)]
    if lacking:
        raise ValueError(
            f"{name} excludes {lacking[0]}, which its takes don't have: "
            "opening and gap are of cases with loops or duration, hold of those that hold"
        )
    late = [cue for cue in case.events if cue.after is not None and cue.after > case.loops]
    if late and case.duration is None:
        raise ValueError(
            f"{name} has an event after run {late[0].after} of its motion, which is run "
            f"{case.loops} times: give loops: {late[0].after}"
        )
    if mover != "robot" and (case.looped or case.hold or case.events or case.speed != 1.0):
        raise ValueError(
            f"{name} sets how a robot moves, and the mover is a {mover}: "
            "speed, loops, duration, hold and events are a robot's"
        )


def _has(case: Case, part: Stretch) -> bool:
    return case.hold > 0.0 if part == "hold" else case.looped
