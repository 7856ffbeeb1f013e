"""A layout with which Foxglove and Lichtblick show a run's takes: paths, positions, events."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vrbench.recording.take import pose_topic

# Blue, vermillion and green of Okabe and Ito, which the colour-blind tell apart.
COLOURS = ("#0072b2", "#d55e00", "#009e73")
NAME = "vrbench.layout.json"


def write_layout(streams: Sequence[str], folder: Path) -> Path:
    """Writes the layout for takes with these pose streams, `headset/eye` and others."""
    path = folder / NAME
    path.write_text(json.dumps(layout(streams), indent=2), encoding="utf-8")
    return path


def layout(streams: Sequence[str]) -> dict[str, Any]:
    """The layout: one plot an axis, all poses in space, and what happened."""
    topics = [pose_topic(stream) for stream in streams]
    panels: dict[str, Any] = {"3D!space": _space(topics), "RawMessages!events": _events()}
    panels |= {f"Plot!{axis}": _plot(axis, topics) for axis in "xyz"}
    plots = _column("Plot!x", _column("Plot!y", "Plot!z", 50), 100 / 3)
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row",
            "first": _column("3D!space", "RawMessages!events", 75),
            "second": plots,
            "splitPercentage": 45,
        },
    }


def _column(first: Any, second: Any, percentage: float) -> dict[str, Any]:
    return {
        "direction": "column",
        "first": first,
        "second": second,
        "splitPercentage": round(percentage, 2),
    }


def _space(topics: Sequence[str]) -> dict[str, Any]:
    """Poses as axes. The headset's world and the reference's frame are shown as one."""
    return {
        "foxglovePanelTitle": "Poses",
        "followMode": "follow-none",
        "scene": {"transforms": {"editable": True}},
        "cameraState": {"perspective": True, "distance": 3, "phi": 60, "thetaOffset": 45},
        "layers": {
            "grid": {"layerId": "foxglove.Grid", "visible": True, "size": 4, "divisions": 8}
        },
        "topics": {topic: {"visible": True, "type": "axis", "axisScale": 0.2} for topic in topics},
    }


def _plot(axis: str, topics: Sequence[str]) -> dict[str, Any]:
    return {
        "foxglovePanelTitle": f"position {axis} (m)",
        "paths": [
            {
                "value": f"{topic}.pose.position.{axis}",
                "label": topic,
                "enabled": True,
                "timestampMethod": "headerStamp",
                "color": COLOURS[k % len(COLOURS)],
            }
            for k, topic in enumerate(topics)
        ],
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showLegend": axis == "x",
        "legendDisplay": "floating",
        "isSynced": True,
        "xAxisVal": "timestamp",
    }


def _events() -> dict[str, Any]:
    return {"foxglovePanelTitle": "Events", "topicPath": "/events", "diffEnabled": False}
