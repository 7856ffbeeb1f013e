"""OpenCV's five hand-eye methods, which vrbench's own is compared with."""

from __future__ import annotations

import numpy as np

from vrbench.errors import EstimationError
from vrbench.geometry import Transform, quat_to_matrix

METHODS = ("tsai", "park", "horaud", "andreff", "daniilidis")
# They compare every pose with every other: 3000 poses take half a minute and 5 GB.
MAX_POSES = 300


def opencv_handeye(T_base_tcp: Transform, T_world_eye: Transform, method: str) -> Transform:
    """X = `T_tcp_eye` from poses (n,) at the same times, of which at most 300 are used, evenly.

    Args:
        T_base_tcp: the robot's poses (n,).
        T_world_eye: the headset's poses (n,).
        method: one of `METHODS`.

    Raises:
        ValueError: another method.
        EstimationError: OpenCV isn't there, lacks these methods (as its 5.0 does), or finds no
            rotation.
    """
    if method not in METHODS:
        raise ValueError(f"method {method!r}: one of {', '.join(METHODS)}")
    try:
        import cv2
    except ImportError:
        raise EstimationError(
            "OpenCV isn't installed", fix="pip install 'opencv-python-headless>=4.9,<5'"
        ) from None
    if not hasattr(cv2, "calibrateHandEye"):
        raise EstimationError(
            f"OpenCV {cv2.__version__} has no hand-eye calibration", fix="install a 4.x of it"
        )
    chosen = slice(None, None, max(1, -(-len(T_base_tcp) // MAX_POSES)))
    tcp, world = T_base_tcp[chosen], T_world_eye[chosen].inverse()
    # By keyword: given by position, OpenCV takes the method for something else and runs Tsai's.
    rotation, translation = cv2.calibrateHandEye(
        list(quat_to_matrix(tcp.q)),
        list(tcp.p),
        list(quat_to_matrix(world.q)),
        list(world.p),
        method=getattr(cv2, f"CALIB_HAND_EYE_{method.upper()}"),
    )
    matrix = np.column_stack((rotation, translation))
    if not np.isfinite(matrix).all():
        raise EstimationError(f"OpenCV's {method} finds no X of these poses")
    return Transform.from_matrix(matrix)
