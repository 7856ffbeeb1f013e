from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vrbench.errors import DataError
from vrbench.geometry import quat_normalize
from vrbench.recording import checks
from vrbench.recording.checks import imported_poses, increasing, with_invalid

FILE = Path("made-up.log")
stamps = st.lists(st.integers(0, 30), min_size=1, max_size=12).map(
    lambda values: np.array(values, dtype=np.int64)
)


def poses(n):
    rng = np.random.default_rng(n)
    return rng.normal(size=(n, 3)), quat_normalize(rng.normal(size=(n, 4)))


def longest_by_trying_all(t):
    best = [1] * len(t)
    for i in range(len(t)):
        best[i] = 1 + max((best[j] for j in range(i) if t[j] < t[i]), default=0)
    return max(best)


@given(stamps)
def test_what_is_kept_increases_and_is_the_most_that_can(t):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(checks, "MAX_DROPPED", 1.0)
        keep = increasing(t, file=FILE)
    assert np.all(np.diff(t[keep]) > 0)
    assert np.all(np.diff(keep) > 0)
    assert len(keep) == longest_by_trying_all(t)


@given(stamps)
def test_more_than_one_pose_of_few_is_never_dropped(t):
    gone = len(t) - longest_by_trying_all(t)
    if gone > 1:
        with pytest.raises(DataError, match=f"here {gone} would have to be"):
            increasing(t, file=FILE)
    else:
        assert len(increasing(t, file=FILE)) == len(t) - gone


def test_of_a_stamp_that_repeats_the_first_is_kept():
    assert increasing(np.array([1, 2, 2, 3]), file=FILE).tolist() == [0, 1, 3]


def test_one_stamp_far_ahead_costs_one_pose_and_not_all_that_follow():
    t = np.arange(100) * 10
    t[40] = 10**9
    assert increasing(t, file=FILE).tolist() == [*range(40), *range(41, 100)]


@pytest.mark.parametrize(("n", "allowed"), [(10, 1), (999, 1), (5000, 5)])
def test_one_pose_in_a_thousand_may_be_dropped_and_not_more(n, allowed):
    t = np.arange(n) * 1000
    t[1 : 1 + allowed] = 0
    assert len(increasing(t, file=FILE)) == n - allowed
    t[1 : 2 + allowed] = 0
    with pytest.raises(DataError, match=f"repeat at {allowed + 1} of {n} places, first at pose 2"):
        increasing(t, file=FILE)


def test_a_clock_set_back_is_refused_with_how_far_it_went():
    t = np.arange(7200) * 13_888_889
    t[4000:] -= 2_000_000_000
    with pytest.raises(
        DataError, match=r"first at line 4001, by up to 1\.986 s.*cut the recording"
    ):
        increasing(t, file=FILE, row="line")


@pytest.mark.parametrize("bad", [5, 9])
def test_a_dropped_pose_is_recorded_wherever_it_stood(bad):
    p, q = poses(10)
    t = np.arange(10, dtype=np.int64)
    t[bad] = t[bad - 1]
    imported = imported_poses(t, p, q, file=FILE, receive_t=t + 100, row="message")
    assert imported.repairs == (
        f"1 message dropped, whose stamps repeat or go back (first: message {bad + 1})",
    )
    others = np.delete(np.arange(10), bad)
    np.testing.assert_array_equal(imported.samples.pose.p, p[others])
    np.testing.assert_array_equal(imported.samples.receive_t, t[others] + 100)


def test_a_pose_that_is_told_again_is_dropped_however_often():
    p, q = poses(10)
    again = np.repeat(np.arange(10), 3)
    t = 1000 * again
    imported = imported_poses(t, p[again], q[again], file=FILE, receive_t=t, row="line")
    assert imported.repairs == ("20 lines dropped, the same as the one before, stamp and pose",)
    assert imported.samples.pose_t.tolist() == list(range(0, 10_000, 1000))


def test_the_advice_on_stamps_is_for_what_is_wrong_with_them():
    p, q = poses(3000)
    with pytest.raises(DataError, match="one pose a stamp: are stamps too coarse"):
        imported_poses(np.arange(3000) // 2, p, q, file=FILE)
    shuffled = np.random.default_rng(0).permutation(3000)
    with pytest.raises(DataError, match="sort its poses by time"):
        imported_poses(shuffled, p, q, file=FILE)


def test_signs_of_quaternions_are_made_continuous():
    p, q = poses(1)
    q = np.repeat(q, 6, axis=0) * np.array([1, -1, -1, 1, -1, 1])[:, None]
    imported = imported_poses(np.arange(6), np.repeat(p, 6, axis=0), q, file=FILE)
    np.testing.assert_allclose(imported.samples.pose.q, np.repeat(q[:1], 6, axis=0), atol=1e-15)
    assert imported.repairs == ()


def test_no_poses_are_refused():
    p, q = poses(0)
    with pytest.raises(DataError, match=r"made-up\.log: holds no poses"):
        imported_poses(np.zeros(0, dtype=np.int64), p, q, file=FILE)


def test_a_position_that_is_not_finite_is_refused_by_its_row():
    p, q = poses(5)
    p[3, 1] = np.inf
    with pytest.raises(DataError, match="position of line 4 is not finite"):
        imported_poses(np.arange(5), p, q, file=FILE, row="line")


def test_a_quaternion_far_from_unit_length_is_refused_by_its_row():
    p, q = poses(5)
    q[2] *= 1.5
    with pytest.raises(DataError, match=r"quaternion of pose 3 has length 1\.5"):
        imported_poses(np.arange(5), p, q, file=FILE)


def at_rest(t):
    n = len(t)
    return np.asarray(t, dtype=np.int64), np.zeros((n, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))


SECOND = 10**9


@pytest.mark.parametrize(("stray", "at"), [("first", 0), ("last", -1)])
def test_a_stray_stamp_at_an_end_is_dropped_and_told(stray, at):
    t = np.arange(100) * SECOND + 10**18
    t[at] += (-(10**6) if stray == "first" else 8 * 10**9) * SECOND
    imported = imported_poses(*at_rest(t), file=FILE)
    assert len(imported.samples) == 99
    assert "1 at an end dropped, over an hour away" in imported.repairs[0]


def test_two_recordings_in_one_file_are_refused():
    t = np.arange(100) * SECOND
    t[50:] += 9949 * SECOND
    with pytest.raises(DataError, match=r"9950 s lie between pose 50 and the next"):
        imported_poses(*at_rest(t), file=FILE)


def test_invalid_samples_are_added_and_nothing_else_is_lost():
    t = np.array([0, 20, 40])
    found = imported_poses(t, np.zeros((3, 3)), np.tile([0.0, 0, 0, 1], (3, 1)), file=Path("x"))
    given = replace(found, markers=np.ones((4, 3)), repairs=("mended",))
    more = with_invalid(given, np.array([10, 30]))
    assert more.samples.pose_t.tolist() == [0, 10, 20, 30, 40]
    assert more.samples.good.tolist() == [True, False, True, False, True]
    assert more.markers is given.markers
    assert more.repairs == ("mended",)
