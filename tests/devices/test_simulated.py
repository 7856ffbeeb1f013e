"""The simulated devices: seeded, true to their profile, indifferent to how they are read."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import recorded
from vrbench.clocks import Exchanges, fit_exchanges
from vrbench.config.suite import Suite
from vrbench.devices.ports import Session
from vrbench.devices.simulated import headset, robot
from vrbench.devices.simulated.noise import correlated, losses, rng_of
from vrbench.devices.simulated.stage import Stage, VirtualClock
from vrbench.devices.specs import HeadsetProfile, Tracking
from vrbench.geometry import Transform, relative_angle
from vrbench.motion.generators import generate
from vrbench.recording.take import read_take
from vrbench.streams import Samples
from vrbench.trajectory import NS

MOUNTING = Transform.of((0.003, 0.087, 0.276), (0.7071, 0.0, 0.0, 0.7071))
PROFILE = HeadsetProfile(rate_hz=72.0)
STILL = Tracking(0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def perform(
    seed: int = 3,
    reads: int = 1,
    profile: HeadsetProfile = PROFILE,
    headset_options: headset.Options | None = None,
    robot_options: robot.Options | None = None,
    motion: str = "saturate-30s-1",
) -> tuple[Stage, Samples, Samples, Samples]:
    """(stage, headset, robot, target) of one motion; devices are read at every reads-th step."""
    stage = Stage()
    session = Session(VirtualClock(), MOUNTING, seed, stage)
    arm = robot.SimulatedRobot(robot_options or robot.Options(), session)
    head = headset.SimulatedHeadset(headset_options or headset.Options(), profile, session)
    arm.start("take"), head.start("take")
    parts: dict[str, list[Samples]] = {}
    plan = arm.plan(generate(motion).trajectory)
    for step, _ in enumerate(arm.execute(plan), 1):
        if step % reads == 0:
            for source in (arm, head):
                for name, samples in source.read().poses.items():
                    parts.setdefault(name, []).append(samples)
    for source in (arm, head):
        for name, samples in source.read().poses.items():
            parts.setdefault(name, []).append(samples)
    joined = {name: Samples.concatenate(group) for name, group in parts.items()}
    return stage, joined["headset/eye"], joined["robot/tcp"], joined["robot/target"]


def test_one_seed_gives_one_stream_however_it_is_read() -> None:
    _, often, tcp_often, _ = perform(reads=1)
    _, seldom, tcp_seldom, _ = perform(reads=3)
    assert np.array_equal(often.pose.p, seldom.pose.p)
    assert np.array_equal(often.pose_t, seldom.pose_t)
    assert np.array_equal(tcp_often.pose.q, tcp_seldom.pose.q)


def test_another_seed_gives_another_stream() -> None:
    _, one, _, _ = perform(seed=3)
    _, two, _, _ = perform(seed=4)
    assert not np.allclose(one.pose.p, two.pose.p)


def test_a_headset_without_errors_is_where_the_truth_says() -> None:
    options = headset.Options(clock_offset_s=0.25, clock_skew_ppm=20.0)
    stage, head, _, _ = perform(
        profile=HeadsetProfile(72.0, tracking=STILL), headset_options=options
    )
    true = stage.truth["headset"]
    y, x = (Transform.of(true[k]["p_m"], true[k]["q_xyzw"]) for k in ("base_world", "tcp_eye"))
    since = (head.pose_t - true["clock_epoch_ns"]) / NS
    host = head.pose_t - np.rint((0.25 + 20e-6 * (since - 0.25)) * NS).astype(np.int64)
    expected = stage.tcp(host) @ x
    found = y @ head.pose
    assert np.abs(found.p - expected.p).max() < 1e-8
    assert relative_angle(found.q, expected.q).max() < 1e-7


def test_the_errors_have_the_profile_s_size() -> None:
    squares = []
    for seed in range(12):
        t = np.arange(0.0, 120.0, 0.1)
        noise = correlated(rng_of(seed, "x"), 0.001, 2.0, 3)(t)
        squares.append(np.mean(noise**2, axis=0))
    assert np.sqrt(np.mean(squares)) == pytest.approx(0.001, rel=0.05)


def test_slow_noise_keeps_its_correlation_time() -> None:
    t = np.arange(0.0, 2000.0, 0.25)
    noise = correlated(rng_of(5, "x"), 1.0, 2.0, 8)(t)
    lag = 8  # 2 s, one time constant
    r = np.mean(noise[lag:] * noise[:-lag]) / np.mean(noise**2)
    assert r == pytest.approx(np.exp(-1.0), abs=0.08)


def test_slow_noise_is_gaussian() -> None:
    """Its mean square scatters from take to take as that of such a process does: tones of one
    size would scatter by less, and intervals of an rmse seem too wide.
    """
    t = np.arange(0.0, 120.0, 0.1)
    squares = [np.mean(correlated(rng_of(seed, "x"), 1.0, 2.0, 3)(t) ** 2) for seed in range(400)]
    # twice the time constant over the duration, on each of three axes
    assert np.std(squares) == pytest.approx(np.sqrt(2.0 * 2.0 / 120.0 / 3.0), rel=0.1)


def test_slow_noise_is_a_function_of_time() -> None:
    def noise():
        return correlated(rng_of(3, "x"), 1.0, 2.0, 3)

    t = np.linspace(-130.0, 300.0, 2000)
    whole, there = noise()(t), noise()
    assert np.array_equal(there(t[1500:1510]), whole[1500:1510])
    assert np.array_equal(there(t[100:110]), whole[100:110])
    # no step where one chunk ends and the next begins
    near = np.arange(59.0, 61.0, 1e-3)
    assert np.abs(np.diff(noise()(near), axis=0)).max() < 0.03
    assert len(noise()(np.zeros(0))) == 0


def test_losses_come_as_often_and_last_as_long_as_asked() -> None:
    t = np.arange(0.0, 3600.0, 0.01)
    for hour in (0, 9):
        lost = losses(rng_of(1, "x"), 6.0, 0.5)(t + 3600.0 * hour)
        assert lost.mean() == pytest.approx(6.0 * 0.5 / 60.0, rel=0.15)


def test_losses_are_the_same_whichever_instants_are_asked_for_first() -> None:
    t = np.arange(0.0, 6 * 3600.0, 1.0)
    forwards, backwards = (losses(rng_of(1, "x"), 6.0, 0.5) for _ in range(2))
    late = backwards(t[-100:])
    assert np.array_equal(forwards(t), backwards(t))
    assert np.array_equal(late, forwards(t[-100:]))


def test_lost_poses_are_sent_and_flagged() -> None:
    tracking = Tracking(lost_per_minute=20.0, lost_s=0.5)
    _, head, _, _ = perform(profile=HeadsetProfile(72.0, tracking=tracking))
    assert 0.02 < 1.0 - head.good.mean() < 0.5
    assert len(head) == pytest.approx(72 * 31, abs=3)


def test_no_losses_where_none_are_asked_for() -> None:
    _, head, _, _ = perform(profile=HeadsetProfile(72.0, tracking=STILL))
    assert head.good.all()


@pytest.mark.parametrize("rate", [30.0, 125.0, 500.0])
def test_the_robot_logs_at_its_rate_and_repeats_to_three_hundredths(rate: float) -> None:
    options = robot.Options(rate_hz=rate, lag_s=0.0)
    _, _, tcp, target = perform(robot_options=options)
    steps = np.diff(tcp.pose_t)
    assert np.all(steps == steps[0])
    assert NS / steps[0] == pytest.approx(rate, rel=1e-3)
    planned = target.trajectory()
    inside = (tcp.pose_t >= planned.t[0]) & (tcp.pose_t <= planned.t[-1])
    error = tcp.pose.p[inside] - planned.at(tcp.pose_t[inside]).p
    assert 5e-6 < np.sqrt(np.mean(np.sum(error**2, axis=1))) < 6e-5


def test_options_are_checked() -> None:
    with pytest.raises(ValueError, match="less than or equal to 500"):
        robot.Options(rate_hz=1000.0)


def test_a_mount_has_its_own_x_and_its_own_world(tmp_path: Path, short_suite: Suite) -> None:
    cases = [case.model_copy(update={"remounts": 1}) for case in short_suite.cases]
    suite = short_suite.model_copy(update={"cases": tuple(cases)})
    bundle = recorded(suite, tmp_path / "run")
    truths = {
        path.stem: json.loads(path.read_text())["headset"]
        for path in (bundle.folder / "truth").glob("*.json")
    }
    one, same, other = (truths[f"replay.default.{place}"] for place in ("m1.r1", "m1.r2", "m2.r1"))
    assert one["tcp_eye"] == same["tcp_eye"] != other["tcp_eye"]
    assert one["base_world"] == same["base_world"] != other["base_world"]
    assert one["clock_offset_s"] == other["clock_offset_s"]


def test_a_run_is_the_same_byte_for_byte(tmp_path: Path, short_suite: Suite) -> None:
    one, two = (recorded(short_suite, tmp_path / name, seed=5) for name in ("a", "b"))
    assert [t.sha256 for t in one.record.takes] == [t.sha256 for t in two.record.takes]


def test_takes_hold_what_the_devices_sent(run: Path) -> None:
    columns = read_take(run / "takes" / "replay.default.m1.r1.mcap")
    assert set(columns.poses) == {"headset/eye", "robot/tcp", "robot/target"}
    phases = [event.detail["name"] for event in columns.events if event.kind == "phase"]
    assert phases == ["move", "rest"]
    assert columns.metadata["motion"] == "saturate-30s-1"


def exact(**errors: float) -> HeadsetProfile:
    """A headset without noise, with these errors."""
    return HeadsetProfile(72.0, tracking=replace(STILL, **errors))


def in_base(stage: Stage, head: Samples, world: int = 0) -> Transform:
    """`T_base_eye` as the headset has it, in its world-th world."""
    true = stage.truth["headset"]["base_worlds"][world]
    return Transform.of(true["p_m"], true["q_xyzw"]) @ head.pose


def true_eye(stage: Stage, host: np.ndarray) -> Transform:
    true = stage.truth["headset"]["tcp_eye"]
    return stage.tcp(host) @ Transform.of(true["p_m"], true["q_xyzw"])


def moving(head: Samples) -> slice:
    """Samples well within the motion, of which derivatives can be taken."""
    return slice(4 * 72, len(head) - 4 * 72)


def test_a_prediction_leads_and_errs_with_the_acceleration() -> None:
    options = headset.Options(clock_offset_s=0.0)
    stage, head, _, _ = perform(profile=exact(prediction_s=0.1), headset_options=options)
    part = moving(head)
    told, t = in_base(stage, head)[part], head.pose_t[part]
    lead, h = 100_000_000, 20_000_000
    before, there, after = (true_eye(stage, t + lead + side) for side in (-h, 0, h))
    acceleration = (before.p + after.p - 2.0 * there.p) / (h / NS) ** 2
    error = told.p - there.p
    assert error == pytest.approx(-0.5 * 0.1**2 * acceleration, abs=1e-6)
    assert np.abs(error).max() > 5e-4
    assert (
        relative_angle(told.q, there.q).max() < relative_angle(told.q, true_eye(stage, t).q).max()
    )


def test_a_scale_error_lengthens_all_distances() -> None:
    stage, head, _, _ = perform(profile=exact(scale_error=0.01))
    _, plain, _, _ = perform(profile=exact())
    assert stage.truth["headset"]["scale_error"] == 0.01
    assert head.pose.p == pytest.approx(1.01 * plain.pose.p, abs=1e-12)
    assert np.array_equal(head.pose.q, plain.pose.q)


def test_a_world_drifts_evenly_from_where_the_eye_was() -> None:
    drift = {"drift_m_per_min": 0.006, "drift_rad_per_min": 0.02}
    _, head, _, _ = perform(profile=exact(**drift))
    _, plain, _, _ = perform(profile=exact())
    minutes = len(head) / 72.0 / 60.0
    turned = relative_angle(head.pose.q, plain.pose.q)
    assert turned[-1] == pytest.approx(0.02 * minutes, rel=0.01)
    # the motion ends where it began, so the turn about that place moves nothing there
    moved = np.linalg.norm(head.pose.p[-1] - plain.pose.p[-1])
    assert moved == pytest.approx(0.006 * minutes, rel=0.05)
    assert np.linalg.norm(head.pose.p[0] - plain.pose.p[0]) < 1e-5


def test_a_recentre_opens_a_new_world_and_is_told() -> None:
    options = headset.Options(clock_offset_s=0.0, recentre_s=(20.0, 10.0))
    stage = Stage()
    session = Session(VirtualClock(), MOUNTING, 3, stage)
    arm = robot.SimulatedRobot(robot.Options(), session)
    source = headset.SimulatedHeadset(options, exact(), session)
    arm.start("take"), source.start("take")
    movement = arm.execute(arm.plan(generate("saturate-30s-1").trajectory))
    columns = [source.read() for _ in movement]
    head = Samples.concatenate([c.poses["headset/eye"] for c in columns])
    events = [event for c in columns for event in c.events]
    begin = stage.truth["headset"]["clock_epoch_ns"]
    assert [(e.kind, (e.t - begin) / NS) for e in events] == [
        ("recentre", 10.0),
        ("recentre", 20.0),
    ]
    assert np.unique(head.epoch).tolist() == [0, 1, 2]
    since = (head.pose_t - begin) / NS
    assert np.array_equal(head.epoch, np.searchsorted([10.0, 20.0], since, side="right"))
    for world in range(3):
        part = head[head.epoch == world]
        assert in_base(stage, part, world).p == pytest.approx(
            true_eye(stage, part.pose_t).p, abs=1e-8
        )


def test_a_world_stays_over_the_takes_of_a_mount_until_somebody_recentres() -> None:
    stage = Stage()
    session = Session(VirtualClock(), MOUNTING, 3, stage)
    arm = robot.SimulatedRobot(robot.Options(), session)
    source = headset.SimulatedHeadset(headset.Options(clock_offset_s=0.0), exact(), session)
    told = []
    for place, recentred in enumerate((False, False, True)):
        if recentred:
            stage.recentred.append(session.host.now())
            session.host.wait(1.0)
        arm.start(f"take {place}"), source.start(f"take {place}")
        for _ in arm.execute(arm.plan(generate("saturate-30s-1").trajectory)):
            pass
        columns = source.read()
        head = columns.poses["headset/eye"]
        epoch = int(head.epoch[0])
        told.append((epoch, source.facts()["world"], columns.events))
        assert np.all(head.epoch == epoch)
        assert in_base(stage, head, epoch).p == pytest.approx(
            true_eye(stage, head.pose_t).p, abs=1e-8
        )
        assert stage.truth["headset"]["base_world"] == stage.truth["headset"]["base_worlds"][epoch]
    name = "seed 3 mount 1"
    assert told == [(0, name, []), (0, name, []), (1, name, [])]


def test_pings_give_the_host_s_time_and_leave_the_raw_one() -> None:
    options = headset.Options(clock_offset_s=0.4, clock_skew_ppm=30.0, clock_exchanges=True)
    stage = Stage()
    session = Session(VirtualClock(), MOUNTING, 5, stage)
    arm = robot.SimulatedRobot(robot.Options(), session)
    source = headset.SimulatedHeadset(options, exact(), session)
    arm.start("take"), source.start("take")
    movement = arm.execute(arm.plan(generate("saturate-30s-1").trajectory))
    columns = [source.read() for _ in movement]
    head = Samples.concatenate([c.poses["headset/eye"] for c in columns])
    exchanges = Exchanges.concatenate([c.clocks["headset"] for c in columns])
    true_host = head.receive_t - round(0.008 * NS)
    assert np.abs(head.pose_t - true_host).max() < 1e6
    assert head.source_t - true_host == pytest.approx(0.4 * NS, abs=2e6)
    assert np.all(exchanges.round_trip >= 1e6)
    fitted = fit_exchanges(exchanges).clock
    assert np.abs(fitted.to_reference(head.source_t) - true_host).max() < 1e6


def test_a_rig_may_replace_numbers_of_the_profile_that_there_are() -> None:
    options = headset.Options(tracking={"scale_error": 0.02})
    stage, _, _, _ = perform(profile=exact(), headset_options=options)
    assert stage.truth["headset"]["scale_error"] == 0.02
    with pytest.raises(ValueError, match=r"no scale; there are .*scale_error"):
        headset.Options(tracking={"scale": 0.02})
