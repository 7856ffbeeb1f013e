"""Quest headsets for vrbench: profiles, the live route of the Unity logger, importers of logs.

Only the hooks stand here; what they return is imported when they are called, so that listing
plugins stays quick.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from vrbench.plugin import hookimpl

if TYPE_CHECKING:
    from vrbench.devices.specs import HeadsetSpec
    from vrbench.recording.importer import Importer


@hookimpl
def vrbench_headsets() -> Sequence[HeadsetSpec]:
    """Quest 2, Quest Pro, Quest 3, Quest 3S; the route `quest`."""
    from vrbench_quest.profiles import HEADSETS
    from vrbench_quest.route import HEADSET

    return [*HEADSETS, HEADSET]


@hookimpl
def vrbench_importers() -> Sequence[Importer]:
    """The formats `quest-unity-csv` and `quest-vrbench-csv`."""
    from vrbench_quest import unity_log, vrbench_log

    return [unity_log.IMPORTER, vrbench_log.IMPORTER]
