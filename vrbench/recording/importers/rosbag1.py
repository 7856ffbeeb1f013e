"""ROS 1 bags (format 2.0), read without ROS."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from vrbench.recording.bags import BagKind, BagOptions, read_bag
from vrbench.recording.importer import Imported, Importer


def _open(path: Path) -> AbstractContextManager[Any]:
    from rosbags.rosbag1 import Reader

    return Reader(path)


KIND = BagKind(
    name="ROS 1",
    open=_open,
    cdr=False,
    fix="`rosbag reindex` mends a bag that was cut short or never closed",
)


def read(path: Path, options: BagOptions) -> Imported:
    """The poses of one topic of a bag; see `vrbench.recording.bags.read_bag`."""
    return read_bag(path, options, KIND)


IMPORTER = Importer(
    name="rosbag1",
    title="ROS 1 bag: PoseStamped, PoseWithCovarianceStamped, TransformStamped or Odometry",
    read=read,
    options=BagOptions,
)
