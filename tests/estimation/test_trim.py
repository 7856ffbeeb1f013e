import numpy as np
import pytest

from vrbench.errors import EstimationError
from vrbench.estimation.trim import active_window
from vrbench.geometry import Transform, rotvec_to_quat
from vrbench.trajectory import NS, Trajectory

START_NS = 1_700_000_000 * NS


def rests_moves_rests(
    rate_hz: float, noise_m: float = 0.0, turn: bool = False, seed: int = 0
) -> Trajectory:
    """At rest to 4 s, a smooth motion to 16 s that passes its resting pose, at rest to 20 s."""
    s = np.arange(0.0, 20.0, 1.0 / rate_hz)
    moving = np.clip((s - 4.0) / 12.0, 0.0, 1.0)
    course = 0.2 * np.sin(4 * np.pi * moving) * np.sin(np.pi * moving) ** 2
    rng = np.random.default_rng(seed)
    p = rng.normal(0.0, noise_m, (len(s), 3)) if noise_m else np.zeros((len(s), 3))
    r = np.zeros((len(s), 3))
    (r if turn else p)[:, 0] += course
    return Trajectory(START_NS + np.rint(s * NS).astype(np.int64), Transform(p, rotvec_to_quat(r)))


@pytest.mark.parametrize("rate_hz", [30.0, 120.0, 500.0])
@pytest.mark.parametrize("turn", [False, True], ids=["moves", "turns"])
def test_the_window_holds_the_motion_and_no_rest(rate_hz, turn):
    start, end = active_window(rests_moves_rests(rate_hz, 1e-4, turn))
    assert 4.0 <= (start - START_NS) / NS < 5.3
    assert 14.7 < (end - START_NS) / NS <= 16.0


def test_a_brief_stop_within_the_motion_stays():
    reference = rests_moves_rests(100.0)
    s = reference.seconds(START_NS)
    course = np.where(s < 10.0, s, np.maximum(s, 12.0))
    p = course[:, None] * np.array([1.0, 0.0, 0.0])
    stopped = Trajectory(reference.t, Transform(p, reference.pose.q))
    assert active_window(stopped) == (stopped.t[0], stopped.t[-1])


def test_a_reference_that_never_rests_is_kept_whole(truth):
    reference = truth(1).reference(30.0, 120.0)
    assert active_window(reference) == (reference.t[0], reference.t[-1])


def test_a_reference_that_never_moves_is_kept_whole():
    reference = rests_moves_rests(30.0)[:100]
    assert active_window(reference) == (reference.t[0], reference.t[-1])


def test_one_pose_or_nan_is_refused(truth):
    reference = truth(1).reference(3.0)
    with pytest.raises(EstimationError, match="only 1 poses"):
        active_window(reference[:1])
    reference.pose.p[5, 1] = np.nan
    with pytest.raises(EstimationError, match="position of pose 6 is not finite"):
        active_window(reference)


def test_recordings_lose_their_idle_start_and_end(recordings):
    window = {
        key: (np.array(active_window(take.tcp)) - take.tcp.t[0]) / NS
        for key, take in recordings.items()
    }
    assert window["quest2", "calib"] == pytest.approx([20.9, 239.8], abs=0.1)
    assert window["quest_pro", "traj1"] == pytest.approx([18.3, 137.0], abs=0.1)
    # both headsets' runs are one robot program
    for run in ("calib", "traj1"):
        lengths = [np.ptp(window[device, run]) for device in ("quest2", "quest_pro")]
        assert lengths[0] == pytest.approx(lengths[1], abs=0.1)
