"""The calibration motion made for an arm: what it must contain, and what is told where it can't."""

import numpy as np
import pytest
from click.testing import CliRunner
from vrbench_ur import search
from vrbench_ur.arms import ARMS
from vrbench_ur.options import Options
from vrbench_ur.planning import PlannerPort
from vrbench_ur.search import quiet
from vrbench_ur.testing import MOUNTING

from vrbench.calibration_motion import fit, wanted_reach
from vrbench.cli.motion import command
from vrbench.devices.ports import Plan
from vrbench.errors import DeviceError
from vrbench.geometry import Transform, quat_to_rotvec
from vrbench.motion.files import read_motion
from vrbench.motion.generators import generate
from vrbench.trajectory import Trajectory

SHOOTER = generate("shooter-1").trajectory
SATURATE = generate("saturate-1").trajectory
# Turns about two axes by so much are what a hand-eye calibration needs (Tsai and Lenz, 1989).
EXCITING_DEG = 10.0


@pytest.fixture(scope="module", autouse=True)
def _little_effort():
    """The whole search takes seconds a size; a tenth of it shows what it does."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {"CANDIDATES": 1024, "LOOKED_AT": 48, "REFINED": 1, "ROUNDS": 2}.items():
            patch.setattr(search, name, value)
        yield


def fitted(name):
    planner = PlannerPort(ARMS[name], Options(), MOUNTING)
    return fit("calibration-1", planner, MOUNTING, {"shooter-1": SHOOTER}, quiet)


@pytest.fixture(scope="module")
def small():
    return fitted("ur3e")


@pytest.fixture(scope="module")
def middle():
    return fitted("ur5e")


@pytest.mark.parametrize("arm", ["small", "middle"])
def test_the_arm_can_do_it_slowly_and_about_all_axes(arm, request):
    found = request.getfixturevalue(arm)
    path = found.motion.trajectory
    assert found.plan.fraction == 1.0
    assert found.plan.stretch == 1.0
    turns = np.degrees(np.ptp(quat_to_rotvec(path.pose.q), axis=0))
    assert (turns > 2 * EXCITING_DEG).all()
    assert path.speed().max() <= 1.001 * SATURATE.speed().max()


def test_an_arm_that_can_contains_the_motion_whole(middle):
    assert middle.size == 1.0
    low, high = (f(middle.motion.trajectory.pose.p, axis=0) for f in (np.min, np.max))
    assert (low < SHOOTER.pose.p.min(axis=0)).all()
    assert (high > SHOOTER.pose.p.max(axis=0)).all()
    assert not middle.beyond["shooter-1"].any_outside


def test_a_short_arm_gets_a_smaller_one_and_is_told_what_leaves_it(small):
    assert 0.3 <= small.size < 1.0
    beyond = small.beyond["shooter-1"]
    assert beyond.any_outside
    box = np.abs(small.motion.trajectory.pose.p).max(axis=0)
    assert (box < small.size * 1.1 * wanted_reach([SHOOTER])[:3]).all()


class Anything:
    """A planner of a robot that does all motions, or none."""

    def __init__(self, does):
        self.does = does

    def plan(self, motion, tell):
        if not self.does:
            raise DeviceError("can't turn")
        return Plan(Trajectory(motion.t, motion.pose @ MOUNTING.inverse()), "0")


def test_a_wider_motion_makes_it_wider_and_no_quicker():
    wide = Trajectory(SHOOTER.t, Transform(2.0 * SHOOTER.pose.p, SHOOTER.pose.q))
    found = fit("calibration-1", Anything(True), MOUNTING, {"wide": wide}, quiet)
    path = found.motion.trajectory
    assert (np.ptp(path.pose.p, axis=0) > np.ptp(wide.pose.p, axis=0)).all()
    assert path.speed().max() <= 1.001 * SATURATE.speed().max()
    assert path.duration_s > 1.5 * SATURATE.duration_s
    assert not found.beyond["wide"].any_outside


def test_what_can_do_none_of_them_says_why():
    with pytest.raises(DeviceError, match="can't turn"):
        fit("calibration-1", Anything(False), MOUNTING, {"shooter-1": SHOOTER}, quiet)


def test_the_verb_writes_a_motion_file_that_a_suite_can_name(tmp_path, small):
    file = tmp_path / "motions" / "ours.tum"
    words = ["calibration", "--robot", "ur3e", "-o", str(file)]
    done = CliRunner().invoke(command, words, catch_exceptions=False)
    assert done.exit_code == 0
    assert "scored as extrapolated" in done.output
    assert "of the motion lies outside" in done.output
    motion = read_motion(file)
    assert motion.name == "calibration-ur3e-1"
    np.testing.assert_allclose(motion.trajectory.pose.p, small.motion.trajectory.pose.p, atol=1e-8)
