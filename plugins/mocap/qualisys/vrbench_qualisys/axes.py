"""Rotation matrices as QTM writes them, and its axes with y up."""

from __future__ import annotations

from typing import Literal

import numpy as np

from vrbench.geometry import Z_UP, Bools, Floats, Transform, matrix_to_quat

Up = Literal["y", "z"]
DETERMINANT = 0.05
"""How far from 1 the determinant of a rotation may be: files have five decimals."""


def poses_of(position_mm: Floats, matrix: Floats) -> Transform:
    """Poses of positions (n, 3) [mm] and matrices (n, 9), column after column."""
    turns = matrix.reshape(-1, 3, 3).transpose(0, 2, 1)
    return Transform(position_mm * 1e-3, matrix_to_quat(turns))


def is_rotation(matrix: Floats) -> Bools:
    """Which of the matrices (n, 9) are rotations; a lost body has zeros or none."""
    finite: Bools = np.all(np.isfinite(matrix), axis=1)
    square = np.where(finite[:, None], matrix, 0.0).reshape(-1, 3, 3)
    turned: Bools = np.abs(np.linalg.det(square) - 1.0) < DETERMINANT
    return finite & turned


def to_y_up(pose: Transform, up: Up) -> Transform:
    """Poses (n,) with y up, in room and body."""
    return pose if up == "y" else Z_UP.to_openxr(pose)
