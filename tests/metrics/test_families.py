"""The smaller families, each on takes whose numbers are known."""

import numpy as np
import pytest

from vrbench.clocks import ClockMap
from vrbench.geometry import Transform
from vrbench.metrics import clock, coverage, handeye, repeatability, replay, rpe, scale, timing
from vrbench.metrics.registry import builtin_families
from vrbench.streams import GOOD, Columns, Flag, Samples
from vrbench.trajectory import NS


def test_families_are_found_and_have_names_of_their_own():
    families = builtin_families()
    assert {"ape", "rpe", "scale", "coverage", "timing", "clock", "replay"} <= {
        family.name for family in families
    }
    names = [name for family in families for name in family.units]
    assert len(names) == len(set(names))
    assert all(family.of_take or family.of_repeats for family in families)


def rest(s):
    return Transform(np.zeros((len(s), 3)), np.tile([0, 0, 0, 1.0], (len(s), 1)))


POOR = {
    "no good sample": {"flags": lambda s: np.zeros(len(s))},
    "no sample": {"keep": lambda s: s < 0},
    "one sample": {"keep": lambda s: s < 0.01},
    "two samples": {"keep": lambda s: s < 0.02},
    "one second": {"keep": lambda s: s < 1},
    "no x": {"x": None, "y": None},
    "no motion": {"path": rest},
    "no window": {"duration": 0.0},
    "anchor over all": {"anchor_end": 2**62},
    "anchor before": {"anchor_end": 0},
}


@pytest.mark.parametrize("poor", POOR)
def test_poor_takes_have_reasons_where_they_lack_numbers(values, make_take, poor):
    take = make_take(**POOR[poor])
    for family in builtin_families():
        if family.of_take is not None:
            found = values(family, take)
            assert {value.metric for value in found.values()} <= set(family.units)
            assert found
        if family.of_repeats is not None:
            for value in family.of_repeats([take, take]):
                assert (value.value is None) == bool(value.reason)


def test_rpe_sees_drift_by_its_rate(values, make_take):
    def spoil(s, pose):
        return Transform(pose.p + np.outer(0.001 * s, [1, 0, 0]), pose.q)

    found = values(rpe.FAMILY, make_take(30.0, spoil=spoil))
    assert found["rpe.translation@1s", "eye", "all", "rmse"].value == pytest.approx(1, rel=0.01)
    assert found["rpe.translation@10s", "tcp", "all", "mean"].value == pytest.approx(10, rel=0.01)
    assert found["rpe.rotation@0.1s", "eye", "all", "max"].value == pytest.approx(0, abs=1e-6)


def test_rpe_of_a_short_take_says_so(values, make_take):
    found = values(rpe.FAMILY, make_take(5.0))
    assert "10 s apart" in found["rpe.translation@10s", "", "all", "rmse"].reason


def test_scale_is_reference_over_estimate(values, make_take):
    take = make_take(spoil=lambda _, pose: Transform(pose.p / 1.01, pose.q))
    assert values(scale.FAMILY, take)["scale", "eye", "all", "value"].value == pytest.approx(1.01)


def test_missing_samples_and_bad_samples_both_cost_coverage(values, make_take):
    whole = values(coverage.FAMILY, make_take())["coverage.valid", "", "all", "value"]
    assert whole.value == pytest.approx(100)
    lost = values(coverage.FAMILY, make_take(keep=lambda s: (s < 5) | (s > 10)))
    assert lost["coverage.valid", "", "all", "value"].value == pytest.approx(75, abs=0.2)
    bad = values(
        coverage.FAMILY,
        make_take(flags=lambda s: np.where((s < 5) | (s > 10), GOOD, int(Flag.POSITION_VALID))),
    )
    assert bad["coverage.valid", "", "all", "value"].value == pytest.approx(75, abs=0.2)
    assert bad["coverage.completion", "", "all", "value"].value == 100


def test_every_other_sample_missing_for_a_while_costs_half_of_it(values, make_take):
    def keep(s):
        return (s < 5) | (np.arange(len(s)) % 2 == 0) | (s > 10)

    found = values(coverage.FAMILY, make_take(keep=keep))
    assert found["coverage.valid", "", "all", "value"].value == pytest.approx(87.5, abs=0.2)


