"""How sure an error is: intervals of a take's or a run's rmse and mean, with X redrawn."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vrbench.estimation.alignment import align, column_means
from vrbench.estimation.blocks import block_covariance, block_length
from vrbench.geometry import Floats, Ints, Transform, cross, quat_multiply, rotvec_to_quat
from vrbench.metrics.compared import MM, Compared, aligned
from vrbench.metrics.scored import ScoredTake
from vrbench.statistics import NORMAL_95
from vrbench.statistics.bootstrap import Interval, Series, bootstrap
from vrbench.statistics.following import STEP, Errors, Key, Vectors, errors_of, shares
from vrbench.trajectory import NS

# Errors are averaged over bins this long: far below the time over which they are correlated.
BIN_S = 0.1
# Longer takes have longer bins, or an hour's replicates would not fit into memory.
MOST_BINS = 10_000
REPLICATES = 500
TRANSLATION, ROTATION = "ape.translation.aligned", "ape.rotation.aligned"


@dataclass(frozen=True, slots=True, eq=False)
class ErrorModel:
    """The square of an error over a take, in bins of time, as a quadratic function of X.

    Attributes:
        constant: mean square error in each bin (b,), in the square of the error's unit.
        linear: its gradient (b, 6): rotation vector in `eye` [rad], translation in `tcp` [m].
        quadratic: and half its curvature (b, 6, 6).
        motion: of `constant`, what errors make that follow the motion, above its mean (b,). It
            comes back wherever the motion does, so it is no chance of the take.
        block: bins over which errors depend on each other. That of the errors themselves: their
            squares forget sooner, or seem to, and their intervals would be too narrow.
        turn: what the alignment's own rotation adds to the square in the mean of such takes. It is
            fitted to positions, turns all rotations of the take alike, and so no resampling of
            them shows it. None for translations, which are fitted themselves.
        turned: what it added in this take.
        freedom: of how many blocks, less one, `turn` was found.
        slow: whether mean squares in bins tell the mean error too: it hardly changes within a bin,
            and no turn is taken from its square. The mean of others has no interval.
    """

    constant: Floats
    linear: Floats
    quadratic: Floats
    motion: Floats
    block: int
    turn: float | None = None
    turned: float = 0.0
    freedom: float = np.inf
    slow: bool = True

    def drawn(self, dx: Floats, rng: np.random.Generator) -> Floats:
        """Squares (m, b) as they would be with another X, off by dx (m, 6), and as the alignment
        leaves them in the mean of such takes.

        The take's own X has added one draw to its mean square already, so what draws add is
        centred, and widens the interval without moving it.
        """
        products = np.einsum("mi,mj->mij", dx, dx).reshape(len(dx), -1)
        products -= products.mean(axis=0)
        # one product of matrices: what it gives is the largest thing here
        square: Floats = (
            np.concatenate((dx, products), axis=1)
            @ np.concatenate((self.linear, self.quadratic.reshape(len(self.linear), -1)), axis=1).T
        )
        square += self.constant
        if self.turn is not None:
            larger = np.ones(len(dx))
            if np.isfinite(self.freedom):
                # as Student's t does for a variance that few blocks tell
                larger = self.freedom / rng.chisquare(self.freedom, size=len(dx))
            square += (larger * self.turn - self.turned)[:, None]
        return square


def error_models(take: ScoredTake, translation: Errors) -> dict[Key, ErrorModel]:
    """Models of the aligned errors of translation [mm] and rotation [deg], at the eye and the tcp.

    Args:
        take: with X.
        translation: its errors, from `translation_errors`.

    Returns:
        by metric and point.

    Raises:
        EstimationError: the take has no X, or can't be aligned.
    """
    places, turns = translation_models(take, translation), _rotation_models(take, translation)
    # intervals are drawn in this order, from one source of chance
    return dict(item for pair in zip(places.items(), turns.items(), strict=True) for item in pair)


def translation_models(take: ScoredTake, translation: Errors) -> dict[Key, ErrorModel]:
    """Those of translation alone."""
    bins = time_bins(take.estimate.t)
    return quadratic_models(take, translation_vectors, translation, bins)


def _rotation_models(take: ScoredTake, translation: Errors) -> dict[Key, ErrorModel]:
    bins = time_bins(take.estimate.t)
    errors = errors_of(take, rotation_vectors)
    models = quadratic_models(take, rotation_vectors, errors, bins)
    for at in aligned(take):
        key, place = (ROTATION, at.point), (TRANSLATION, at.point)
        share = shares(translation.here[place], translation.like[place])
        noise = (translation.here[place] - translation.followed(place)) / MM
        turn, blocks = _turn(at, noise, bins)
        rotation = errors.here[key]
        mean = column_means(rotation)
        systematic = share @ np.array([column_means(like) for like in errors.like[key]])
        # about another turn than this take's, squares would scatter otherwise
        crossed = 2.0 * _binned((rotation - mean) @ mean, bins)
        models[key] = replace(
            models[key],
            motion=models[key].motion + crossed - crossed.mean(),
            turn=turn,
            turned=float(mean @ mean - systematic @ systematic),
            freedom=max(blocks - 1.0, 3.0),
            slow=False,
        )
    return models


def time_bins(t: Ints) -> Ints:
    """The bin of each stamp (n,) [ns], in order of time, counted without holes."""
    bin_s = max(BIN_S, (int(t[-1]) - int(t[0])) / NS / MOST_BINS)
    places = np.floor((t - t[0]) / (bin_s * NS))
    bins: Ints = np.cumsum(np.diff(places, prepend=places[0]) > 0.0)
    return bins


def quadratic_models(
    take: ScoredTake, vectors: Vectors, errors: Errors, bins: Ints
) -> dict[Key, ErrorModel]:
    """Models of error vectors (n, 3) that depend on the take's X, given the bin of each (n,)."""
    assert take.x is not None
    derivatives: dict[Key, list[Floats]] = {key: [] for key in errors.here}
    for dx in STEP * np.eye(6):
        for key, there in vectors(replace(take, x=moved_x(take.x, dx))):
            derivatives[key].append((there - errors.here[key]) / STEP)
    return {
        key: _model(error, errors.followed(key), derivatives.pop(key), bins)
        for key, error in errors.here.items()
    }


