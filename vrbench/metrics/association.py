"""Association: which pose of one trajectory belongs to which of another, by nearest stamp."""

from __future__ import annotations

import numpy as np

from vrbench.errors import EstimationError
from vrbench.geometry import Floats, Ints


def nearest(t: Floats, others: Floats, max_diff: float) -> tuple[Ints, Ints]:
    """For each stamp the nearest of the others, where one is near enough.

    Of two equally near the earlier is taken, of equal stamps the last (or the last but one,
    where they end the others and equal the stamp looked for). One of the others may be taken more
    than once.

    Args:
        t: stamps (n,) [s].
        others: stamps (m,) [s], in any order.
        max_diff: largest difference [s], inclusive.

    Returns:
        Indices (k,) into `t`, increasing, and indices (k,) into `others`.
    """
    if len(t) == 0 or len(others) == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    order = np.argsort(others, kind="stable")
    ordered = others[order]
    last = len(ordered) - 1
    left = np.clip(np.searchsorted(ordered, t, side="right") - 1, 0, max(last - 1, 0))
    right = np.minimum(left + 1, last)
    to_left, to_right = np.abs(ordered[left] - t), np.abs(ordered[right] - t)
    # Beyond the end only equal stamps can tie, and the last of them is taken.
    found = np.where(
        (to_left <= to_right) & (t <= ordered[last]) | (to_left < to_right), left, right
    )
    keep = np.flatnonzero(np.minimum(to_left, to_right) <= max_diff)
    return keep, order[found[keep]]


def associate(
    t_reference: Floats, t_estimate: Floats, max_diff: float = 0.01, offset: float = 0.0
) -> tuple[Ints, Ints]:
    """Pairs of poses of a reference and an estimate, as evo's `associate_trajectories` has them.

    The shorter trajectory is walked through, the estimate when both are of equal length.

    Args:
        t_reference: stamps (n,) [s].
        t_estimate: stamps (m,) [s].
        max_diff: largest difference of the stamps of a pair [s].
        offset: added to the estimate's stamps [s].

    Returns:
        Indices (k,) into the reference and indices (k,) into the estimate.

    Raises:
        EstimationError: no stamps are near enough.
    """
    if len(t_estimate) > len(t_reference):
        reference, estimate = nearest(t_reference, t_estimate + offset, max_diff)
    else:
        estimate, reference = nearest(t_estimate, t_reference - offset, max_diff)
    if len(reference) == 0:
        raise EstimationError(
            f"none of {len(t_reference)} and {len(t_estimate)} stamps lie within {max_diff:g} s of"
            " each other",
            fix="check that both run on one clock, or allow a larger difference",
        )
    return reference, estimate
