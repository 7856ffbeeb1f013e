"""Trajectories: poses stamped in int64 nanoseconds, in strictly increasing time."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

from vrbench.errors import DataError
from vrbench.geometry import (
    Bools,
    Floats,
    Ints,
    Transform,
    continuous_signs,
    quat_normalize,
    relative_angle,
    slerp,
)
from vrbench.number_text import read_plain

NS = 1_000_000_000
# Longer intervals than this many periods are missing samples, shorter ones are jitter.
LATE_PERIODS = 1.5
QUATERNION_TOLERANCE = 1e-2
MAX_GAP_PERIODS = 2.5
"""Stamps further apart than so many usual steps have a gap between them."""
EXACT_S = 1e6
"""Below this, seconds in float64 tell nanoseconds apart: they are 0.12 ns from one to the next."""
LATEST_S = 2**63 / NS
"""Stamps lie within int64 nanoseconds of 0: the year 2262 in epoch time [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """A moving frame.

    Attributes:
        t: stamps (n,) [ns], int64, strictly increasing.
        pose: `T_parent_child` at those times (n,).
    """

    t: Ints
    pose: Transform

    def __post_init__(self) -> None:
        if len(self.t) != len(self.pose):
            raise ValueError(f"{len(self.t)} stamps for {len(self.pose)} poses")
        if np.any(np.diff(self.t) <= 0):
            raise ValueError("stamps must increase strictly")

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, index: Any) -> Trajectory:
        return Trajectory(self.t[index], self.pose[index])

    @property
    def duration_s(self) -> float:
        """From the first to the last stamp [s]."""
        return float(self.t[-1] - self.t[0]) / NS if len(self) else 0.0

    @property
    def period_s(self) -> float:
        """The median interval between stamps [s]."""
        return float(np.median(np.diff(self.t))) / NS

    def seconds(self, origin_ns: int) -> Floats:
        """Stamps (n,) as float64 [s] after an integer origin: epoch seconds would lose digits."""
        return seconds_since(self.t, origin_ns)

    def between(self, start_ns: int, end_ns: int) -> Trajectory:
        """The part with start <= t <= end."""
        return self[
            np.searchsorted(self.t, start_ns) : np.searchsorted(self.t, end_ns, side="right")
        ]

    def mapped(self, f: Callable[[Transform], Transform]) -> Trajectory:
        """The same stamps with poses f(pose)."""
        return Trajectory(self.t, f(self.pose))

    def at(self, t: Ints) -> Transform:
        """Poses at the times t (m,) [ns] within the trajectory: linear in p, slerp in q."""
        left, right, u = around = self._around(t)
        q = slerp(self.pose.q[left], self.pose.q[right], u)
        return Transform(self._between(*around), q)

    def position_at(self, t: Ints) -> Floats:
        """Positions (m, 3) at the times t (m,) [ns] within the trajectory: linear."""
        return self._between(*self._around(t))

    def _between(self, left: Ints, right: Ints, u: Floats) -> Floats:
        return self.pose.p[left] + u[:, None] * (self.pose.p[right] - self.pose.p[left])

    def _around(self, t: Ints) -> tuple[Ints, Ints, Floats]:
        """The samples before and after times t (m,) [ns], and how far t is from one to the next."""
        last = len(self) - 1
        left = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, max(last - 1, 0))
        right = np.minimum(left + 1, last)
        return left, right, (t - self.t[left]) / np.maximum(self.t[right] - self.t[left], 1)

    def covers(self, t: Ints, max_gap_ns: float) -> Bools:
        """Where the times t (m,) lie between two stamps that are at most max_gap_ns apart."""
        if len(self) < 2:
            return np.zeros(len(t), dtype=bool)
        left = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self) - 2)
        inside = (t >= self.t[0]) & (t <= self.t[-1])
        return inside & (self.t[left + 1] - self.t[left] <= max_gap_ns)

    def speed(self) -> Floats:
        """Speeds (n - 1,) [m/s] between neighbouring samples."""
        return np.linalg.norm(np.diff(self.pose.p, axis=0), axis=1) / self._steps_s()

    def angular_speed(self) -> Floats:
        """Angular speeds (n - 1,) [rad/s] between neighbouring samples."""
        return relative_angle(self.pose.q[:-1], self.pose.q[1:]) / self._steps_s()

    def _steps_s(self) -> Floats:
        return np.diff(self.t) / NS


def distinct(t: Ints) -> Ints:
    """Stamps (n,) in order, each once. np.unique hashes them, slower where they are in order."""
    t = np.sort(t, kind="stable")
    return t[np.concatenate(([True], t[1:] != t[:-1]))[: len(t)]]


@dataclass(frozen=True, slots=True, eq=False)
class Stamped:
    """Poses as a file has them, for comparison with tools that take them so.

    Attributes:
        t: stamps (n,) [s], float64, in any order, equal ones too.
        pose: `T_parent_child` (n,); the quaternions of any length.
    """

    t: Floats
    pose: Transform

    def __len__(self) -> int:
        return len(self.t)


def seconds_since(t: Ints, origin_ns: int) -> Floats:
    """Stamps [ns] as float64 seconds after an integer origin [ns]."""
    return (t - np.int64(origin_ns)) / NS


