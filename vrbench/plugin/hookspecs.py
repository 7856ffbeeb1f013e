"""The hooks a plugin may implement. Hooks return things; they have no life cycle."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import pluggy

if TYPE_CHECKING:
    from vrbench.devices.specs import HeadsetSpec, MocapSpec, RobotSpec
    from vrbench.metrics.registry import Family
    from vrbench.recording.importer import Importer

PLUGIN_API = 1
hookspec = pluggy.HookspecMarker("vrbench")
hookimpl = pluggy.HookimplMarker("vrbench")


@hookspec
def vrbench_headsets() -> Sequence[HeadsetSpec]:  # type: ignore[empty-body]
    """Headset models, and routes by which headsets send poses."""


@hookspec
def vrbench_mocap() -> Sequence[MocapSpec]:  # type: ignore[empty-body]
    """Motion-capture systems."""


@hookspec
def vrbench_robots() -> Sequence[RobotSpec]:  # type: ignore[empty-body]
    """Robots."""


@hookspec
def vrbench_importers() -> Sequence[Importer]:  # type: ignore[empty-body]
    """File formats that hold poses."""


@hookspec
def vrbench_metrics() -> Sequence[Family]:  # type: ignore[empty-body]
    """Metric families."""


@hookspec
def vrbench_suites() -> Sequence[Path]:  # type: ignore[empty-body]
    """Suite files, each named as the suite is."""
