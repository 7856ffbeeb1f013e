import numpy as np
import pytest

from vrbench.errors import EstimationError
from vrbench.metrics import robust


def test_theil_sen_is_not_moved_by_a_fifth_of_outliers():
    rng = np.random.default_rng(3)
    x = np.linspace(0, 10, 2000)
    y = 3 * x + rng.normal(0, 0.1, len(x))
    y[rng.choice(len(x), 400, replace=False)] += 100
    assert robust.theil_sen(x, y) == pytest.approx(3, abs=0.05)
    with pytest.raises(EstimationError):
        robust.theil_sen(np.zeros(5), np.arange(5.0))
