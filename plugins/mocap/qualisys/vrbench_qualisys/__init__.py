"""Qualisys for vrbench: QTM as a reference, live, and the 6DOF files it exports.

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
    """QTM, live."""
    from vrbench_qualisys.live import QUALISYS

    return [QUALISYS]


@hookimpl
def vrbench_importers() -> Sequence[Importer]:
    """The format `qtm-6d-tsv`."""
    from vrbench_qualisys.tsv import IMPORTER

    return [IMPORTER]
