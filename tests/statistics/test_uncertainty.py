import numpy as np
import pytest

from vrbench.statistics.uncertainty import ErrorModel


def model(turn: np.ndarray | None) -> ErrorModel:
    """An error of 0.1 in each of 50 bins, whatever X is."""
    return ErrorModel(np.full(50, 0.01), np.zeros((50, 6)), np.zeros((50, 6, 6)), turn)


def test_the_chance_of_an_alignment_widens_and_does_not_move():
    rng = np.random.default_rng(0)
    turn = 0.03**2 * np.eye(3)
    drawn = model(turn).drawn(np.zeros((20_000, 6)), rng) ** 2
    assert drawn.mean() == pytest.approx(0.01, rel=0.01)
    # the square of a normal vector of three components: variance 6 sigma^4
    assert drawn[:, 0].std() == pytest.approx(np.sqrt(6.0) * 0.03**2, rel=0.05)


def test_an_error_that_is_aligned_itself_is_taken_as_it_is():
    drawn = model(None).drawn(np.zeros((3, 6)), np.random.default_rng(0))
    assert np.array_equal(drawn, model(None).errors(np.zeros((3, 6))))
