"""Recordings that exist already: which file is which stream of which case."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from vrbench.config.rig import Accuracy
from vrbench.config.strict import Strict
from vrbench.config.suite import Name
from vrbench.config.yaml_file import load_model

STREAMS = ("headset", "robot", "mocap")
# A further log of the robot, `robot_paper`: a reference only where a protocol asks for it.
OTHER_ROBOT = re.compile(r"robot_[a-z0-9]+")


class Source(BaseModel):
    """A file and its format; all further keys are the importer's options.

    Attributes:
        format: an importer, as `vrbench plugin list` names it.
        path: relative to this file, or to the dataset's folder.
    """

    model_config = ConfigDict(extra="allow", frozen=True)

    format: str
    path: Path

    @property
    def options(self) -> dict[str, Any]:
        return dict(self.model_extra or {})


class DeviceFacts(Strict):
    """What the recordings were made with.

    Attributes:
        headset: the model that is ranked.
        firmware: of the headset.
        logger: what logged its poses.
        logger_version: of it.
        prediction: how far ahead poses are, and by whom.
    """

    headset: Name
    firmware: str = "unknown"
    logger: str = "unknown"
    logger_version: str = "unknown"
    prediction: str = "unknown"


class RecordedTake(Strict):
    """One take: its place in the suite, and a file for each stream.

    Fields `robot_NAME` are further logs of the robot: they are gathered in `other_robots`.

    Attributes:
        case: which of the suite.
        mount: the n-th fixing of the headset, from 1.
        repeat: the n-th time in that mount, from 1.
        motion: what was replayed: the same name for the same motion, by which results compare.
        speed: of the motion, 1 as it was made.
        world: the headset's world frame: takes of a mount with the same name are known to share it,
            for nothing recentred in between.
        headset: its log.
        robot: its log, which counts as truth.
        mocap: its log, which counts as truth.
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
    other_robots: dict[str, Source] = Field(default_factory=dict)

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


class Recordings(Strict):
    """A recordings file.

    Attributes:
        suite: a suite's name, or the path of its file.
        dataset: a published dataset that paths are relative to.
        lab: who made them, as leaderboards print it.
        device: what they were made with.
        sitting: one lab visit without a power cycle; another visit, another name.
        licence: under which they may be used; a person's motion needs one.
        consent: how the person agreed to that.
        accuracy: of the references, and who says so.
        takes: which file is which stream of which case.
    """

    suite: str
    dataset: Name | None = None
    lab: str = Field(min_length=1)
    device: DeviceFacts
    sitting: str = "1"
    licence: str | None = None
    consent: str | None = None
    accuracy: dict[Literal["robot", "mocap"], Accuracy] = Field(default_factory=dict)
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