def read_tum(path: Path) -> Trajectory:
    """A TUM file: rows `t x y z qx qy qz qw` (s, m), `#` comments.

    Raises:
        DataError: no such file, no rows, a row of another shape, a value that isn't finite, a
            quaternion far from unit length, stamps that do not increase.
    """
    t, p, q = tum_columns(path)
    return checked_trajectory(t, p, q, path)


def tum_columns(path: Path) -> tuple[Ints, Floats, Floats]:
    """Stamps (n,) [ns], positions (n, 3) [m] and quaternions (n, 4) of a TUM file, unchecked.

    Raises:
        DataError: no such file, no rows, a row of another shape.
    """
    rows = _tum_rows(path)
    return _stamps(path, rows[:, 0]), rows[:, 1:4], rows[:, 4:8]


def read_tum_as_written(path: Path) -> Stamped:
    """A TUM file with its stamps as float64 seconds, in the order of its rows.

    Raises:
        DataError: no such file, no rows, a row of another shape, a value that isn't finite.
    """
    rows = _tum_rows(path)
    bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))
    if len(bad):
        raise DataError(f"pose {bad[0] + 1} holds a value that is not finite", file=path)
    return Stamped(rows[:, 0], Transform(rows[:, 1:4], rows[:, 4:8]))


def _tum_rows(path: Path) -> Floats:
    """The numbers (n, 8) of a TUM file, its stamps within int64 nanoseconds."""
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*input contained no data")
            rows = read_plain(path, 8)
            if rows is None:
                rows = np.loadtxt(path, comments="#", ndmin=2, encoding="utf-8-sig")
    except OSError as error:
        raise DataError("can't be read", file=path, fix=str(error)) from error
    except ValueError as error:
        raise DataError(
            "is not TUM text", file=path, fix=f"each row is `t x y z qx qy qz qw`; {error}"
        ) from error
    if rows.size == 0:
        raise DataError("holds no poses", file=path, fix="each row is `t x y z qx qy qz qw`")
    if rows.shape[1] != 8:
        raise DataError(f"rows have {rows.shape[1]} columns", file=path, fix="TUM rows have 8")
    bad = np.flatnonzero(~(np.abs(rows[:, 0]) < LATEST_S))
    if len(bad):
        raise DataError(f"stamp of pose {bad[0] + 1} is {rows[bad[0], 0]:g} s", file=path)
    return rows


def _stamps(path: Path, seconds: Floats) -> Ints:
    """A TUM file's stamps (n,) [ns], exact: from the text where float64 seconds lose digits."""
    if np.abs(seconds).max() < EXACT_S:
        return np.rint(seconds * NS).astype(np.int64)
    text = np.loadtxt(path, dtype=object, comments="#", usecols=0, ndmin=1, encoding="utf-8-sig")
    return np.array([round(Decimal(stamp) * NS) for stamp in text.tolist()], dtype=np.int64)


def checked_poses(p: Floats, q: Floats, *, file: Path, row: str = "pose") -> Transform:
    """Poses (n,) of positions (n, 3) [m] and quaternions (n, 4) that `file` claims.

    Raises:
        DataError: a value that isn't finite, a quaternion far from unit length.
    """
    for name, values in (("position", p), ("quaternion", q)):
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if len(bad):
            raise DataError(f"{name} of {row} {bad[0] + 1} is not finite", file=file)
    with np.errstate(over="ignore"):  # a length past all numbers is refused just below
        length = np.linalg.norm(q, axis=1)
    bad = np.flatnonzero(np.abs(length - 1.0) > QUATERNION_TOLERANCE)
    if len(bad):
        raise DataError(
            f"quaternion of {row} {bad[0] + 1} has length {length[bad[0]]:.4g}",
            file=file,
            fix="unit quaternions, order x y z w",
        )
    return Transform(p, quat_normalize(q))


def checked_trajectory(t: Ints, p: Floats, q: Floats, file: Path) -> Trajectory:
    """A trajectory of stamps (n,), positions (n, 3), quaternions (n, 4) that `file` claims.

    Raises:
        DataError: as `checked_poses`, and stamps that don't increase.
    """
    pose = checked_poses(p, q, file=file)
    bad = np.flatnonzero(np.diff(t) <= 0)
    if len(bad):
        raise DataError(
            f"stamps do not increase at pose {bad[0] + 2} ({len(bad)} such places)",
            file=file,
            fix="sort the rows and remove duplicates",
        )
    return Trajectory(t, Transform(pose.p, continuous_signs(pose.q)))


def write_tum(trajectory: Trajectory, path: Path) -> None:
    """A file of TUM text."""
    path.write_text(tum_text(trajectory), encoding="utf-8")


def tum_text(trajectory: Trajectory) -> str:
    """TUM text: stamps with nine decimals, exact; values to the last digit."""
    lines = (
        f"{'-' * (t < 0)}{abs(t) // NS}.{abs(t) % NS:09d} " + " ".join(map(repr, (*p, *q)))
        for t, p, q in zip(
            trajectory.t.tolist(),
            trajectory.pose.p.tolist(),
            trajectory.pose.q.tolist(),
            strict=True,
        )
    )
    return "\n".join(lines) + "\n"
