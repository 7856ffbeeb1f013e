import numpy as np
import pytest

from vrbench.protocols.body import body_shapes, difference, usable
from vrbench.streams import Columns, Event

MARKERS = [[81.0, 34.0, -41.0], [-74.0, 41.0, -32.0], [13.0, 78.0, 21.0]]


def told(markers, stream="mocap/headset", t=1):
    return Event(t, "body", {"stream": stream, "name": "headset", "markers_mm": markers})


def moved(by_mm):
    return np.add(MARKERS, [0.0, by_mm, 0.0]).tolist()


def shapes(*markers):
    return [np.array(each) for each in markers]


def test_a_take_tells_of_its_own_reference_only():
    events = [told(MARKERS), told(moved(5.0), "mocap_other/headset"), Event(3, "note", {})]
    (shape,) = body_shapes(Columns({}, events=events), "mocap")
    np.testing.assert_array_equal(shape, MARKERS)
    assert body_shapes(Columns({}, events=events), "robot") == []


def test_bodies_that_agree_within_a_millimetre_go_together():
    assert difference(shapes(MARKERS), shapes(moved(0.5))) is None
    assert difference([], shapes(MARKERS)) is None
    assert difference(shapes(MARKERS), []) is None


def test_a_moved_pivot_and_another_marker_are_told():
    assert "up to 5.0 mm" in difference(shapes(MARKERS), shapes(moved(5.0)))
    assert "in number: 2, 3" in difference(shapes(MARKERS), shapes(MARKERS[:2]))
    # changed in the midst of a take: it goes with none
    assert difference(shapes(MARKERS), shapes(MARKERS, moved(5.0))) is not None


@pytest.mark.parametrize("by_mm", [0.0, 5.0])
def test_a_calibration_of_another_body_is_not_used(by_mm):
    calibrations = {"before": object(), "after": object()}
    bodies = {"before": shapes(MARKERS), "after": shapes(moved(by_mm))}
    good, failures = usable(calibrations, {"first": "failed"}, bodies, shapes(MARKERS))
    assert list(good) == (["before", "after"] if by_mm == 0.0 else ["before"])
    assert failures["first"] == "failed"
    assert ("after" in failures) == (by_mm > 0.0)
