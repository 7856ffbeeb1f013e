"""What an importer of recorded files must offer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from vrbench.geometry import CONVENTIONS, Floats, Transform
from vrbench.streams import Samples


class NoOptions(BaseModel):
    """An importer whose format needs no telling."""

    model_config = ConfigDict(extra="forbid")


class AxesOptions(NoOptions):
    """A format that doesn't say which way its axes point.

    Attributes:
        axes: `openxr` (WebXR and ARKit too), `unity`, `unreal` or `ros`; taken as they are where
            not given, which is right for a robot, and for a headset where y is up.
    """

    axes: Literal["openxr", "unity", "unreal", "ros"] | None = Field(
        None, description="whose convention the file's axes follow; as they are where not given"
    )

    def to_openxr(self, pose: Transform) -> Transform:
        """Poses of the file, in OpenXR's convention."""
        return CONVENTIONS[self.axes or "openxr"].to_openxr(pose)


@dataclass(frozen=True, slots=True, eq=False)
class Imported:
    """What a file gave.

    Attributes:
        samples: its poses, in vrbench's conventions.
        repairs: what was mended or left out, a sentence each; kept in the take and shown.
        markers: where the body's markers sit, from its pivot (k, 3) [m], y up; None where the file
            doesn't say. A calibration made with others isn't used for the take.
    """

    samples: Samples
    repairs: tuple[str, ...] = ()
    markers: Floats | None = None


@dataclass(frozen=True, slots=True)
class Importer:
    """A file format that holds poses.

    Attributes:
        name: what recordings files call it in `format`.
        title: what it is, for people.
        read: the file's poses, given the path and validated options; raises DataError.
        options: a pydantic model of the format's further keys, `extra="forbid"`.
    """

    name: str
    title: str
    read: Callable[[Path, Any], Imported]
    options: type[BaseModel] = NoOptions
