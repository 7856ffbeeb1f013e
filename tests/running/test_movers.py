"""What moves the headset: how a robot gets ready for a take."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from vrbench.config.suite import Suite
from vrbench.devices.permit import Permit
from vrbench.devices.ports import Plan, Session
from vrbench.devices.simulated.stage import VirtualClock
from vrbench.devices.specs import HeadsetProfile
from vrbench.geometry import Transform
from vrbench.running.movers import RobotMover
from vrbench.trajectory import NS, Trajectory

FIRST_PASS_S = 100.0


class CarefulArm:
    """A robot that carries a plan out slowly before it does so at speed, as real ones do."""

    def __init__(self, host: VirtualClock) -> None:
        self.host, self.passed = host, set()

    def plan(self, motion: Trajectory) -> Plan:
        return Plan(motion, f"{len(motion)} poses")

    def prepare(self, plan: Plan) -> Generator[float]:
        self.host.wait(2.0)
        yield 0.0
        if plan.hash not in self.passed:
            self.passed.add(plan.hash)
            self.host.wait(FIRST_PASS_S)
        yield 1.0

    def execute(self, plan: Plan) -> Generator[float]:
        self.host.wait(plan.target.duration_s)
        yield 1.0


def test_no_slow_first_pass_falls_into_a_looped_take():
    suite = Suite.model_validate(
        {
            "suite": "looped",
            "version": 1,
            "title": "Loops",
            "motions": {"head": "saturate-30s-1", "opening": "shooter-1"},
            "cases": [{"id": "loop", "motion": "head", "duration": 600.0}],
            "metrics": ["ape"],
            "rank": {
                "metric": "ape.translation.aligned",
                "point": "eye",
                "statistic": "rmse",
                "min_coverage": 0.95,
            },
        }
    )
    host = VirtualClock()
    session = Session(
        host, Transform(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])), 1, None, Permit()
    )
    arm = CarefulArm(host)
    mover = RobotMover(suite, arm, session, HeadsetProfile(72.0), None, None)
    (step,) = suite.schedule()
    movement = mover.ready(step)
    assert len(arm.passed) == 2
    movement.diary.start(step.name)
    for _ in movement.steps:
        pass
    events = movement.diary.read().events
    gaps = [event.t for event in events if event.kind == "gap"]
    assert {(end - start) / NS for start, end in zip(gaps[::2], gaps[1::2], strict=True)} == {2.0}
    loops = [event.t for event in events if event.kind == "loop"]
    # as many runs as fit: none is lost to a gap that was long once
    assert 600.0 - 32.0 < (loops[-1] - loops[0]) / NS <= 600.0
