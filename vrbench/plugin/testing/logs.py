"""What is wrong with a log that doesn't fit the reference beside it: a unit, or an order."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import permutations, product

import numpy as np

from vrbench.geometry import Floats, Transform
from vrbench.plugin.testing.stamps import told_unit
from vrbench.plugin.testing.twist import UNITS
from vrbench.streams import Samples
from vrbench.trajectory import NS

# Whether samples fit what is beside them.
Fits = Callable[[Samples], bool]


def mistake(samples: Samples, beside: Samples, fits: Fits) -> str | None:
    """What would have to be done to samples so that they fit, in a sentence; None: unknown.

    Args:
        samples: of the log, as its importer read them.
        beside: the stream that it belongs to.
        fits: tries them.
    """
    lasted = float(np.ptp(beside.pose_t)) / NS
    if told := told_unit(samples.pose_t, lasted):
        return told
    for told, metres in UNITS.items():
        if told and fits(replace(samples, pose=Transform(samples.pose.p * metres, samples.pose.q))):
            return f"it fits if its positions are{told.removeprefix(',')}"
    for q in _reordered(samples.pose.q):
        if fits(replace(samples, pose=Transform(samples.pose.p, q))):
            return "it fits if its quaternions are in the order w x y z, and were read as x y z w"
    return None


def _reordered(q: Floats) -> Iterator[Floats]:
    """Quaternions (n, 4) that were read in the wrong order and then turned to other axes, undone.

    Another convention's axes are a signed permutation, of which only the proper rotation P tells in
    a quaternion (v, w): it is (P v, w). Which one it was, isn't known here.
    """
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        p = np.eye(3)[list(order)] * np.array(signs)[:, None]
        if np.linalg.det(p) > 0.0:
            w, x, y = (q[:, :3] @ p).T
            v = np.stack([x, y, q[:, 3]], axis=1) @ p.T
            yield np.column_stack([v, w])
