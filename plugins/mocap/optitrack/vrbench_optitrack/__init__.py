"""OptiTrack for vrbench: Motive as a reference, over NatNet, and the files it exports.

Only the hooks stand here; what they return is imported when they are called, so that listing
plugins stays quick.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from vrbench.plugin import hookimpl

if TYPE_CHECKING:
    from vrbench.devices.specs import MocapSpec
    from vrbench.recording.importer import Importer


@hookimpl
def vrbench_mocap() -> Sequence[MocapSpec]:
    """Motive, live."""
    from vrbench_optitrack.client import OPTITRACK

    return [OPTITRACK]


@hookimpl
def vrbench_importers() -> Sequence[Importer]:
    """The format `motive-csv`."""
    from vrbench_optitrack.motive_csv import IMPORTER

    return [IMPORTER]
