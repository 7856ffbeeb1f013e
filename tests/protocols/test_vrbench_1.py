"""Takes made ready by `vrbench-1`: what events tell is used, and what can't be scored is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vrbench.clocks import Skew
from vrbench.errors import EstimationError
from vrbench.geometry import Transform, continuous_signs, quat_multiply, rotvec_to_quat
from vrbench.protocols.synchrony import loop_duration_s, synchronised
from vrbench.protocols.vrbench_1 import calibrate, prepare
from vrbench.streams import Columns, Event, Samples
from vrbench.trajectory import NS

X = Transform(np.array([0.003, 0.087, 0.276]), rotvec_to_quat(np.array([1.5, 0.1, -0.1])))
Y = Transform(np.array([0.4, -0.2, 0.9]), rotvec_to_quat(np.array([0.1, 1.2, 0.2])))
EPOCH_NS = 1_700_000_000 * NS
DURATION_S = 60.0


def tcp(s: np.ndarray) -> Transform:
    """A motion that doesn't repeat, 0.15 m and 20 deg about all axes."""
    rng = np.random.default_rng(5)
    f, phase = rng.uniform(0.1, 0.7, (6, 8, 1)), rng.uniform(0.0, 6.0, (6, 8, 1))
    values = np.sin(2 * np.pi * f * s + phase).sum(axis=1).T
    q = continuous_signs(rotvec_to_quat(0.1 * values[:, 3:]))
    return Transform(np.array([0.4, 0.2, 0.5]) + 0.05 * values[:, :3], q)


def take(s=lambda s: s, shift_ns=0, **facts) -> Columns:
    """Both streams, the motion's time a function of the take's; the eye's clock is ahead by 0.1 s.

    Args:
        s: motion time [s] of times (n,) [s].
        shift_ns: added to the eye's stamps (n,) [ns], as a function of the time of arrival.
    """
    rng = np.random.default_rng(1)
    streams = {}
    for name, hz in (("robot/tcp", 60.0), ("headset/eye", 72.0)):
        since = np.arange(0.0, DURATION_S, 1.0 / hz)
        t = EPOCH_NS + np.rint(since * NS).astype(np.int64)
        pose = tcp(s(since))
        if name == "robot/tcp":
            streams[name] = Samples.of(t, pose)
            continue
        eye = Y.inverse() @ pose @ X
        noise = rotvec_to_quat(rng.normal(0.0, 1e-3, (len(t), 3)))
        p = eye.p + rng.normal(0.0, 1e-3, (len(t), 3))
        stamps = t + NS // 10 + (shift_ns(t) if callable(shift_ns) else shift_ns)
        streams[name] = replace(
            Samples.of(stamps, Transform(p, quat_multiply(eye.q, noise))), receive_t=t
        )
    return Columns(streams, **facts)


def altered(columns: Columns, change) -> Columns:
    """The take with its eye's pose changed: p (n, 3) and q (n, 4) to others."""
    eye = columns.poses["headset/eye"]
    pose = Transform(*change(eye.pose.p.copy(), eye.pose.q.copy()))
    return replace(columns, poses={**columns.poses, "headset/eye": replace(eye, pose=pose)})


TAKE = take()
MIRROR = np.array([1.0, 1.0, -1.0]), np.array([-1.0, -1.0, 1.0, 1.0])


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda p, q: (p * MIRROR[0], q * MIRROR[1]), "mirrored"),
        (lambda p, q: (p * MIRROR[0], q), "mirrored"),
        (lambda p, q: (p, q * np.array([-1.0, -1.0, -1.0, 1.0])), "inverse"),
    ],
)
def test_a_scored_take_in_a_frame_of_another_kind_is_refused_by_name(change, told) -> None:
    with pytest.raises(EstimationError, match=told):
        prepare(altered(TAKE, change), "robot", X)


def test_another_world_halfway_is_an_error_that_is_scored() -> None:
    """A jump that no recentre explains is the headset's."""

    def jump(p, q):
        half = len(p) // 2
        turn = rotvec_to_quat(np.array([0.0, 0.0, 0.6]))
        p[half:] += 0.3
        q[half:] = quat_multiply(turn, q[half:])
        return p, q

    scored = prepare(altered(TAKE, jump), "robot", X)
    assert len(scored.estimate) > 0.9 * DURATION_S * 72.0


def test_a_calibration_with_a_recentre_that_nothing_tells_of_names_the_jump() -> None:
    def jump(p, q):
        half = len(p) // 2
        p[half:] += [0.3, 0.0, 0.4]
        return p, q

    with pytest.raises(EstimationError, match=r"jumps near (29\.[5-9]|30\.\d) s, by about \d+ mm"):
        calibrate(altered(TAKE, jump), "robot", "take")


def test_a_calibration_with_outliers_names_no_jump() -> None:
    def spoil(p, q):
        rng = np.random.default_rng(3)
        bad = rng.random(len(p)) < 0.2
        p[bad] += rng.normal(0.0, 0.3, (bad.sum(), 3))
        return p, q

    assert calibrate(altered(TAKE, spoil), "robot", "take").take == "take"


def since_start(columns: Columns, *, arrivals: bool = False) -> Columns:
    """The eye's stamps counted from its start, 83 s before the take."""
    eye = columns.poses["headset/eye"]
    t = eye.pose_t - EPOCH_NS + 83 * NS
    eye = replace(eye, pose_t=t, source_t=t, receive_t=eye.receive_t if arrivals else t)
    return replace(columns, poses={**columns.poses, "headset/eye": eye})


