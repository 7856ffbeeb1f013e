"""What comes with vrbench, registered as any plugin registers it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from vrbench.plugin.hookspecs import hookimpl

if TYPE_CHECKING:
    from vrbench.devices.specs import HeadsetSpec, MocapSpec, RobotSpec
    from vrbench.metrics.registry import Family
    from vrbench.recording.importer import Importer


@hookimpl
def vrbench_headsets() -> Sequence[HeadsetSpec]:
    from vrbench.devices.simulated.headset import HEADSET

    return [HEADSET]


@hookimpl
def vrbench_mocap() -> Sequence[MocapSpec]:
    from vrbench.devices.simulated.mocap import MOCAP

    return [MOCAP]


@hookimpl
def vrbench_robots() -> Sequence[RobotSpec]:
    from vrbench.devices.simulated.robot import ROBOT

    return [ROBOT]


@hookimpl
def vrbench_importers() -> Sequence[Importer]:
    from vrbench.recording.importers import builtin_importers

    return builtin_importers()


@hookimpl
def vrbench_metrics() -> Sequence[Family]:
    from vrbench.metrics.registry import builtin_families

    return builtin_families()


@hookimpl
def vrbench_suites() -> Sequence[Path]:
    from vrbench.config.shipped import shipped_files

    return list(shipped_files("suites").values())