def test_completion_ends_with_the_last_good_sample(values, make_take):
    found = values(coverage.FAMILY, make_take(keep=lambda s: s < 15))
    assert found["coverage.completion", "", "all", "value"].value == pytest.approx(75, abs=0.2)
    nothing = make_take(flags=lambda s: np.zeros(len(s)))
    assert values(coverage.FAMILY, nothing)["coverage.valid", "", "all", "value"].value == 0


def test_timing_counts_repeats_and_measures_intervals(values, make_take):
    take = make_take(10.0, rate=50.0)
    again = np.sort(np.concatenate((np.arange(len(take.samples)), [10, 20, 20])))
    found = values(timing.FAMILY, make_take(10.0, rate=50.0, samples=take.samples[again]))
    assert found["timing.rate", "", "all", "value"].value == pytest.approx(50)
    assert found["timing.interval", "", "all", "median"].value == pytest.approx(20)
    assert found["timing.duplicates", "", "all", "count"].value == 3


def test_clock_gives_the_offset_in_the_middle_and_the_mean_skew(values, make_take):
    start = int(make_take().reference.t[0])
    found = values(clock.FAMILY, make_take(clock=ClockMap.affine(start, -0.26, 20e-6)))
    assert found["clock.skew", "", "all", "value"].value == pytest.approx(20, rel=1e-3)
    expected = -260 + 20e-6 * (10 - 0.26) * 1e3
    assert found["clock.offset", "", "all", "value"].value == pytest.approx(expected, abs=1e-3)
    assert found["clock.residual", "", "all", "rmse"].value is None
    constant = values(clock.FAMILY, make_take(clock=ClockMap.affine(start, 0.1)))
    assert "constant" in constant["clock.skew", "", "all", "value"].reason


def test_the_residual_comes_from_the_fit(values, make_take):
    class Fit:
        residual_s = 0.0015

    found = values(clock.FAMILY, make_take(clock_fit=Fit()))
    assert found["clock.residual", "", "all", "rmse"].value == pytest.approx(1.5)


def test_handeye_residuals_to_the_first_pose_carry_its_error(values, make_take):
    def spoil(s, pose):
        p = pose.p.copy()
        p[0] += [0.005, 0, 0]
        return Transform(p, pose.q)

    found = values(handeye.FAMILY, make_take(spoil=spoil))
    assert found["handeye.translation", "eye", "all", "median"].value == pytest.approx(0, abs=1e-6)
    to_first = found["handeye.translation.to_first", "tcp", "all", "mean"]
    assert to_first.value == pytest.approx(5, abs=0.01)
    assert found["handeye.rotation", "eye", "all", "max"].value == pytest.approx(0, abs=1e-5)


def moved(samples, seconds, mm=(0, 0, 0)):
    t = samples.pose_t + round(seconds * NS)
    return Samples.of(t, Transform(samples.pose.p + np.array(mm) / 1e3, samples.pose.q))


def test_repeatability_aligns_time_and_not_space(make_take):
    first, second = make_take(), make_take(30.0)
    # The second starts 1.2345 s later in the motion, and 2 mm higher.
    tcp = second.columns.poses["robot/tcp"]
    late = make_take(
        30.0,
        columns=Columns({"robot/tcp": moved(tcp, -1.2345, (0, 0, 2))}),
        reference=second.reference,
    )
    rows = {v.statistic: v for v in repeatability.of_repeats([first, late])}
    assert rows["rmse"].value == pytest.approx(2, abs=0.02)
    assert rows["std"].value < 0.02
    assert rows["max"].point == "tcp"


def test_one_repeat_has_no_repeatability(make_take):
    (row,) = repeatability.of_repeats([make_take()])
    assert row.value is None
    assert "one repeat" in row.reason


def test_replay_forgives_the_delay_and_not_the_path(values, make_take):
    take = make_take()
    tcp = take.columns.poses["robot/tcp"]
    columns = Columns(
        {"robot/target": tcp, "robot/tcp": moved(tcp, 0.085, (0.5, 0, 0))},
        metadata={"fraction": "0.9"},
    )
    found = values(replay.FAMILY, make_take(columns=columns))
    assert found["replay.fidelity", "tcp", "all", "rmse"].value == pytest.approx(0.5, abs=0.02)
    assert found["replay.fraction", "", "all", "value"].value == pytest.approx(90, abs=0.2)
    missing = values(replay.FAMILY, take)
    assert "robot/target" in missing["replay.fidelity", "", "all", "rmse"].reason
