import json
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import make_lsq_spline
from vrbench_ur import fraction, search
from vrbench_ur.arms import ARMS, UR5E
from vrbench_ur.checks import Breach
from vrbench_ur.fraction import moveit_fraction
from vrbench_ur.kinematics import flange
from vrbench_ur.options import Limits, Options, Payload, Start, Workspace
from vrbench_ur.picture import svg
from vrbench_ur.plan_file import describe, write_plan
from vrbench_ur.planner import PlanError, Planner
from vrbench_ur.search import quiet
from vrbench_ur.spline import JointPath, fit
from vrbench_ur.targets import Task, postures, start_eye
from vrbench_ur.testing import MOUNTING, START, nod, options

from vrbench.errors import ConfigError
from vrbench.geometry import Transform, relative_angle, rotvec_to_quat
from vrbench.motion.generators import generate
from vrbench.motion.motion import relative_to_first
from vrbench.trajectory import Trajectory


@pytest.fixture(autouse=True)
def _little_effort(monkeypatch):
    """The whole search takes seconds; a tenth of it shows what it does."""
    for name, value in {"CANDIDATES": 1024, "LOOKED_AT": 48, "REFINED": 1, "ROUNDS": 2}.items():
        monkeypatch.setattr(search, name, value)


@pytest.fixture(scope="module")
def planner():
    return Planner(UR5E, options(), MOUNTING)


@pytest.fixture(scope="module")
def plan(planner):
    return planner.plan(nod())


def test_the_eye_moves_as_the_head_did(planner, plan):
    """`T_i = B A dO_i A^-1`: from the joints alone, by pinocchio and not by what planned them."""
    t = nod().seconds(0)
    frames = np.array([planner.cell.flange(q) for q in plan.path.at(t)])
    eye = Transform.from_matrix(frames) @ MOUNTING
    start = start_eye(START)
    want = start @ nod().pose
    assert np.linalg.norm(eye.p - want.p, axis=1).max() < 1e-4
    assert relative_angle(eye.q, want.q).max() < 1e-3
    assert 1e3 * np.linalg.norm(eye.p - want.p, axis=1).max() <= plan.deviation_mm + 1e-9


def test_the_head_starts_upright(plan):
    up = start_eye(START).matrix()[:3, 1]
    np.testing.assert_allclose(up, [0, 0, 1], atol=1e-12)
    assert plan.path.lead_in_s == 0.0


def test_the_planned_tcp_is_where_the_joints_put_it(plan):
    t = plan.target.seconds(0)
    tcp = flange(plan.path.at(t), UR5E.dh)
    np.testing.assert_allclose(plan.target.pose.p, tcp.p, atol=1e-9)


def test_the_same_motion_gives_the_same_hash_and_another_another(planner, plan):
    assert planner.plan(nod()).hash == plan.hash
    assert planner.plan(nod(size=0.9)).hash != plan.hash
    heavier = Planner(UR5E, options(payload=Payload(kg=2.5)), MOUNTING)
    assert heavier.plan(nod()).hash != plan.hash


def test_a_motion_that_begins_moving_gets_a_lead_and_rests_at_both_ends(planner):
    plan = planner.plan(nod(still=False))
    assert plan.path.lead_in_s == pytest.approx(1.0, abs=0.02)
    ends = np.array([0.0, plan.path.duration_s])
    assert np.abs(plan.path.at(ends, 1)).max() < 0.02
    assert plan.path.duration_s == pytest.approx(
        3.0 + plan.path.lead_in_s + plan.path.lead_out_s, abs=0.05
    )


@pytest.mark.parametrize("name", list(ARMS))
def test_speed_acceleration_and_clearance_keep_their_limits(name):
    arm = ARMS[name]
    # the small arm has a start of its own
    changes = {"payload": Payload(kg=1.5)}
    if name == "ur3e":
        changes |= {"start": Start(p_m=(0.25, 0.0, 0.75), yaw_deg=155.84)}
    made = Planner(arm, options(**changes), MOUNTING)
    try:
        plan = made.plan(nod(size=0.3))
    except PlanError as error:
        pytest.fail(str(error))
    t = plan.path.grid(500.0)
    qd, qdd = plan.path.at(t, 1), plan.path.at(t, 2)
    limits = made.options.limits
    assert (np.abs(qd) <= arm.speed * limits.speed_percent / 100 * 1.01).all()
    assert np.abs(qdd).max() <= limits.acceleration * 1.01
    assert made.cell.clearance(plan.path.at(t))[0].min() > 0.019


