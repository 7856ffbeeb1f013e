"""A body's markers, wherever it is."""

import numpy as np

from vrbench.geometry import quat_to_matrix


def markers_of(shape, pose):
    """Where markers (k, 3) of a body are at poses (n,): (n, k, 3)."""
    return np.einsum("nij,kj->nki", quat_to_matrix(pose.q), shape) + pose.p[:, None]
