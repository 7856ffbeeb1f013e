import numpy as np
import pytest

from vrbench.errors import EstimationError
from vrbench.metrics.association import associate, nearest


def pairs(*args, **more):
    return [x.tolist() for x in associate(*args, **more)]


def test_of_two_equally_near_the_earlier_is_taken():
    assert pairs(np.array([0.5, 1.5, 9.0]), np.array([1.0]), 1.0) == [[0], [0]]


def test_the_shorter_trajectory_is_walked_through_the_estimate_when_equal():
    long, short = np.array([0.0, 0.4, 1.0]), np.array([0.0, 1.0])
    assert pairs(long, short, 0.5) == [[0, 2], [0, 1]]
    assert pairs(short, long, 0.5) == [[0, 1], [0, 2]]
    # Both estimates are nearest to the first of the reference.
    assert pairs(np.array([0.0, 5.0]), np.array([0.0, 0.1]), 0.5) == [[0, 0], [0, 1]]
    assert pairs(np.array([0.0, 0.1]), np.array([0.0, 5.0]), 0.5) == [[0], [0]]


def test_stamps_in_any_order_and_a_single_pair():
    assert [x.tolist() for x in nearest(np.array([2.0, 1.0]), np.array([3.0, 1.0, 2.0]), 0.1)] == [
        [0, 1],
        [2, 1],
    ]
    assert pairs(np.array([1.0]), np.array([1.01]), 0.011) == [[0], [0]]


@pytest.mark.parametrize(("a", "b"), [([], []), ([1.0], []), ([1.0], [1.011]), ([1.0, 2.0], [5.0])])
def test_no_pair_is_an_error_that_says_what_was_looked_for(a, b):
    with pytest.raises(EstimationError, match=r"lie within 0\.01 s"):
        associate(np.array(a), np.array(b))
