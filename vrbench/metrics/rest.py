"""Stretches of rest: seconds in which the reference didn't move, found by themselves."""

from __future__ import annotations

import numpy as np

from vrbench.geometry import (
    Floats,
    Ints,
    quat_conjugate,
    quat_multiply,
    quat_to_rotvec,
)
from vrbench.trajectory import NS, Trajectory

SLOT_NS = NS
# A motion capture at rest scatters by 0.1 mm and 0.05 deg; its means over half a second stand still
# ten times better. Slow motion would pass for jitter, so it is held to the latter.
SCATTER_M, SCATTER_RAD = 2e-4, np.radians(0.1)
CREEP_M, CREEP_RAD = 5e-5, np.radians(0.02)
MIN_SAMPLES = 8


def slot_of(t: Ints, start: int) -> Ints:
    """The second (n,) after `start` [ns] in which each stamp lies."""
    return (t - start) // SLOT_NS


def rest_slots(reference: Trajectory) -> Ints:
    """The numbers of the seconds, counted from the first stamp, that the reference rests through.

    At rest, positions and rotations scatter little about their means, and the means of both halves
    of the second agree.
    """
    if len(reference) == 0:
        return np.zeros(0, dtype=np.int64)
    start = int(reference.t[0])
    slot = slot_of(reference.t, start)
    rest = np.bincount(slot) >= MIN_SAMPLES
    half = slot_of(2 * (reference.t - start), 0)
    for values, scatter, creep in (
        (reference.pose.p - reference.pose.p[0], SCATTER_M, CREEP_M),
        (turns_within(reference.pose.q, slot), SCATTER_RAD, CREEP_RAD),
    ):
        means = slot_means(values, half, 2 * len(rest))
        moved = np.linalg.norm(means[1::2] - means[::2], axis=1)
        square = np.sum(deviations(values, slot) ** 2, axis=1)
        rms = np.sqrt(slot_means(square[:, None], slot, len(rest))[:, 0])
        rest &= (rms <= scatter) & (moved <= creep)
    return np.flatnonzero(rest)


def turns_within(q: Floats, slot: Ints) -> Floats:
    """Rotation vectors (n, 3) [rad] of each pose from the first of its slot; `slot` ascends."""
    first = np.searchsorted(slot, slot, side="left")
    return quat_to_rotvec(quat_multiply(quat_conjugate(q[first]), q))


def slot_means(values: Floats, slot: Ints, slots: int) -> Floats:
    """Means (slots, k) of values (n, k) in each slot; nought where there are none."""
    count = np.maximum(np.bincount(slot, minlength=slots), 1)
    sums = [np.bincount(slot, weights=column, minlength=slots) for column in values.T]
    return np.stack(sums, axis=1) / count[:, None]


def deviations(values: Floats, slot: Ints) -> Floats:
    """Values (n, k) less the mean of their slot."""
    return values - slot_means(values, slot, int(slot.max()) + 1)[slot] if len(slot) else values
