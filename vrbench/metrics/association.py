"""Association: which pose of one trajectory belongs to which of another, by nearest stamp."""

from __future__ import annotations

import numpy as np

from vrbench.errors import EstimationError
from vrbench.geometry import Floats, Ints


def nearest(t: Floats, others: Floats, max_diff: float) -> tuple[Ints, Ints]:
    """For each stamp the nearest of the others, where one is near enough; as evo finds it.

    Of two equally near the earlier is taken, of equal stamps the last (or the last but one, where
    they end the others and equal the stamp looked for). Where the others are in no order, it is
    the first of all equally near. One of the others may be taken more than once.

    Args:
        t: stamps (n,) [s].
        others: stamps (m,) [s], in any order.
        max_diff: largest difference [s], inclusive.

    Returns:
        Indices (k,) into `t`, increasing, and indices (k,) into `others`.
    """
    if len(t) == 0 or len(others) == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    if np.all(np.diff(others) >= 0):
        found = _nearest_in_order(t, others, max_diff)
    else:
        found = _nearest_in_disorder(t, others, max_diff)
    keep = np.flatnonzero(found >= 0)
    return keep, found[keep]


def _nearest_in_order(t: Floats, others: Floats, max_diff: float) -> Ints:
    """Indices (n,) into others, which increase; -1 where none is near enough.

    Sums and differences are taken as evo takes them: at 1.7e9 s they are rounded to 0.24 us, and
    a stamp at the very edge is in or out by that.
    """
    above = np.minimum(np.searchsorted(others, t, side="right"), len(others) - 1)
    to_above = others[above] - t
    to_below = np.where(above > 0, t - others[np.maximum(above - 1, 0)], np.inf)
    within = (t >= others[0] - max_diff) & (t <= others[-1] + max_diff)
    take_above = within & (to_above <= max_diff) & (to_above < to_below)
    take_below = within & (to_below <= max_diff) & (to_below <= to_above)
    return np.where(take_above, above, np.where(take_below, above - 1, -1))


def _nearest_in_disorder(t: Floats, others: Floats, max_diff: float) -> Ints:
    """Indices (n,) into others, in any order; -1 where none is near enough."""
    order = np.argsort(others, kind="stable")
    ordered = others[order]
    below = np.maximum(np.searchsorted(ordered, t, side="right") - 1, 0)
    above = np.minimum(below + 1, len(ordered) - 1)
    # of equal stamps the first in the file, which a stable sort leaves in front
    first = order[np.searchsorted(ordered, ordered, side="left")]
    to_below, to_above = np.abs(ordered[below] - t), np.abs(ordered[above] - t)
    tied = np.minimum(first[below], first[above])
    found = np.where(to_below < to_above, first[below], first[above])
    found = np.where(to_below == to_above, tied, found)
    return np.where(np.minimum(to_below, to_above) <= max_diff, found, -1)


def associate(t_reference: Floats, t_estimate: Floats, max_diff: float = 0.01) -> tuple[Ints, Ints]:
    """Pairs of poses of a reference and an estimate, as evo's `associate_trajectories` has them.

    The shorter trajectory is walked through, the estimate when both are of equal length.

    Args:
        t_reference: stamps (n,) [s].
        t_estimate: stamps (m,) [s].
        max_diff: largest difference of the stamps of a pair [s].

    Returns:
        Indices (k,) into the reference and indices (k,) into the estimate.

    Raises:
        EstimationError: no stamps are near enough.
    """
    if len(t_estimate) > len(t_reference):
        reference, estimate = nearest(t_reference, t_estimate, max_diff)
    else:
        estimate, reference = nearest(t_estimate, t_reference, max_diff)
    if len(reference) == 0:
        raise EstimationError(
            f"none of {len(t_reference)} and {len(t_estimate)} stamps lie within {max_diff:g} s of"
            " each other",
            fix="check that both run on one clock, or allow a larger difference",
        )
    return reference, estimate
