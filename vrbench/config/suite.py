"""Suites: what to run and report, versioned and free of devices."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, model_validator

from vrbench.config.quantity import Angle, Duration, Fraction, Length
from vrbench.config.shipped import find_file
from vrbench.config.yaml_file import line_of, load_yaml, validate
from vrbench.errors import ConfigError

Name = Annotated[str, StringConstraints(pattern=r"^[a-z0-9][a-z0-9_-]*$")]
Need = Literal["x", "clock", "y"]
Statistic = Literal["rmse", "mean", "median", "std", "min", "max", "p95", "value"]
# The condition of a take where the suite has none.
DEFAULT = "default"


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Case(_Strict):
    """One motion of a suite, and how it is to be run."""

    id: Name
    motion: Name
    role: Literal["calibration", "scored"] = "scored"
    repeats: int = Field(1, ge=1, le=1000)
    remounts: int = Field(0, ge=0, le=100)
    speed: float = Field(1.0, ge=0.05, le=10.0)
    needs: tuple[Need, ...] = ()
    anchor: Duration | None = Field(None, gt=0.0)


class Gate(_Strict):
    """What a calibration must satisfy for the takes of its mount to count."""

    handeye_translation: Length = Field(0.015, alias="handeye.translation", gt=0.0)
    handeye_rotation: Angle = Field(math.radians(0.5), alias="handeye.rotation", gt=0.0)
    max_age: Duration = Field(3600.0, gt=0.0)
    bracket: Length = Field(0.001, gt=0.0)


class Rank(_Strict):
    """The one number devices are ranked by."""

    metric: str
    point: Literal["eye", "tcp", "body"] = "eye"
    statistic: Statistic = "rmse"
    min_coverage: Fraction = Field(0.95, ge=0.0, le=1.0)


class Suite(_Strict):
    """A suite, with all it extends resolved into it."""

    suite: Name
    version: int = Field(ge=1)
    title: str
    mover: Literal["robot", "person", "none"] = "robot"
    references: tuple[Literal["robot", "mocap"], ...] = Field(("robot",), min_length=1)
    motions: dict[Name, str]
    cases: tuple[Case, ...] = Field(min_length=1)
    metrics: tuple[str, ...] = Field(min_length=1)
    gate: Gate = Gate()
    rank: Rank
    # what follows where the headset or the motion capture is lost in a take; a robot's loss ends it
    on_loss: Literal["stop", "continue"] = "stop"

    @model_validator(mode="after")
    def _consistent(self) -> Suite:
        ids = [case.id for case in self.cases]
        twice = {name for name in ids if ids.count(name) > 1}
        if twice:
            raise ValueError(f"two cases are called {', '.join(sorted(twice))}: an id each")
        for case in self.cases:
            if case.role == "calibration" and case.repeats > 1:
                raise ValueError(f"case {case.id} is a calibration, run first and last: no repeats")
            if case.motion not in self.motions:
                known = ", ".join(self.motions)
                raise ValueError(f"case {case.id} moves by {case.motion!r}: motions has {known}")
            if "x" in case.needs and not self.calibrations:
                raise ValueError(f"case {case.id} needs x: give a case with role calibration")
        return self

    @property
    def label(self) -> str:
        """Name and version, `gameplay-replay@1`."""
        return f"{self.suite}@{self.version}"

    @property
    def calibrations(self) -> tuple[Case, ...]:
        return tuple(case for case in self.cases if case.role == "calibration")

    def case(self, name: str) -> Case:
        """The case of this id.

        Raises:
            ConfigError: the suite has no such case.
        """
        for case in self.cases:
            if case.id == name:
                return case
        known = ", ".join(case.id for case in self.cases)
        raise ConfigError(
            f"suite {self.label} has no case {name!r}", field="case", fix=f"there are {known}"
        )

    def canonical(self) -> dict[str, Any]:
        """The suite in JSON's types and SI units, as bundles keep it.

        What has its default is left out, so that a knob added later moves no released suite.
        """
        return self.model_dump(mode="json", by_alias=True, exclude_defaults=True)

    @property
    def digest(self) -> str:
        """sha256 of the resolved suite as canonical JSON, titles left out."""
        content = {key: value for key, value in self.canonical().items() if key != "title"}
        text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
        return sha256(text.encode()).hexdigest()

    def schedule(self) -> Iterator[Step]:
        """What is recorded, in order: each mount is opened and closed by the calibrations."""
        scored = [case for case in self.cases if case.role == "scored"]
        for mount in range(1, 2 + max(case.remounts for case in self.cases)):
            for case in self.calibrations:
                yield Step(case, mount, 1)
            for case in scored:
                if mount <= case.remounts + 1:
                    for repeat in range(1, case.repeats + 1):
                        yield Step(case, mount, repeat)
            for case in self.calibrations:
                yield Step(case, mount, 2)


@dataclass(frozen=True, slots=True)
class Step:
    """One take that a suite asks for."""

    case: Case
    mount: int
    repeat: int

    @property
    def name(self) -> str:
        return take_name(self.case.id, DEFAULT, self.mount, self.repeat)


def take_name(case: str, condition: str, mount: int, repeat: int) -> str:
    """What a take is called: `<case>.<condition>.m<mount>.r<repeat>`."""
    return f"{case}.{condition}.m{mount}.r{repeat}"


def load_suite(
    name: str, others: dict[str, Path] | None = None, beside: Path | None = None
) -> Suite:
    """A suite by path, by name, or by name and version, `gameplay-replay@1`.

    Args:
        name: the path or name.
        others: suite files of plugins, by name.
        beside: the folder that a relative path starts from; the working directory where None.

    Raises:
        ConfigError: no such suite or version, or the file is wrong.
    """
    is_path = ((beside or Path()) / name).is_file()
    bare, _, version = (name, "", "") if is_path else name.partition("@")
    path = find_file("suites", bare, others, beside)
    suite = _resolve(path, others or {}, ())
    if version and str(suite.version) != version:
        raise ConfigError(
            f"version {version} is not there",
            file=path,
            field="version",
            fix=f"it is {suite.label}",
        )
    return suite


def _resolve(path: Path, others: dict[str, Path], below: tuple[Path, ...]) -> Suite:
    content, root = load_yaml(path)
    if "extends" not in content:
        return validate(content, Suite, path, root)
    file = f"{path}{line_of(root, ['extends'])}"
    if path in below:
        raise ConfigError(
            "extends itself", file=file, field="extends", fix="extend a suite that is complete"
        )
    name, _, version = str(content.pop("extends")).partition("@")
    try:
        base_path = find_file("suites", name, others, path.parent)
    except ConfigError as error:
        raise ConfigError(error.what, file=file, field="extends", fix=error.fix) from None
    base = _resolve(base_path, others, (*below, path))
    if str(base.version) != version:
        raise ConfigError(
            f"there is no {name}@{version or '?'}",
            file=file,
            field="extends",
            fix=f"name the version that is there: {base.label}",
        )
    suite = validate({**base.canonical(), **content}, Suite, path, root)
    if suite.label == base.label:
        raise ConfigError(
            f"is called {suite.label}, as the suite it extends",
            file=f"{path}{line_of(root, ['suite'])}",
            field="suite",
            fix="give it a name or a version of its own",
        )
    return suite