def test_too_fast_says_where_which_joint_and_what_stretch_would_do():
    slow = options(limits=Limits(speed_percent=3.0))
    with pytest.raises(PlanError) as caught:
        Planner(UR5E, slow, MOUNTING).plan(nod())
    text = str(caught.value)
    assert "speed at " in text
    assert "deg/s is above" in text
    assert "strict fraction 0." in text
    stretch = float(text.split("a stretch of ")[1].split()[0])
    slower = slow.model_copy(update={"stretch": stretch})
    done = Planner(UR5E, slower, MOUNTING).plan(nod())
    assert done.stretch == stretch
    assert done.path.duration_s == pytest.approx(3.0 * stretch, rel=1e-6)


def test_time_is_never_stretched_unasked(plan):
    assert plan.stretch == 1.0
    assert plan.path.duration_s == pytest.approx(nod().duration_s)


def test_out_of_reach_names_the_time_and_a_start_that_would_do():
    far = options(start=Start(p_m=(1.4, 0.0, 0.9), yaw_deg=0.0))
    with pytest.raises(PlanError, match=r"out of reach of ur5e at 0\.00 s.*yaw_deg: .* does it"):
        Planner(UR5E, far, MOUNTING).plan(nod())


def test_what_no_start_can_do_is_said_too():
    with pytest.raises(PlanError, match="a smaller or slower motion"):
        Planner(UR5E, options(start=None), MOUNTING).plan(nod(size=40.0))


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda p, q, t: (np.where(t[:, None] > 2e9, np.nan, p), q), "not finite at 2.0"),
        (lambda p, q, t: (p, q * 1.1), "no unit quaternion"),
    ],
)
def test_a_broken_motion_is_refused(planner, change, what):
    motion = nod()
    p, q = change(motion.pose.p, motion.pose.q, motion.t)
    with pytest.raises(ConfigError, match=what):
        planner.plan(Trajectory(motion.t, Transform(p, q)))


def test_gaps_and_stubs_are_no_motions(planner):
    motion = nod()
    with pytest.raises(ConfigError, match=r"gap of 1\.0"):
        planner.plan(Trajectory(motion.t + (motion.t > 10**9) * 10**9, motion.pose))
    with pytest.raises(ConfigError, match="12 or more"):
        planner.plan(motion[:5])


def test_what_no_start_can_do_is_told_of_a_start_that_gets_far():
    t = nod(6.0).t
    angle = np.pi * np.sin(np.linspace(0, np.pi, len(t)))
    turn = np.column_stack((angle, np.zeros((len(t), 2))))
    over = Trajectory(t, Transform(np.zeros((len(t), 3)), rotvec_to_quat(turn)))
    with pytest.raises(PlanError) as told:
        Planner(UR5E, Options(), MOUNTING).plan(over)
    assert float(re.search(r"strict fraction ([0-9.]+)", str(told.value))[1]) > 0.1


def test_what_breaks_before_the_motion_is_told_so():
    breach = Breach("speed", 0.25, "elbow", 200.0, 180.0, "deg/s")
    assert "at 0.25 s" in str(breach)
    assert "0.75 s before the motion" in str(breach.earlier(1.0))


def test_the_spline_is_scipys_own_fit():
    t = np.arange(600) / 120.0
    q = np.cumsum(np.random.default_rng(1).normal(size=(600, 6)), axis=0) * 1e-3
    path = fit(t, q)
    want = make_lsq_spline(t, q, path.knots, k=5)
    np.testing.assert_allclose(path.coefficients, want.c, atol=1e-12)


