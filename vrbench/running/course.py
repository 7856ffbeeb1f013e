"""The course of a take: runs of the motion, rests between them, and what hands do meanwhile."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, nullcontext
from typing import Any, Protocol, Self

from vrbench.config.case import Case
from vrbench.devices.ports import HostClock, Occlusion, Plan, Robot
from vrbench.streams import Columns, Event
from vrbench.trajectory import NS

LOOK_S = 0.1


class Diary:
    """What happens in a take, as a source of events."""

    def __init__(self, host: HostClock) -> None:
        self._host = host
        self._first: list[tuple[str, dict[str, Any]]] = []
        self._new: list[Event] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def start(self, take: str) -> None:  # noqa: ARG002
        """What was noted before belongs to the beginning."""
        self._new = [Event(self._host.now(), kind, detail) for kind, detail in self._first]

    def read(self) -> Columns:
        new, self._new = self._new, []
        return Columns({}, events=new)

    def stop(self) -> None:
        pass

    def before(self, kind: str, **detail: Any) -> None:
        """Notes how it is when the take starts."""
        self._first.append((kind, detail))

    def note(self, kind: str, **detail: Any) -> None:
        """Notes what happens now."""
        self._new.append(Event(self._host.now(), kind, detail))

    @contextmanager
    def stretch(self, kind: str, **detail: Any) -> Iterator[None]:
        """Notes where a stretch of the take starts, and where it ends."""
        self.note(kind, **detail, at="start")
        yield
        self.note(kind, **detail, at="end")


class Hands(Protocol):
    """Who covers cameras and recentres within a take; while they do, no plan may be run."""

    def cover(self, occlusion: Occlusion) -> None: ...

    def recentre(self) -> None: ...


class Course:
    """What a robot does in one take of a case.

    Args:
        case: how its motion is run.
        plan: the motion's,
        opening: and that of the motion which a looped case opens with.
        robot: that carries them out.
        host: the recorder's clock.
        hands: what is done by hand.
        occlusion: what a level covers on this headset, of the case and of each of its events.
        diary: where all of it is noted.
    """

    def __init__(
        self,
        case: Case,
        plan: Plan,
        opening: Plan | None,
        *,
        robot: Robot,
        host: HostClock,
        hands: Hands,
        occlusion: Callable[[str], Occlusion],
        diary: Diary,
    ) -> None:
        self._case, self._plan, self._opening = case, plan, opening
        self._robot, self._host, self._hands = robot, host, hands
        self._occlusion, self._diary = occlusion, diary
        self._gap_ns = 0
        self._recentres = sorted(cue.at for cue in case.events if cue.at is not None)

    def run(self) -> Generator[float]:
        """Carries it all out; yields the part done, 0..1. Closed early, it stops the robot."""
        case, diary, host = self._case, self._diary, self._host
        if self._opening is not None:
            with diary.stretch("opening"):
                for _ in self._robot.execute(self._opening):
                    yield 0.0
            yield from self._back(0.0)
        begin, longest, runs = host.now(), 0, 0
        yield from self._by_hand(0, 0.0)
        while True:
            if runs:
                yield from self._back(self._done(runs, host.now() - begin))
            since = host.now()
            runs += 1
            with diary.stretch("loop", number=runs) if case.looped else nullcontext():
                for part in self._robot.execute(self._plan):
                    self._recentre(host.now() - begin)
                    yield self._done(runs - 1 + part, host.now() - begin)
            yield from self._by_hand(runs, self._done(runs, host.now() - begin))
            if case.hold:
                with diary.stretch("hold"):
                    yield from self._rest(case.hold, self._done(runs, host.now() - begin))
            longest = max(longest, host.now() - since)
            if case.duration is None and runs >= case.loops:
                return
            another = host.now() - begin + self._gap_ns + longest
            if case.duration is not None and another > case.duration * NS:
                return

    def _done(self, runs: float, elapsed_ns: int) -> float:
        if self._case.duration is None:
            return runs / self._case.loops
        return min(1.0, elapsed_ns / NS / self._case.duration)

    def _back(self, done: float) -> Generator[float]:
        """Back to where the motion begins: a gap in what is scored."""
        since = self._host.now()
        with self._diary.stretch("gap"):
            for _ in self._robot.prepare(self._plan):
                yield done
        self._gap_ns = max(self._gap_ns, self._host.now() - since)

    def _rest(self, seconds: float, done: float) -> Generator[float]:
        """The robot stands still; sources are read meanwhile."""
        while seconds > 0.0:
            step = min(seconds, 1.0)
            self._host.wait(step)
            seconds -= step
            yield done

    def _recentre(self, elapsed_ns: int) -> None:
        while self._recentres and elapsed_ns >= self._recentres[0] * NS:
            self._recentres.pop(0)
            self._hands.recentre()
            self._diary.note("cue", do="recentre")

    def _by_hand(self, runs: int, done: float) -> Generator[float]:
        """What is to be done when so many runs are over; the robot rests."""
        for cue in self._case.events:
            if cue.after != runs:
                continue
            if cue.do == "recentre":
                yield from self._awaited(self._hands.recentre, done)
                self._diary.note("cue", do="recentre")
                continue
            level = self._case.occlude if cue.level is None else cue.level
            occlusion = self._occlusion(level)
            yield from self._awaited(lambda: self._hands.cover(occlusion), done)  # noqa: B023
            self._diary.note("occlusion", **told(occlusion))

    def _awaited(self, act: Callable[[], None], done: float) -> Generator[float]:
        """A person takes their time: meanwhile sources are read on."""
        trouble: list[BaseException] = []

        def attempt() -> None:
            try:
                act()
            except BaseException as error:
                trouble.append(error)

        thread = threading.Thread(target=attempt, daemon=True)
        thread.start()
        thread.join(LOOK_S)
        while thread.is_alive():
            yield done
            thread.join(LOOK_S)
        if trouble:
            raise trouble[0]


def told(occlusion: Occlusion) -> dict[str, Any]:
    """An occlusion as events tell it, in JSON's types."""
    return {"level": occlusion.level, "cameras": sorted(occlusion.cameras)}
