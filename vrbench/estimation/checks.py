"""What every estimator asks of a trajectory before it starts."""

from __future__ import annotations

import numpy as np

from vrbench.errors import EstimationError
from vrbench.geometry import Floats, Transform
from vrbench.trajectory import Trajectory


def require_poses(trajectory: Trajectory, name: str, minimum: int) -> None:
    """At least `minimum` poses, all finite.

    Raises:
        EstimationError: too few poses, or a value that is not finite.
    """
    if len(trajectory) < minimum:
        raise EstimationError(
            f"only {len(trajectory)} poses", field=name, fix=f"at least {minimum} are needed"
        )
    require_finite(trajectory.pose, name)


def require_finite(pose: Transform, name: str) -> None:
    """Positions and quaternions without NaN or infinity, quaternions of unit length.

    Raises:
        EstimationError: naming the first pose that is not so.
    """
    require_finite_rows(pose.p, name, "position")
    require_finite_rows(pose.q, name, "quaternion")
    length = np.einsum("ij,ij->i", pose.q, pose.q)
    bad = np.flatnonzero(np.abs(length - 1.0) > 1e-6)
    if len(bad):
        raise EstimationError(
            f"quaternion of pose {bad[0] + 1} has length {np.sqrt(length[bad[0]]):.6g}",
            field=name,
            fix="unit quaternions, order x y z w",
        )


def require_finite_rows(values: Floats, name: str, kind: str) -> None:
    """Values (n, k) without NaN or infinity.

    Raises:
        EstimationError: naming the first row that holds one.
    """
    finite = np.isfinite(values)
    if not finite.all():
        bad = np.flatnonzero(~finite.all(axis=1))
        raise EstimationError(
            f"{kind} of pose {bad[0] + 1} is not finite ({len(bad)} such poses)",
            field=name,
            fix="leave out the poses that were not tracked",
        )