def test_too_heavy_is_refused_before_anything_is_planned():
    with pytest.raises(ConfigError, match=r"9 kg is above the payload of ur5e.*at most 5 kg"):
        Planner(UR5E, options(payload=Payload(kg=9.0)), MOUNTING)


def test_the_tcp_stays_in_its_box_or_the_plan_says_where_it_leaves():
    boxed = options(workspace=Workspace(tcp_min_m=(-2, -2, -2), tcp_max_m=(2, 2, 0.5)))
    with pytest.raises(PlanError, match=r"workspace at .*tcp z"):
        Planner(UR5E, boxed, MOUNTING).plan(nod())


def test_moveits_fraction_counts_waypoints_and_the_part_of_the_broken_segment(planner):
    task = Task(nod(), MOUNTING, planner.options).coarse(12.0)
    way = task.flange(START)
    q0 = postures(way, UR5E.dh)[0, 0]
    assert moveit_fraction(way, q0, planner.cell) == 1.0
    # out of reach from the middle on
    half = len(way) // 2
    p = way.p.copy()
    p[half:] += [3.0, 0.0, 0.0]
    broken = moveit_fraction(Transform(p, way.q), q0, planner.cell)
    assert (half - 1) / (len(way) - 1) <= broken < half / (len(way) - 1)


def test_the_spacing_of_interpolation_is_not_a_tolerance(planner, monkeypatch):
    way = Task(nod(), MOUNTING, planner.options).coarse(12.0).flange(START)
    q0 = postures(way, UR5E.dh)[0, 0]
    for step in (0.001, 0.03, 1.0):
        monkeypatch.setattr(fraction, "EEF_STEP_M", step)
        assert moveit_fraction(way, q0, planner.cell) == 1.0


def test_a_plan_file_holds_the_path_that_was_planned(plan, tmp_path):
    file, picture = write_plan(plan, tmp_path / "plan.json")
    told = json.loads(file.read_text(encoding="utf-8"))
    assert told["hash"] == plan.hash
    knots, points = (np.array(told["path"][name]) for name in ("knots", "coefficients"))
    path = JointPath(knots, points, told["lead_in_s"], told["lead_out_s"])
    t = plan.path.grid(120.0)
    np.testing.assert_allclose(path.at(t), plan.path.at(t), atol=1e-11)
    assert picture.read_text(encoding="utf-8").startswith("<svg")


def test_the_picture_shows_the_least_clearance_and_its_limit(plan):
    """A dip of one sample among those that a point of the curve stands for is still drawn."""
    least = np.full(9000, 0.050)
    least[4321] = 0.021
    examined = replace(
        plan.examined, t=np.arange(9000) / 120, clearance=least, speed=np.zeros((9000, 6))
    )
    drawn = svg(replace(plan, examined=examined))
    curves = re.findall(r'<polyline points="([^"]+)"', drawn)
    level = np.array([[float(x) for x in at.split(",")] for at in curves[6].split()])[:, 1]
    _, limit = (float(y) for y in re.findall(r'd="M[0-9.]+ ([0-9.]+)h[^>]+stroke="#c00"', drawn))
    # from the frame's lower edge, where clearance is 0, both are as high as they are far
    assert (470 - limit) / (470 - level.max()) == pytest.approx(20 / 21, abs=0.01)


def test_a_plan_is_for_one_rig_and_one_robot(planner):
    others = (
        Planner(UR5E, options("127.0.0.99"), MOUNTING),
        Planner(UR5E, options().model_copy(update={"gain": 700.0}), MOUNTING),
        Planner(ARMS["ur10e"], options(), MOUNTING),
    )
    assert len({planner.rig, *(other.rig for other in others)}) == 4
    assert Planner(UR5E, options(), MOUNTING).rig == planner.rig


def test_a_plan_tells_its_limits_margins_and_warnings(plan):
    told = dict(describe(plan))
    assert told["fraction"] == "strict 1.000, MoveIt's 1.000"
    assert told["speed, of its limit"].endswith(" %")
    assert "nominal kinematics" in told["warning"]


