"""Quest headsets for vrbench: profiles of three models, and the importer of their Unity log.

Only the hooks stand here; what they return is imported when they are called, so that listing
plugins stays quick.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from vrbench.plugin import hookimpl

if TYPE_CHECKING:
    from vrbench.devices.ports import HeadsetSpec
    from vrbench.recording.importer import Importer


@hookimpl
def vrbench_headsets() -> Sequence[HeadsetSpec]:
    """Quest 2, Quest Pro, Quest 3."""
    from vrbench_quest.profiles import HEADSETS

    return HEADSETS


@hookimpl
def vrbench_importers() -> Sequence[Importer]:
    """The format `quest-unity-csv`."""
    from vrbench_quest.unity_log import IMPORTER

    return [IMPORTER]
