import numpy as np
import pytest
from scipy.signal import lfilter

from vrbench.estimation.noise import Noise, estimate_noise, with_past


def autoregressive(seed: int, n: int, coefficients: list[float]) -> np.ndarray:
    """Three series (n, 3) with news of unit variance."""
    news = np.random.default_rng(seed).normal(size=(n + 500, 3))
    return lfilter([1.0], [1.0, *(-c for c in coefficients)], news, axis=0)[500:]


def nothing(n: int) -> np.ndarray:
    return np.zeros((n, 3, 1))


def test_the_noise_is_found_from_its_residuals():
    residual = autoregressive(0, 4000, [0.7, 0.2])
    found = estimate_noise(residual, np.ones(4000, dtype=bool), nothing(4000))
    assert found.coefficients[:2] == pytest.approx([0.7, 0.2], abs=0.04)
    assert found.variance == pytest.approx(1.0, rel=0.04)


def test_white_noise_is_hardly_predicted():
    residual = autoregressive(1, 2000, [])
    found = estimate_noise(residual, np.ones(2000, dtype=bool), nothing(2000))
    assert np.abs(found.coefficients).sum() < 0.1


def test_what_is_whitened_is_white():
    residual, known = autoregressive(2, 4000, [0.95]), np.ones(4000, dtype=bool)
    found = estimate_noise(residual, known, nothing(4000))
    news = found.whitened(residual, found.rows(known))
    assert news.std() == pytest.approx(1.0, rel=0.02)
    assert abs(np.mean(news[1:] * news[:-1])) < 0.03


def test_nothing_is_predicted_across_a_gap():
    known = np.ones(20, dtype=bool)
    known[8:11] = False
    assert with_past(known, 2).tolist() == [2, 3, 4, 5, 6, 7, 13, 14, 15, 16, 17, 18, 19]
    assert with_past(known, 0).tolist() == np.flatnonzero(known).tolist()


def test_few_bins_are_taken_as_white():
    residual = autoregressive(3, 15, [0.9])
    assert len(estimate_noise(residual, np.ones(15, dtype=bool), nothing(15)).coefficients) == 0


def test_what_a_fit_took_from_the_noise_is_given_back():
    """A mean, fitted to noise that lasts, takes much of the slow power with it."""
    n, coefficient = 300, 0.95
    variance, without = [], []
    for seed in range(60):
        residual = autoregressive(seed, n, [coefficient])
        residual = residual - residual.mean(axis=0)
        root = np.eye(3) / np.sqrt(n) / (1.0 - coefficient)
        spread = np.broadcast_to(root, (n, 3, 3))
        known = np.ones(n, dtype=bool)
        for into, given in ((variance, spread), (without, nothing(n))):
            noise = estimate_noise(residual, known, given)
            into.append(np.sqrt(noise.variance) / (1.0 - noise.coefficients.sum()))
    true = 1.0 / (1.0 - coefficient)
    assert abs(np.median(variance) - true) < 0.5 * abs(np.median(without) - true)


def test_the_scatter_of_sums_under_a_noise():
    noise = Noise(np.array([0.9]), 2.0)
    values = np.random.default_rng(4).normal(size=(50, 3, 2)).cumsum(axis=0)
    lags = np.abs(np.subtract.outer(np.arange(50), np.arange(50)))
    covariance = 2.0 / (1.0 - 0.81) * 0.9**lags
    expected = np.einsum("ack,ab,bcl->kl", values, covariance, values)
    assert noise.scattered(values) == pytest.approx(expected, rel=1e-3)
