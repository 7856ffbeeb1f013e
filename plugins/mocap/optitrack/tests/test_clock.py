"""The server's clock, by echoes over a network that delays at random."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from vrbench_optitrack.clock import TickClock, exchanges_of, ticks_to_ns

NS = 1_000_000_000
START = 1_795_000_000 * NS


def server_ticks(t, frequency, skew_ppm, offset_s=1234.5):
    since = (t - START) * (1 + skew_ppm * 1e-6)
    return round((since / NS + offset_s) * frequency)


def echoes(rng, seconds, frequency, skew_ppm, *, hz=8.0, least_ns=60_000, slow_ns=400_000):
    """Requests whose ways there and back are each delayed, as on a busy network."""
    for i in range(round(seconds * hz)):
        sent = START + round(i / hz * NS)
        there, back = least_ns / 2 + rng.exponential(slow_ns, 2)
        came = sent + round(there)
        yield sent, server_ticks(came, frequency, skew_ppm), came + round(back)


@pytest.mark.parametrize("frequency", [3_312_787, 10_000_000, 2_994_380_000])
@pytest.mark.parametrize("skew_ppm", [50.0, -50.0, 0.0])
def test_skew_within_1_ppm_and_offset_within_0_1_ms_after_30_s(frequency, skew_ppm):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        clock = TickClock(frequency)
        for echo in echoes(rng, 30.0, frequency, skew_ppm, slow_ns=30_000):
            assert clock.add(echo)
        # the server gains on the host
        assert clock.skew_ppm == pytest.approx(skew_ppm, abs=1.0)
        t = START + np.arange(0, 31) * NS
        ticks = np.array([server_ticks(x, frequency, skew_ppm) for x in t.tolist()])
        assert np.abs(clock.to_host(ticks) - t).max() < 100_000


def test_the_quickest_echoes_count_and_slow_ones_do_not_bend_the_map():
    rng = np.random.default_rng(1)
    clock = TickClock(10_000_000)
    for i, (sent, ticks, received) in enumerate(echoes(rng, 60.0, 10_000_000, 20.0)):
        # half of the answers come 4 ms late, all on the way back
        clock.add((sent, ticks, received + 4_000_000 * (i % 2)))
    t = START + 60 * NS
    there = clock.to_host(np.array([server_ticks(t, 10_000_000, 20.0)]))[0]
    assert abs(there - t) < 150_000
    assert clock.fit().bound_s < 0.001


def test_the_window_slides_and_stays_small():
    rng = np.random.default_rng(2)
    clock = TickClock(10_000_000)
    for echo in echoes(rng, 400.0, 10_000_000, 10.0, hz=4.0):
        clock.add(echo)
    assert len(clock.kept()) == 120
    assert clock.kept()[0][0] > START + 270 * NS


@pytest.mark.parametrize("step_s", [-100.0, -0.002, 0.002, 0.05, 3600.0])
def test_an_echo_of_a_clock_that_has_stepped_is_not_taken_in(step_s):
    rng = np.random.default_rng(3)
    clock = TickClock(10_000_000)
    before, after = (list(echoes(rng, s, 10_000_000, 0.0)) for s in (5.0, 10.0))
    for echo in before:
        assert clock.add(echo)
    kept = clock.kept()
    shifted = [(s, t + round(step_s * 1e7), r) for s, t, r in after[45:]]
    assert not clock.add(next(echo for echo in shifted if echo[2] - echo[0] < 500_000))
    assert clock.kept() == kept
    assert clock.heard == before[-1][0]


def test_a_clock_that_drifts_through_an_hour_of_silence_has_not_stepped():
    rng = np.random.default_rng(4)
    clock = TickClock(10_000_000)
    for echo in echoes(rng, 2.0, 10_000_000, 100.0):
        assert clock.add(echo)
    late = START + 3600 * NS
    assert clock.add((late, server_ticks(late + 30_000, 10_000_000, 100.0), late + 60_000))


def test_answers_that_overtake_each_other_are_no_step():
    rng = np.random.default_rng(5)
    clock = TickClock(10_000_000)
    sent = list(echoes(rng, 10.0, 10_000_000, 20.0))
    for i in range(0, len(sent), 2):
        assert clock.add(sent[i + 1])
        assert clock.add(sent[i])


@given(st.integers(0, 2**62), st.sampled_from([1, 3_312_787, 10_000_000, 2_994_380_000]))
def test_no_tick_is_lost_in_nanoseconds(ticks, frequency):
    if ticks // frequency > 9_000_000_000:
        ticks %= 9_000_000_000 * frequency
    ns = int(ticks_to_ns(np.array([ticks]), frequency)[0])
    assert ns == ticks * NS // frequency


def test_echoes_become_exchanges_of_the_servers_own_nanoseconds():
    exchanges = exchanges_of([(10, 20, 30), (40, 50, 60)], 10_000_000)
    assert exchanges.sent.tolist() == [10, 40]
    assert exchanges.remote_received.tolist() == [2000, 5000]
    assert exchanges.remote_sent.tolist() == [2000, 5000]
    assert exchanges.received.tolist() == [30, 60]
    assert len(exchanges_of([], 10_000_000)) == 0
