import numpy as np
import pytest

from vrbench.geometry import Transform
from vrbench.metrics.registry import builtin_families


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
