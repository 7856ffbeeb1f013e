"""What importers check and mend, in one place; public to the authors of plugins."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from vrbench.errors import DataError
from vrbench.geometry import Floats, Ints, Transform, continuous_signs
from vrbench.recording.importer import Imported
from vrbench.streams import Samples
from vrbench.trajectory import NS, checked_poses

MAX_DROPPED = 1e-3
"""The part of a file's poses that may be dropped for their stamps; one pose always may."""
MOST_STEPS = 3
"""Stamps that go back more often aren't those of a clock that was set."""
LONGEST_GAP_S = 3600.0
"""Poses further apart in time than this aren't of one recording."""


def imported_poses(
    t: Ints,
    p: Floats,
    q: Floats,
    *,
    file: Path,
    receive_t: Ints | None = None,
    epoch: Ints | None = None,
    row: str = "pose",
    repairs: tuple[str, ...] = (),
) -> Imported:
    """What an importer returns, of the columns it has read from `file`.

    Args:
        t: stamps (n,) [ns], in the order of the file.
        p: positions (n, 3) [m], right-handed.
        q: quaternions (n, 4), xyzw, of unit length; their signs are made continuous.
        file: named in errors.
        receive_t: when each pose arrived (n,) [ns], where the file says so.
        epoch: world frame of each pose (n,), one more at every recentre; one for all where None.
        row: what one of them is called in messages: `line`, `message`; counted from 1.
        repairs: sentences on what the importer itself has mended.

    Raises:
        DataError: no poses, a value that isn't finite, a quaternion far from unit length, stamps
            that go back, or repeat with other poses, too often to be mended.
    """
    if len(t) == 0:
        raise DataError("holds no poses", file=file)
    pose = checked_poses(p, q, file=file, row=row)
    kept = np.arange(len(t))
    again = _told_again(t, p, q)
    if again.any():
        n = int(again.sum())
        many = f"{n} {row}s" if n > 1 else f"{n} {row}"
        repairs = (*repairs, f"{many} dropped, the same as the one before, stamp and pose")
        kept = kept[~again]
    keep = increasing(t[kept], file=file, row=row)
    if len(keep) < len(kept):
        repairs = (*repairs, _dropped(np.setdiff1d(np.arange(len(kept)), keep), row))
        kept = kept[keep]
    together = _together(t[kept], file=file, row=row)
    if together != slice(0, len(kept)):
        gone = len(kept) - len(kept[together])
        repairs = (*repairs, f"{gone} at an end dropped, over an hour away from all others")
        kept = kept[together]
    pose = Transform(pose.p[kept], continuous_signs(pose.q[kept]))
    samples = Samples.of(t[kept], pose, receive_t=None if receive_t is None else receive_t[kept])
    if epoch is not None:
        samples = replace(samples, epoch=epoch[kept].astype(np.uint32))
    return Imported(samples, repairs)


def with_invalid(imported: Imported, t: Ints) -> Imported:
    """The same with an invalid sample at each of the times t (n,) [ns], where a body was lost.

    It is of the epoch of the pose before it.

    A file of motion capture has a row for each frame, whether the body was seen or not; what it
    says of the others is worth keeping.
    """
    if not len(t):
        return imported
    nothing = Transform(np.zeros((len(t), 3)), np.tile([0.0, 0.0, 0.0, 1.0], (len(t), 1)))
    lost = Samples.of(t, nothing, flags=0)
    there = imported.samples
    before = np.clip(np.searchsorted(there.pose_t, t, side="right") - 1, 0, None)
    lost = replace(lost, epoch=there.epoch[before])
    both = Samples.concatenate([there, lost])
    order = np.argsort(both.pose_t, kind="stable")
    return replace(imported, samples=both[order])


def increasing(t: Ints, *, file: Path, row: str = "pose") -> npt.NDArray[np.intp]:
    """Which stamps t (n,) [ns] to keep so that they increase strictly: the most that do.

    One stamp in a thousand may go, and one in any file: a frame logged twice, two that changed
    places. More than that is a clock that was set, after which nothing is on one time scale with
    what lies before, or no recording in order.

    Raises:
        DataError: more would have to go.
    """
    steps = np.diff(t)
    if np.all(steps > 0):
        return np.arange(len(t))
    keep = _longest_increasing(t.tolist())
    dropped = len(t) - len(keep)
    if dropped > max(1.0, MAX_DROPPED * len(t)):
        back = np.flatnonzero(steps <= 0)
        raise DataError(
            f"stamps go back or repeat at {len(back)} of {len(t)} places, first at {row} "
            f"{back[0] + 2}, by up to {-int(steps.min()) / NS:.3f} s",
            file=file,
            fix=f"they must increase; one {row} in a thousand may be dropped, here {dropped}"
            f" would have to be: {_advice(steps, row)}",
        )
    return keep


def _told_again(t: Ints, p: Floats, q: Floats) -> npt.NDArray[np.bool_]:
    """Which poses (n,) are the one before once more, under the same stamp."""
    again = np.zeros(len(t), dtype=bool)
    same = np.all(p[1:] == p[:-1], axis=1) & np.all(q[1:] == q[:-1], axis=1)
    again[1:] = (np.diff(t) == 0) & same
    return again


def _advice(steps: Ints, row: str) -> str:
    """What to do about stamps, given the steps (n - 1,) [ns] between them."""
    back = int(np.sum(steps < 0))
    if not back:
        return f"one {row} a stamp: are stamps too coarse for the rate, or two bodies in one file?"
    if back <= MOST_STEPS:
        return "cut the recording where its clock was set"
    return f"sort its {row}s by time, and give each recording a file of its own"


def _together(t: Ints, *, file: Path, row: str) -> slice:
    """Which of the increasing stamps t (n,) [ns] are of one recording: all but strays at the ends.

    Raises:
        DataError: an hour or more lies between two parts of which neither is a stray.
    """
    gaps = np.flatnonzero(np.diff(t) > LONGEST_GAP_S * NS) + 1
    allowed = max(1.0, MAX_DROPPED * len(t))
    start, end = 0, len(t)
    for gap in gaps.tolist():
        if gap <= allowed:
            start = gap
        elif len(t) - gap <= allowed:
            end = min(end, gap)
        else:
            apart = (int(t[gap]) - int(t[gap - 1])) / NS
            raise DataError(
                f"{apart:.6g} s lie between {row} {gap} and the next",
                file=file,
                fix="a take is one recording: cut the file in two, or mend the stamp",
            )
    return slice(start, end)


def _longest_increasing(t: list[int]) -> npt.NDArray[np.intp]:
    """Indices of a longest strictly increasing subsequence (Fredman, 1975)."""
    ends: list[int] = []  # the least value that ends a subsequence of each length
    places: list[int] = []
    before = [-1] * len(t)
    for i, value in enumerate(t):
        k = bisect_left(ends, value)
        before[i] = places[k - 1] if k else -1
        if k == len(ends):
            ends.append(value)
            places.append(i)
        elif value < ends[k]:  # of equal stamps the first stays
            ends[k], places[k] = value, i
    chain = np.empty(len(ends), dtype=np.intp)
    i = places[-1]
    for k in range(len(ends) - 1, -1, -1):
        chain[k] = i
        i = before[i]
    return chain


def _dropped(gone: npt.NDArray[np.intp], row: str) -> str:
    many = f"{row}s" if len(gone) > 1 else row
    return (
        f"{len(gone)} {many} dropped, whose stamps repeat or go back (first: {row} {gone[0] + 1})"
    )