def test_a_controllers_calibration_moves_the_joints_and_is_stated(tmp_path, plan):
    text = "[mounting]\n" + "".join(
        f"{key} = [0.0005, -0.0004, 0.0006, 0.0003, -0.0002, 0.0001]\n"
        for key in ("delta_theta", "delta_a", "delta_d", "delta_alpha")
    )
    file = tmp_path / "calibration.conf"
    file.write_text(text, encoding="utf-8")
    own = Planner(UR5E, options(calibration=file), MOUNTING)
    made = own.plan(nod())
    assert made.hash != plan.hash
    assert 0.1 < made.facts["calibration_max_mm"] < 10.0
    assert not any("nominal" in warning for warning in made.warnings)
    # the calibrated arm goes where the nominal one was to go
    t = nod().seconds(0)
    apart = flange(made.path.at(t), own.dh).p - flange(plan.path.at(t), UR5E.dh).p
    assert np.linalg.norm(apart, axis=1).max() < 2e-4


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", r"no section \[mounting\]"),
        ("[mounting]\ndelta_theta = [1, 2]\n", "delta_theta: found"),
        ("no ini", "is not a controller's"),
    ],
)
def test_a_broken_calibration_is_refused(tmp_path, text, what):
    file = tmp_path / "calibration.conf"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=what):
        Planner(UR5E, options(calibration=file), MOUNTING)


def test_a_missing_calibration_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="can't be read"):
        Planner(UR5E, options(calibration=tmp_path / "none"), MOUNTING)


def test_a_start_is_found_where_none_is_given():
    told = []
    found = Planner(UR5E, options(start=None), MOUNTING).plan(
        nod(), lambda what, done: told.append((what, done))
    )
    assert found.fraction == 1.0
    assert found.examined.cost < 1.0
    assert told[-1][1] == pytest.approx(1.0)


# Starts that the search found; the search itself is in the benchmarks.
FOUND = {
    "shooter-1": Start(p_m=(0.467, 0.0172, 0.9806), yaw_deg=155.43),
    "saturate-1": Start(p_m=(0.5754, 0.0082, 0.8157), yaw_deg=-85.53),
    "saturate-30s-1": Start(p_m=(0.5754, 0.0082, 0.8157), yaw_deg=-85.53),
    "recorded": Start(p_m=(0.2881, -0.009, 0.959), yaw_deg=-154.31),
}


@pytest.mark.parametrize("name", ["shooter-1", "saturate-1", "saturate-30s-1"])
def test_the_suites_motions_can_be_done_by_a_ur5e(name):
    planner = Planner(UR5E, Options(start=FOUND[name]), MOUNTING)
    plan = planner.plan(generate(name).trajectory, quiet)
    assert plan.fraction == 1.0
    assert plan.moveit == 1.0


def test_the_papers_head_recording_can_be_done_by_a_ur5e():
    """With the paper's own A, `T_tcp_body`; no stretch is needed."""
    from vrbench.recording.bags import BagOptions
    from vrbench.recording.importers.rosbag1 import IMPORTER

    bag = "banaszczyk2024/data/real_world_head_trajectories/real_world_head_movement_example_0.bag"
    path = Path(os.environ.get("VRBENCH_DATA", "/nowhere")) / bag
    if not path.is_file():
        pytest.skip("dataset banaszczyk2024 is not here: set VRBENCH_DATA")
    read = IMPORTER.read(path, BagOptions(topic="/optitrack_node/rigid_body_0"))
    a = [
        [-0.999996, 0.000866265, -0.00261548, -0.0107378],
        [-0.00261606, -0.000663386, 0.999996, 0.134303],
        [0.000864527, 0.999999, 0.00066565, 0.342898],
    ]
    motion = relative_to_first(read.samples.trajectory())
    rig = Options(start=FOUND["recorded"])
    plan = Planner(UR5E, rig, Transform.from_matrix(a)).plan(motion, quiet)
    assert plan.fraction == 1.0
    assert plan.stretch == 1.0
    assert plan.deviation_mm < 1.0