def test_stamps_of_another_epoch_are_found_by_where_both_streams_begin() -> None:
    scored = prepare(since_start(TAKE), "robot", X)
    offset = float(scored.clock.offset_ns(83 * NS))
    assert offset == pytest.approx(83.1 * NS - EPOCH_NS, abs=3e5)


def test_streams_whose_times_of_arrival_lie_apart_were_not_recorded_together() -> None:
    def late(columns: Columns) -> Columns:
        robot = columns.poses["robot/tcp"]
        hour = robot.receive_t + 3600 * NS
        return replace(
            columns,
            poses={**columns.poses, "robot/tcp": replace(robot, pose_t=hour - 1, receive_t=hour)},
        )

    with pytest.raises(EstimationError, match="do not overlap in time"):
        prepare(late(since_start(TAKE, arrivals=True)), "robot", X)


def test_a_short_take_has_the_skew_of_its_calibrations() -> None:
    columns = take(shift_ns=lambda t: ((t - EPOCH_NS) * 50e-6).astype(np.int64))
    truth = 0.1 + 50e-6 * DURATION_S / 2
    plain = prepare(columns, "robot", X)
    told = prepare(columns, "robot", X, skew=Skew(50e-6, 2e-6))
    middle = int(columns.poses["headset/eye"].pose_t.mean())
    for scored, most in ((plain, 1e-3), (told, 1e-4)):
        assert float(scored.clock.offset_ns(middle)) / NS == pytest.approx(truth, abs=most)
    start, end = told.clock.offset_ns(told.columns.poses["headset/eye"].pose_t[[0, -1]])
    assert (end - start) / NS == pytest.approx(50e-6 * DURATION_S, rel=0.01)
    unsure = prepare(columns, "robot", X, skew=Skew(50e-6, 100e-6))
    assert told.offset_sigma_s < unsure.offset_sigma_s


def test_the_scored_take_finds_offset_and_world() -> None:
    scored = prepare(TAKE, "robot", X)
    assert float(scored.clock.offset_ns(scored.estimate.t[0])) == pytest.approx(0.1 * NS, abs=3e5)
    assert np.linalg.norm(scored.y.p - Y.p) < 1e-3


def test_calibrating_a_take_and_scoring_it_synchronises_it_once() -> None:
    synchronised.cache_clear()
    calibrate(TAKE, "robot", "take"), prepare(TAKE, "robot", X), prepare(TAKE, "robot", None)
    assert (synchronised.cache_info().misses, synchronised.cache_info().hits) == (1, 2)


def looped(period_s: float, told: bool) -> Columns:
    starts = EPOCH_NS + np.arange(0.0, DURATION_S, period_s) * NS
    events = [Event(int(t), "loop", {"number": i, "at": "start"}) for i, t in enumerate(starts)]
    return take(lambda s: loop_time(s, period_s), events=events if told else [])


def loop_time(s: np.ndarray, period_s: float) -> np.ndarray:
    """There and back, so that loops join smoothly."""
    return 3.0 * (1.0 - np.cos(2 * np.pi * s / period_s))


def test_in_a_looped_take_the_search_stays_within_half_a_loop() -> None:
    with pytest.raises(EstimationError, match="two offsets fit alike"):
        synchronised(looped(12.0, told=False), "robot")
    columns = looped(12.0, told=True)
    assert loop_duration_s(columns) == pytest.approx(12.0)
    assert synchronised(columns, "robot").clock_fit.offset_s == pytest.approx(0.1, abs=1e-3)


def step_at(seconds: float, size_s: float):
    """Stamps that follow a step of the host's clock."""
    return lambda t: np.where(t >= EPOCH_NS + seconds * NS, round(size_s * NS), 0)


@pytest.mark.parametrize("size_s", [0.4, 3.0])
def test_a_step_of_the_hosts_clock_is_a_knot_where_stamps_follow_it(size_s) -> None:
    event = Event(EPOCH_NS + 30 * NS, "host-clock-step", {"seconds": size_s})
    columns = take(shift_ns=step_at(30.0, size_s), events=[event])
    clock = synchronised(columns, "robot").clock_fit.clock
    eye = columns.poses["headset/eye"]
    off = clock.to_reference(eye.pose_t) - eye.receive_t
    assert np.abs(off[:1800]).max() < 3e5
    assert np.abs(off[2500:]).max() < 3e5


def test_a_step_of_the_hosts_clock_that_stamps_do_not_follow_changes_nothing() -> None:
    event = Event(EPOCH_NS + 30 * NS, "host-clock-step", {"seconds": 0.4})
    told = synchronised(take(events=[event]), "robot").clock_fit
    assert told.offset_s == synchronised(TAKE, "robot").clock_fit.offset_s


def test_repeated_poses_and_outliers_do_not_hide_the_clock() -> None:
    def freeze(p, q):
        p[1000:2500], q[1000:2500] = p[1000], q[1000]
        return p, q

    def scatter(p, q):
        rng = np.random.default_rng(3)
        hit = np.flatnonzero(rng.random(len(p)) < 0.2)
        turn = rotvec_to_quat(rng.normal(0.0, 0.5, (len(hit), 3)))
        p[hit] += rng.normal(0.0, 0.3, (len(hit), 3))
        q[hit] = quat_multiply(q[hit], turn)
        return p, q

    for change in (freeze, scatter):
        fit = synchronised(altered(TAKE, change), "robot").clock_fit
        assert fit.offset_s == pytest.approx(0.1, abs=2e-3)


def test_a_headset_that_tells_one_pose_is_refused_in_words() -> None:
    still = altered(
        TAKE, lambda p, q: (np.broadcast_to(p[0], p.shape), np.broadcast_to(q[0], q.shape))
    )
    with pytest.raises(EstimationError, match="one and the same pose"):
        synchronised(still, "robot")
