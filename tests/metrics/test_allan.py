import numpy as np
import pytest

from vrbench.errors import EstimationError
from vrbench.metrics import allan
from vrbench.trajectory import NS


def test_allan_deviation_of_white_noise_falls_with_the_root_of_time():
    rng = np.random.default_rng(2)
    t = np.arange(100_000, dtype=np.int64) * (NS // 100)
    error = rng.normal(size=(len(t), 3))
    for tau in (0.1, 1.0, 10.0):
        found, _ = allan.allan_deviation(t, error, tau)
        assert found == pytest.approx(np.sqrt(3 / (100 * tau)), rel=0.12)
    with pytest.raises(EstimationError):
        allan.allan_deviation(t, error, 300.0)


def test_allan_values_or_reasons(values, make_take):
    found = values(allan.FAMILY, make_take())
    assert found["allan@1s", "eye", "all", "value"].value == pytest.approx(0, abs=1e-6)
    assert "stretches of 100 s" in found["allan@100s", "eye", "all", "value"].reason
