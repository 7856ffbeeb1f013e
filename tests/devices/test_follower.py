"""A clock followed by its answers: offset, drift, and steps, on answers made here."""

import numpy as np
import pytest

from vrbench.devices.follower import Answer, DeviceClock

MS = 1_000_000
START = 1_700_000_000 * 10**9
OFFSET = 987_654_321_000


def answers(count, *, every_ms=100, skew=0.0, offset=OFFSET, start=START, seed=1):
    """Answers over a link whose two ways are delayed by chance, 1 to 9 ms each."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        sent = start + k * every_ms * MS
        there, back = rng.uniform(1, 9, 2) * MS
        arrived = sent + int(there)
        device = arrived + offset + round(skew * (arrived - START))
        yield Answer(sent, device, device + 50_000, arrived + 50_000 + int(back))


def true_host(device, skew=0.0, offset=OFFSET):
    return START + round((device - START - offset) / (1 + skew))


@pytest.mark.parametrize("skew", [0.0, 30e-6, -50e-6])
def test_times_are_mapped_within_the_delays_of_the_link(skew):
    clock = DeviceClock()
    assert all(clock.add(answer) for answer in answers(600, skew=skew))
    t = np.linspace(clock.until - 5 * 10**9, clock.until, 50).astype(np.int64)
    errors = clock.to_host(t) - [true_host(int(x), skew) for x in t]
    assert np.abs(errors).max() < 3 * MS
    assert clock.bound_ns < 5 * MS
    # maps go on without a jump
    assert np.abs(np.diff(errors)).max() < 1 * MS


def test_nothing_is_mapped_before_a_few_answers():
    clock = DeviceClock()
    for answer in answers(4):
        clock.add(answer)
    assert clock.until is None
    clock.add(list(answers(5))[4])
    assert clock.until is not None


@pytest.mark.parametrize("step_ms", [-3_600_000, -500, -25, 25, 500, 3_600_000])
def test_a_step_is_noticed_at_the_next_answer(step_ms):
    clock = DeviceClock()
    assert all(clock.add(answer) for answer in answers(50))
    (after,) = answers(1, start=START + 5 * 10**9, offset=OFFSET + step_ms * MS)
    assert not clock.add(after)


def test_a_link_that_grows_slow_is_no_step():
    clock = DeviceClock()
    assert all(clock.add(answer) for answer in answers(50))
    for k in range(50):
        sent = START + 5 * 10**9 + k * 100 * MS
        arrived = sent + 400 * MS
        device = arrived + OFFSET
        assert clock.add(Answer(sent, device, device, arrived + 2 * MS))


def test_an_answer_from_before_its_question_is_refused():
    clock = DeviceClock()
    assert not clock.add(Answer(START, START + OFFSET, START + OFFSET + 10**9, START + MS))
    assert not clock.add(Answer(START, START + OFFSET, START + OFFSET - 1, START + MS))


def test_frames_can_be_mapped_up_to_an_answer_at_once():
    clock = DeviceClock()
    *first, last = answers(20, every_ms=10)
    for answer in first:
        clock.add(answer)
    before = clock.until
    clock.add(last, at_once=True)
    assert clock.until == last.remote_received > before
