"""TUM text: rows `t x y z qx qy qz qw`."""

from __future__ import annotations

from pathlib import Path

from vrbench.recording.importer import Imported, Importer, NoOptions
from vrbench.streams import Samples
from vrbench.trajectory import read_tum


def read(path: Path, _options: NoOptions) -> Imported:
    """The poses of a TUM file (s, m); receive time is the stamp.

    Raises:
        DataError: as `vrbench.trajectory.read_tum`.
    """
    trajectory = read_tum(path)
    return Imported(Samples.of(trajectory.t, trajectory.pose))


IMPORTER = Importer(name="tum", title="TUM text: t x y z qx qy qz qw (s, m)", read=read)
