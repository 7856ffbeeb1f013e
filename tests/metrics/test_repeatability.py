import pytest

from vrbench.metrics import repeatability
from vrbench.streams import Columns


def test_repeatability_aligns_time_and_not_space(make_take, moved):
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
