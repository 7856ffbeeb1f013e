"""Recordings that exist already: which file is which stream of which case."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from vrbench.config.rig import Accuracy
from vrbench.config.suite import Name
from vrbench.config.yaml_file import load_model

STREAMS = ("headset", "robot", "mocap")
# A further log of the robot, `robot_paper`: a reference only where a protocol asks for it.
OTHER_ROBOT = re.compile(r"robot_[a-z0-9]+")


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Source(BaseModel):
    """A file and its format; all further keys are the importer's options."""

    model_config = ConfigDict(extra="allow", frozen=True)

    format: str
    path: Path

    @property
    def options(self) -> dict[str, Any]:
        return dict(self.model_extra or {})


class DeviceFacts(_Strict):
    """What the recordings were made with."""

    headset: Name
    firmware: str = "unknown"
    logger: str = "unknown"
    logger_version: str = "unknown"
    prediction: str = "unknown"


class RecordedTake(_Strict):
    """One take: its place in the suite, and a file for each stream.

    `world` names the headset's world frame: takes of a mount with the same name are known to share
    it, for nothing recentred in between. Fields `robot_NAME` are further logs of the robot: they
    are gathered in `other_robots`.
    """

    case: Name
    mount: int = Field(1, ge=1, le=1000)
    repeat: int = Field(1, ge=1, le=1000)
    motion: str | None = None
    world: str | None = Field(None, min_length=1)
    speed: float = Field(1.0, ge=0.05, le=10.0)
    headset: Source | None = None
    robot: Source | None = None
    mocap: Source | None = None
    other_robots: dict[str, Source] = {}

    @property
    def sources(self) -> dict[str, Source]:
        """The source of each stream there is, by the stream's name."""
        own = {name: getattr(self, name) for name in STREAMS}
        return {
            name: source for name, source in own.items() if source is not None
        } | self.other_robots

    @model_validator(mode="before")
    @classmethod
    def _gather_other_robots(cls, content: Any) -> Any:
        if not isinstance(content, dict) or "other_robots" in content:
            return content
        others = {k: v for k, v in content.items() if OTHER_ROBOT.fullmatch(str(k))}
        rest = {k: v for k, v in content.items() if k not in others}
        return rest | {"other_robots": others} if others else rest

    @model_validator(mode="after")
    def _has_reference(self) -> RecordedTake:
        if self.robot is None and self.mocap is None:
            raise ValueError("no reference: give robot or mocap")
        return self


class Recordings(_Strict):
    """A recordings file."""

    suite: str
    dataset: Name | None = None
    lab: str = Field(min_length=1)
    device: DeviceFacts
    sitting: str = "1"
    licence: str | None = None
    consent: str | None = None
    accuracy: dict[Literal["robot", "mocap"], Accuracy] = {}
    takes: tuple[RecordedTake, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _distinct(self) -> Recordings:
        places = [(take.case, take.mount, take.repeat) for take in self.takes]
        for place in places:
            if places.count(place) > 1:
                raise ValueError(
                    "two takes are case {} mount {} repeat {}".format(*place)
                    + ": give each its mount and repeat"
                )
        for case in dict.fromkeys(take.case for take in self.takes):
            if len({(t.motion, t.speed) for t in self.takes if t.case == case}) > 1:
                raise ValueError(
                    f"takes of case {case} differ in motion or speed, which makes them no repeats: "
                    "write a recordings file for each"
                )
        return self


def load_recordings(path: Path) -> Recordings:
    """A recordings file.

    Raises:
        ConfigError: no such file, or the file is wrong.
    """
    return load_model(path, Recordings)
