"""The course of a take: what the robot does in which order, and what hands do while it rests."""

from collections.abc import Generator

import numpy as np
import pytest

from vrbench.config.case import Case
from vrbench.devices.ports import Plan
from vrbench.devices.simulated.stage import VirtualClock
from vrbench.devices.specs import HeadsetProfile
from vrbench.geometry import Transform
from vrbench.running.course import Course, Diary
from vrbench.trajectory import NS, Trajectory


class Arm:
    """A robot that tells what it is asked to do, and takes ten seconds for each run."""

    def __init__(self, host: VirtualClock) -> None:
        self.host, self.did, self.moving = host, [], False

    def prepare(self, plan: Plan) -> Generator[float]:
        self.did.append(f"back to {plan.hash}")
        self.host.wait(2.0)
        yield 1.0

    def execute(self, plan: Plan) -> Generator[float]:
        self.did.append(f"run {plan.hash}")
        self.moving = True
        try:
            for part in (0.25, 0.5, 0.75, 1.0):
                self.host.wait(2.5)
                yield part
        finally:
            self.moving = False


class Hands:
    """Hands that note what they do, and would be hurt by a robot that moves."""

    def __init__(self, arm: Arm) -> None:
        self.arm, self.done = arm, arm.did

    def cover(self, occlusion) -> None:
        assert not self.arm.moving
        self.done.append(f"cover {occlusion.level}")

    def recentre(self) -> None:
        self.done.append("recentre")


def plan(name: str) -> Plan:
    still = Transform(np.zeros((2, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (2, 1)))
    return Plan(Trajectory(np.array([0, 10 * NS]), still), name)


class Take:
    """A case carried out."""

    def __init__(self, **knobs) -> None:
        case = Case.model_validate({"id": "c", "motion": "head", **knobs})
        self.host = VirtualClock()
        self.began = self.host.now()
        self.arm = Arm(self.host)
        self.diary = Diary(self.host)
        self.diary.start("c")
        profile = HeadsetProfile(72.0, cameras={0: "left", 1: "right"})
        opening = plan("opening") if case.looped else None
        self.course = Course(
            *(case, plan("head"), opening),
            robot=self.arm,
            host=self.host,
            hands=Hands(self.arm),
            occlusion=profile.covered,
            diary=self.diary,
        )

    def run(self) -> "Take":
        self.parts = list(self.course.run())
        self.events = self.diary.read().events
        return self

    @property
    def told(self) -> list[str]:
        return [f"{e.kind} {e.detail.get('at', '')}".strip() for e in self.events]

    @property
    def seconds(self) -> float:
        return (self.host.now() - self.began) / NS


def test_a_plain_case_is_one_run():
    take = Take().run()
    assert take.arm.did == ["run head"]
    assert take.told == []
    assert take.parts[-1] == 1.0
    assert take.seconds == 10.0


def test_loops_open_with_another_motion_and_have_gaps_between_them():
    take = Take(loops=2).run()
    assert take.arm.did == ["run opening", "back to head", "run head", "back to head", "run head"]
    assert take.told == [
        *("opening start", "opening end", "gap start", "gap end", "loop start", "loop end"),
        *("gap start", "gap end", "loop start", "loop end"),
    ]
    assert [e.detail["number"] for e in take.events if e.kind == "loop"] == [1, 1, 2, 2]
    assert take.parts == sorted(take.parts)


@pytest.mark.parametrize(("seconds", "runs"), [(9, 1), (10, 1), (21.9, 1), (22, 2), (46, 4)])
def test_a_duration_holds_as_many_runs_as_fit(seconds, runs):
    assert Take(duration=seconds).run().arm.did.count("run head") == runs


def test_it_holds_still_after_every_run():
    take = Take(loops=2, hold="5 s").run()
    assert [e.kind for e in take.events if e.kind == "hold"] == ["hold"] * 4
    assert take.seconds == 10.0 + 2.0 + 2 * 15.0 + 2.0


def test_hands_are_at_the_headset_only_between_runs():
    events = [
        {"after": 0, "do": "occlude", "level": "all"},
        {"after": 1, "do": "uncover"},
        {"after": 2, "do": "recentre"},
    ]
    take = Take(loops=2, events=events).run()
    assert take.arm.did == [
        *("run opening", "back to head", "cover all", "run head", "cover none"),
        *("back to head", "run head", "recentre"),
    ]
    covered = [e.detail for e in take.events if e.kind == "occlusion"]
    assert covered == [{"level": "all", "cameras": [0, 1]}, {"level": "none", "cameras": []}]


def test_a_recentre_at_a_time_comes_while_it_moves():
    take = Take(events=[{"at": "5 s", "do": "recentre"}]).run()
    cue = next(e for e in take.events if e.kind == "cue")
    assert (cue.t - take.began) / NS == 5.0
    assert take.arm.did == ["run head", "recentre"]


def test_what_goes_wrong_under_hands_ends_the_take():
    take = Take(events=[{"after": 1, "do": "uncover"}])

    def nobody(_occlusion) -> None:
        raise RuntimeError("nobody is there")

    take.course._hands.cover = nobody
    with pytest.raises(RuntimeError, match="nobody is there"):
        take.run()


def test_closed_early_it_stops_the_robot():
    take = Take(loops=3)
    running = take.course.run()
    next(running)
    assert take.arm.moving
    running.close()
    assert not take.arm.moving
