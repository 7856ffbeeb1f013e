"""Stretches that a take's events declare, on the clock of its reference."""

import numpy as np
import pytest

from vrbench.geometry import Transform
from vrbench.protocols.stretches import inside, spans
from vrbench.streams import Columns, Event, Samples

NS = 10**9


def reference(late_ns: int = 0) -> Samples:
    t = np.arange(0, 100 * NS, NS)
    still = Transform(np.zeros((100, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (100, 1)))
    return Samples.of(t + late_ns, still, receive_t=t)


def take(*events: tuple[int, str, str]) -> Columns:
    return Columns({}, events=[Event(s * NS, kind, {"at": at}) for s, kind, at in events])


def test_starts_and_ends_are_paired_by_kind():
    columns = take(
        *((5, "loop", "start"), (6, "gap", "start"), (7, "gap", "end"), (9, "loop", "end"))
    )
    assert spans(columns, "loop", reference()).tolist() == [[5 * NS, 9 * NS]]
    assert spans(columns, "gap", reference()).tolist() == [[6 * NS, 7 * NS]]
    assert spans(columns, "hold", reference()).shape == (0, 2)


def test_what_never_ended_is_no_stretch():
    columns = take((5, "loop", "start"), (9, "loop", "end"), (12, "loop", "start"))
    assert spans(columns, "loop", reference()).tolist() == [[5 * NS, 9 * NS]]


@pytest.mark.parametrize(("late_s", "shift_s"), [(-0.006, 0), (3600, 3600), (-1e6, -1e6)])
def test_they_are_on_the_references_clock(late_s, shift_s):
    columns = take((5, "gap", "start"), (6, "gap", "end"))
    found = spans(columns, "gap", reference(round(late_s * NS)))
    assert found.tolist() == [[round((5 + shift_s) * NS), round((6 + shift_s) * NS)]]


def test_inside_means_from_the_start_and_before_the_end():
    t = np.array([0, 1, 2, 3, 4, 5, 9])
    assert inside(t, np.array([[1, 3], [4, 6]])).tolist() == [
        False,
        True,
        True,
        False,
        *[True] * 2,
        False,
    ]
    assert not inside(t, np.zeros((0, 2), dtype=np.int64)).any()
