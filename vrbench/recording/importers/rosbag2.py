"""ROS 2 bags: a folder with `metadata.yaml`, or one `.mcap` or `.db3` file; read without ROS."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from vrbench.recording.bags import BagKind, BagOptions, read_bag
from vrbench.recording.importer import Imported, Importer


def _open(path: Path) -> AbstractContextManager[Any]:
    from rosbags.rosbag2 import Reader

    return Reader(path)


KIND = BagKind(
    name="ROS 2",
    open=_open,
    cdr=True,
    fix="a folder with metadata.yaml, or an .mcap or .db3 file; `ros2 bag reindex` and"
    " `mcap recover` mend one that was cut short",
)


def read(path: Path, options: BagOptions) -> Imported:
    """The poses of one topic of a bag; see `vrbench.recording.bags.read_bag`."""
    return read_bag(path, options, KIND)


IMPORTER = Importer(
    name="rosbag2",
    title="ROS 2 bag: PoseStamped, PoseWithCovarianceStamped, TransformStamped or Odometry",
    read=read,
    options=BagOptions,
)
