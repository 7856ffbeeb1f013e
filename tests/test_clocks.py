import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vrbench.clocks import ClockMap, Exchanges, fit_exchanges
from vrbench.errors import EstimationError
from vrbench.trajectory import NS

EPOCH = 1_700_000_000_123_456_789
# A device that counts from its start, beside a host in epoch time, is this far behind [s].
BOOT = -1.7e9

skews = st.floats(-5e-4, 5e-4)
offsets_s = st.floats(-3600, 3600)


def exchanges(
    n=50, *, offset_ns=5_000_000, skew=0.0, there=None, back=None, period=NS
) -> Exchanges:
    """n exchanges with a device of a known clock; `there` and `back` [ns] are on the wire."""
    sent = EPOCH + np.arange(n) * period
    there = np.full(n, 200_000) if there is None else there
    back = np.full(n, 200_000) if back is None else back
    at = sent + there
    remote = at + offset_ns + np.rint(skew * (at - EPOCH)).astype(np.int64)
    return Exchanges(sent, remote, remote + 50_000, at + 50_000 + back)


@given(offset=offsets_s)
def test_a_constant_offset_is_taken_off(offset):
    t = EPOCH + np.arange(0, 600, 60) * NS
    found = ClockMap.affine(EPOCH, offset).to_reference(t)
    assert np.abs(found - (t - round(offset * NS))).max() <= 1


def test_one_knot_is_a_constant_offset():
    clock = ClockMap(np.array([EPOCH]), np.array([2.5e9]))
    t = EPOCH + np.array([-NS, 0, NS])
    assert clock.to_reference(t).tolist() == (t - 2_500_000_000).tolist()


@given(offset=offsets_s, skew=skews, seconds=st.integers(-3600, 3600))
def test_an_affine_map_undoes_a_clock_that_runs_at_its_own_pace(offset, skew, seconds):
    # the device's time is a known function of the reference's; the map is its inverse
    clock = ClockMap.affine(EPOCH, offset, skew)
    device = np.array([EPOCH + seconds * NS])
    expected = EPOCH + seconds * NS - round(offset * NS) - round(skew * seconds * NS)
    assert abs(int(clock.to_reference(device)[0]) - expected) <= 3


@given(skew=skews)
def test_neighbouring_nanoseconds_map_to_neighbours_at_epoch_time(skew):
    t = EPOCH + 600 * NS + np.arange(10)
    found = ClockMap.affine(EPOCH, 0.1, skew).to_reference(t)
    assert np.diff(found).min() >= 0
    assert found[-1] - found[0] in (8, 9, 10)


@pytest.mark.parametrize("skew_ppm", [-50, -0.3, 0.0, 1, 33.3])
def test_the_skew_of_a_device_that_counts_from_its_start_keeps_its_digits(skew_ppm):
    # an offset of 1.7e18 ns is known in float64 to 256 ns, so only differences can be asked for
    clock = ClockMap.affine(7 * NS, BOOT, skew_ppm * 1e-6)
    t = np.array([7, 3607]) * NS
    grown = -np.diff(clock.to_reference(t) - t)[0]
    assert grown == pytest.approx(skew_ppm * 1e-6 * 3600 * NS, abs=2_000)


knots = st.lists(st.integers(1, 300), min_size=2, max_size=8)


@given(steps=knots, seed=st.integers(0, 99))
def test_a_map_of_pieces_is_continuous_and_meets_its_knots(steps, seed):
    at = EPOCH + np.cumsum(steps) * NS
    offsets = np.random.default_rng(seed).uniform(-1e6, 1e6, len(at))
    clock = ClockMap(at, offsets)
    np.testing.assert_allclose(clock.offset_ns(at), offsets, atol=1e-3)
    np.testing.assert_allclose(clock.offset_ns(at - 1), clock.offset_ns(at), atol=0.1)
    inside = np.linspace(0, at[-1] - at[0], 50).astype(np.int64)
    expected = np.interp(inside, at - at[0], offsets)
    np.testing.assert_allclose(clock.offset_ns(at[0] + inside), expected, atol=1e-2)


def test_a_map_goes_on_with_the_slope_of_its_outer_pieces():
    clock = ClockMap(EPOCH + np.array([0, 100, 200]) * NS, np.array([0.0, 1000.0, 0.0]))
    outside = EPOCH + np.array([-50, 250]) * NS
    np.testing.assert_allclose(clock.offset_ns(outside), [-500, -500])


# fit of exchanges


def test_a_steady_clock_is_found_to_the_nanosecond():
    fit = fit_exchanges(exchanges(offset_ns=123_456_789))
    t = EPOCH + np.array([0, 30]) * NS
    assert (t - fit.clock.to_reference(t)).tolist() == [123_456_789] * 2
    assert fit.bound_s == 200e-6
    assert fit.residual_s == 0.0


def test_a_clock_that_counts_from_its_start_is_found():
    fit = fit_exchanges(exchanges(offset_ns=-EPOCH + 7 * NS))
    device = np.array([7, 37]) * NS
    assert np.abs(fit.clock.to_reference(device) - (EPOCH + np.array([0, 30]) * NS)).max() <= 256


@pytest.mark.parametrize("skew", [-40e-6, 40e-6])
def test_skew_is_found_in_a_long_session(skew):
    fit = fit_exchanges(exchanges(600, skew=skew))
    device = EPOCH + 5_000_000 + np.array([0, 600]) * NS
    grown = -np.diff(fit.clock.to_reference(device) - device)[0]
    assert grown / (600 * NS) == pytest.approx(skew, rel=1e-3)


def test_skew_is_not_guessed_from_a_short_session():
    fit = fit_exchanges(exchanges(30, skew=40e-6))
    t = EPOCH + np.array([0, 1000]) * NS
    assert np.unique(fit.clock.offset_ns(t)).size == 1


def test_slow_answers_do_not_move_the_offset():
    rng = np.random.default_rng(0)
    late = np.where(rng.uniform(size=200) < 0.6, rng.integers(1_000_000, 50_000_000, 200), 0)
    fit = fit_exchanges(exchanges(200, there=200_000 + late))
    t = np.array([EPOCH + 100 * NS])
    assert abs(fit.clock.offset_ns(t)[0] - 5_000_000) < 1_000
    assert fit.used == 60


def test_the_offset_is_never_wrong_by_more_than_the_bound():
    # all of the delay on one way is the worst there can be
    for there, back in ((400_000, 0), (0, 400_000)):
        fit = fit_exchanges(exchanges(there=np.full(50, there), back=np.full(50, back)))
        error = fit.clock.offset_ns(np.array([EPOCH]))[0] - 5_000_000
        assert abs(error) <= fit.bound_s * NS


def test_joined_exchanges_are_fitted_as_one():
    whole = exchanges(100)
    parts = [
        Exchanges(
            *(
                column[part]
                for column in (whole.sent, whole.remote_received, whole.remote_sent, whole.received)
            )
        )
        for part in (slice(0, 40), slice(40, None))
    ]
    joined = Exchanges.concatenate(parts)
    assert len(joined) == 100
    assert joined.round_trip.tolist() == whole.round_trip.tolist()


def test_no_answer_and_an_answer_before_its_request_are_errors():
    with pytest.raises(EstimationError, match="no clock exchange"):
        fit_exchanges(exchanges(0))
    with pytest.raises(EstimationError, match="a clock stepped"):
        fit_exchanges(exchanges(5, back=np.full(5, -10_000_000)))
