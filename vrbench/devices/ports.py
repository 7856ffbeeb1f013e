"""What a headset, a motion-capture source and a robot must offer to be benchmarked."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

from vrbench.clocks import Exchanges
from vrbench.devices.permit import Permit
from vrbench.geometry import Transform
from vrbench.streams import Columns
from vrbench.trajectory import Trajectory


class HostClock(Protocol):
    """The recorder's clock: real, or virtual where every device is simulated."""

    def now(self) -> int:
        """Time [ns] since 1970, never stepping back."""
        ...

    def wait(self, seconds: float) -> None:
        """Lets time pass."""
        ...

    def reading(self) -> Exchanges | None:
        """The clock and UTC at one moment, an exchange whose remote times are UTC.

        None where time is virtual.
        """
        ...


@dataclass(frozen=True, slots=True)
class Session:
    """What a device is opened with, besides its own options.

    Attributes:
        host: the recorder's clock.
        mounting: nominal `T_tcp_eye` of the rig.
        seed: of everything random in the run.
        stage: shared by the simulated devices of one rig; real devices pass it by.
        permit: which plans a person has allowed; a real robot carries out no others.
    """

    host: HostClock
    mounting: Transform
    seed: int
    stage: Any = None
    permit: Permit = field(default_factory=Permit)


@dataclass(frozen=True, slots=True)
class Occlusion:
    """Which cameras of a headset are covered.

    Attributes:
        level: what suites call it.
        cameras: those covered, name by id.
        share: of all cameras, 0..1.
    """

    level: str = "none"
    cameras: Mapping[int, str] = field(default_factory=dict)
    share: float = 0.0


class Operator(Protocol):
    """Who does by hand what no device does: a person at the terminal, or a simulated one.

    Each method returns when it is done; a robot rests meanwhile, but for `recentre`.
    """

    def remount(self, mount: int) -> None:
        """Takes the headset off and fixes it again, the mount-th time."""
        ...

    def cover(self, occlusion: Occlusion) -> None:
        """Covers these cameras, and uncovers all others."""
        ...

    def recentre(self) -> None:
        """Gives the headset's world a new origin, by the controller: the robot may be moving."""
        ...


class PoseSource(Protocol):
    """A device that sends poses. Entered, it is connected; left, it is released.

    It may have `facts() -> Mapping[str, str]` besides: see `facts_of`.
    """

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...

    def start(self, take: str) -> None:
        """Begins to send, for the take of this name."""
        ...

    def read(self) -> Columns:
        """What has arrived since the last call; returns at once."""
        ...

    def stop(self) -> None:
        """Ends what `start` began; what is on its way can still be read."""
        ...


def facts_of(source: PoseSource) -> dict[str, str]:
    """What a headset says of itself and its logger once a take has begun; nothing where it can't.

    Names are `firmware`, `logger_version`, `prediction`: how far ahead poses are, and by whom; and
    `world`: names the numbering of epochs, so that takes of the same `world` and epoch have one
    world frame. Without it, nobody takes two takes to share one.
    """
    tell: Callable[[], Mapping[str, str]] | None = getattr(source, "facts", None)
    return {} if tell is None else dict(tell())


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A motion made executable by one robot in one rig.

    Attributes:
        target: the planned `T_base_tcp`, stamps from 0.
        hash: of all that determines what the robot will do.
        fraction: how much of the motion can be done, 0..1.
        stretch: duration over the motion's own.
    """

    target: Trajectory
    hash: str
    fraction: float = 1.0
    stretch: float = 1.0


class MotionPlanner(Protocol):
    """Plans motions for a robot without connecting to it; planning the same gives the same hash."""

    def plan(self, motion: Trajectory, progress: Callable[[str, float], None]) -> Plan:
        """A plan that moves the mounted eye as `motion`, `T_eye0_eye` with stamps from 0.

        Args:
            motion: to be replayed.
            progress: told what is being done, and the part done, 0..1.

        Raises:
            DeviceError: the robot can't do it; says where, why, and what would do.
        """
        ...

    def describe(self, plan: Plan) -> Sequence[tuple[str, str]]:
        """Limits, margins and warnings for people: name and value."""
        ...

    def write(self, plan: Plan, path: Path) -> Sequence[Path]:
        """Writes the plan file, and its picture beside it; returns all files written."""
        ...


class Robot(PoseSource, Protocol):
    """A robot that can plan a head motion and carry it out while its own poses are read."""

    def plan(self, motion: Trajectory) -> Plan:
        """A plan that moves the mounted eye as `motion`, `T_eye0_eye` with stamps from 0."""
        ...

    def prepare(self, plan: Plan) -> Generator[float]:
        """Goes to where the plan starts, before a take begins; yields the part done, 0..1.

        Closed before its end, it stops the robot before it returns.
        """
        ...

    def execute(self, plan: Plan) -> Generator[float]:
        """Carries the plan out; yields the part done, 0..1, many times a second.

        Closed before its end, it stops the robot before it returns.
        """
        ...


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that `vrbench rig check` found about a device.

    Attributes:
        ok: whether it is as it should be.
        what: what was found, in a sentence.
        fix: what to do, where it isn't.
    """

    ok: bool
    what: str
    fix: str = ""