def _turn(at: Compared, noise: Floats, bins: Ints) -> tuple[float, float]:
    """Mean square [deg^2] of the chance in an alignment's rotation, from the noise (n, 3) [m] it
    leaves, and in how many blocks that was.
    """
    arm = at.estimate.p - at.estimate.p.mean(axis=0)
    inertia = np.sum(arm * arm) * np.eye(3) - arm.T @ arm
    scores = cross(arm, noise)
    sums: Floats = np.stack([np.bincount(bins, column) for column in scores.T], 1).astype(float)
    covariance, length = block_covariance(np.linalg.inv(inertia), sums)
    return float(np.degrees(np.degrees(np.trace(covariance)))), len(sums) / length


def moved_x(x: Transform, dx: Floats) -> Transform:
    """X off by dx (..., 6): a rotation vector in `eye` [rad], a translation in `tcp` [m]."""
    return Transform(x.p + dx[..., 3:], quat_multiply(x.q, rotvec_to_quat(dx[..., :3])))


def intervals(
    models: Sequence[Mapping[Key, ErrorModel]],
    covariances: Sequence[Floats | None],
    places: Sequence[tuple[str, str]],
    rng: np.random.Generator,
) -> dict[tuple[str, str, str], Interval]:
    """Intervals by metric, point and statistic, over the takes of one case together.

    Args:
        models: of each take.
        covariances: of the X that each take was scored with (6, 6); None if it isn't known.
        places: sitting and mount of each take; takes of one mount share one X.
        rng: where the randomness comes from.
    """
    found: dict[tuple[str, str, str], Interval] = {}
    for key in models[0]:
        if not all(key in model for model in models):
            continue
        own = [model[key] for model in models]
        for statistic, wanted in STATISTICS.items():
            if statistic == "mean" and not all(model.slow for model in own):
                continue
            series = [
                Series(wanted(model, model.constant), mount, sitting, model.block)
                for model, (sitting, mount) in zip(own, places, strict=True)
            ]

            def redraw(
                rng: np.random.Generator,
                count: int,
                own: Sequence[ErrorModel] = own,
                wanted: Callable[[ErrorModel, Floats], Floats] = wanted,
            ) -> list[Floats]:
                dx: dict[tuple[str, str], Floats] = {}
                for place, covariance in zip(places, covariances, strict=True):
                    if place not in dx:
                        dx[place] = _draws(covariance, count, rng)
                return [
                    wanted(model, model.drawn(dx[place], rng))
                    for model, place in zip(own, places, strict=True)
                ]

            interval = bootstrap(
                series, rng, statistic="mean", replicates=REPLICATES, redraw=redraw
            )
            if statistic == "rmse":
                low, high = np.sqrt(np.maximum((interval.low, interval.high), 0.0)).tolist()
                interval = replace(interval, low=low, high=high)
            found[*key, statistic] = interval
    return found


def _squares(model: ErrorModel, squares: Floats) -> Floats:
    """Squares (..., b) without what the motion alone makes them differ by from bin to bin."""
    return squares - model.motion


def _lengths(_model: ErrorModel, squares: Floats) -> Floats:
    """Errors (..., b) of their squares."""
    return np.sqrt(np.maximum(squares, 0.0))


# What the mean is taken of; the rmse is the root of a mean square.
STATISTICS: dict[str, Callable[[ErrorModel, Floats], Floats]] = {
    "rmse": _squares,
    "mean": _lengths,
}


def offset_interval(take: ScoredTake, offset_ms: float) -> Interval | None:
    """The interval of the clock's offset [ms]; None where it wasn't fitted with X.

    It is the offset's in the middle of the take, and takes in how well its skew is known.
    """
    if take.offset_sigma_s is None:
        return None
    half = NORMAL_95 * 1e3 * take.offset_sigma_s
    return Interval(offset_ms - half, offset_ms + half, "take")


def _draws(covariance: Floats | None, count: int, rng: np.random.Generator) -> Floats:
    if covariance is None:
        return np.zeros((count, 6))
    return rng.multivariate_normal(np.zeros(6), covariance, size=count, method="eigh")


def error_vectors(take: ScoredTake) -> Iterator[tuple[Key, Floats]]:
    """Aligned error vectors (n, 3), translation [mm] and rotation [deg], by metric and point.

    Raises:
        EstimationError: the take has no X, or can't be aligned.
    """
    for at in aligned(take):
        yield (TRANSLATION, at.point), MM * at.translation()
        yield (ROTATION, at.point), np.degrees(at.rotation())


def translation_errors(take: ScoredTake) -> Errors:
    """Those of translation [mm], and how they follow the motion; raises as `error_vectors` does."""
    return errors_of(take, translation_vectors)


def translation_vectors(take: ScoredTake) -> Iterator[tuple[Key, Floats]]:
    """Those of translation alone: rotations take most of the time."""
    for point, truth, estimate in take.positions():
        yield (TRANSLATION, point), MM * (align(truth, estimate).apply(estimate) - truth)


def rotation_vectors(take: ScoredTake) -> Iterator[tuple[Key, Floats]]:
    """Those of rotation alone."""
    for at in aligned(take):
        yield (ROTATION, at.point), np.degrees(at.rotation())


def _model(
    error: Floats, followed: Floats, derivatives: Sequence[Floats], bins: Ints
) -> ErrorModel:
    """Of error vectors (n, 3), what of them follows the motion (n, 3), their derivatives (n, 3) by
    each part of X, and the bin of each (n,).
    """
    motion = _binned(_dots(followed, followed), bins)
    noise = _binned(error - followed, bins)
    k = len(derivatives)
    quadratic = np.empty((len(motion), k, k))
    for i in range(k):
        for j in range(i, k):
            quadratic[:, i, j] = _binned(_dots(derivatives[i], derivatives[j]), bins)
            quadratic[:, j, i] = quadratic[:, i, j]
    linear = [_binned(_dots(error, derivative), bins) for derivative in derivatives]
    return ErrorModel(
        constant=_binned(_dots(error, error), bins),
        linear=2.0 * np.stack(linear, axis=1),
        quadratic=quadratic,
        motion=motion - motion.mean(),
        block=max(block_length(axis) for axis in noise.T),
    )


def _dots(a: Floats, b: Floats) -> Floats:
    """The products (n,) of vectors (n, 3)."""
    products: Floats = np.einsum("nc,nc->n", a, b)
    return products


def _binned(values: Floats, bins: np.ndarray) -> Floats:
    """Means (b, ...) of values (n, ...) over their bins (n,)."""
    count = np.bincount(bins)
    flat = values.reshape(len(values), -1)
    sums = np.stack([np.bincount(bins, column) for column in flat.T], axis=1)
    return (sums / count[:, None]).reshape(len(count), *values.shape[1:])
