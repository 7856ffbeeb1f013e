"""Suites: what to run and report, versioned and free of devices."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import Field, PrivateAttr, model_validator

from vrbench.config.case import OPENING, Case, Condition, Name, check_case
from vrbench.config.motions import identity, is_file, motion_of
from vrbench.config.quantity import Angle, Duration, Fraction, Length
from vrbench.config.schedule import DEFAULT, Order, Step, schedule, take_name
from vrbench.config.shipped import find_file
from vrbench.config.strict import Strict
from vrbench.config.yaml_file import line_of, load_yaml, validate
from vrbench.errors import ConfigError
from vrbench.motion.motion import Motion

__all__ = ["DEFAULT", "Case", "Name", "Step", "Suite", "load_suite", "take_name"]

Statistic = Literal["rmse", "mean", "median", "std", "min", "max", "p95", "value"]


class Gate(Strict):
    """What a calibration must satisfy for the takes of its mount to count.

    Attributes:
        handeye_translation: most that it may leave: 15 mm.
        handeye_rotation: most that it may leave: 0.5 deg.
        max_age: how far in time from a take: 60 min.
        bracket: how far two calibrations of a mount may differ: 1 mm.
    """

    handeye_translation: Length = Field(0.015, alias="handeye.translation", gt=0.0)
    handeye_rotation: Angle = Field(math.radians(0.5), alias="handeye.rotation", gt=0.0)
    max_age: Duration = Field(3600.0, gt=0.0)
    bracket: Length = Field(0.001, gt=0.0)


class Rank(Strict):
    """The one number devices are ranked by.

    Attributes:
        metric: its full name, ape.translation.aligned.
        point: where errors are taken: eye, tcp or body.
        statistic: of the errors.
        min_coverage: the part of a take that must be valid: 95 %.
    """

    metric: str
    point: Literal["eye", "tcp", "body"] = "eye"
    statistic: Statistic = "rmse"
    min_coverage: Fraction = Field(0.95, ge=0.0, le=1.0)


class Suite(Strict):
    """A suite, with all it extends resolved into it.

    Attributes:
        suite: its name; its file bears it too.
        version: one more whenever motions, gate or metrics change.
        title: what it does, for people.
        mover: who moves the headset.
        references: what counts as truth, those the rig has; the first ranks.
        motions: generators or motion files, by what cases call them.
        cases: what is run.
        conditions: variations of the scored cases, one of them the baseline.
        order: of the conditions: given, or abba with the baseline first and last.
        compare: paired compares every condition with the baseline.
        metrics: families to compute, as `vrbench plugin list` names them.
        gate: what calibrations must satisfy.
        rank: the number that devices are ranked by.
        on_loss: what follows where headset or motion capture is lost; a robot's loss ends the run.
    """

    suite: Name
    version: int = Field(ge=1)
    title: str
    mover: Literal["robot", "person"] = "robot"
    references: tuple[Literal["robot", "mocap"], ...] = Field(("robot",), min_length=1)
    motions: dict[Name, str]
    cases: tuple[Case, ...] = Field(min_length=1)
    conditions: tuple[Condition, ...] = ()
    order: Order = "given"
    compare: Literal["paired"] | None = None
    metrics: tuple[str, ...] = Field(min_length=1)
    gate: Gate = Gate()
    rank: Rank
    # what follows where the headset or the motion capture is lost in a take; a robot's loss ends it
    on_loss: Literal["stop", "continue"] = "stop"
    # Where the motions that are files are, by what `motions` calls them.
    _files: dict[str, Path] = PrivateAttr(default_factory=dict)

    @model_validator(mode="after")
    def _consistent(self) -> Suite:
        _distinct([case.id for case in self.cases], "cases")
        _distinct([condition.id for condition in self.conditions], "conditions")
        for case in self.cases:
            check_case(case, self.mover)
            if case.motion not in self.motions:
                known = ", ".join(self.motions)
                raise ValueError(f"case {case.id} moves by {case.motion!r}: motions has {known}")
            if case.role == "check" and not (self.conditions and self.calibrations):
                raise ValueError(
                    f"case {case.id} checks the mount after a change of condition: "
                    "give conditions, and a case with role calibration"
                )
        _check_conditions(self.conditions, self.order, self.compare)
        for case in self.all_cases():
            check_case(case, self.mover)
            if "x" in case.needs and not self.calibrations:
                raise ValueError(f"case {case.id} needs x: give a case with role calibration")
            if case.looped and OPENING not in self.motions:
                raise ValueError(
                    f"case {case.id} repeats its motion within a take, so clocks would be found a "
                    "whole loop off: give motions an opening, a motion that is run once before"
                )
            if case.looped and self.motions[OPENING] == self.motions[case.motion]:
                raise ValueError(
                    f"case {case.id} opens with the motion that it repeats, so clocks would be "
                    "found a whole loop off: give motions another opening"
                )
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

    def case_under(self, name: str, condition: str) -> Case:
        """The case as a condition has it; raises as `case`."""
        case = self.case(name)
        of = next((c for c in self.conditions if c.id == condition), None)
        return case if of is None or case.role != "scored" else of.of(case)

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

    def all_cases(self) -> Iterator[Case]:
        """Every case as it is run: calibrations, checks, and the others under every condition."""
        for case in self.cases:
            if case.role == "scored" and self.conditions:
                yield from (condition.of(case) for condition in self.conditions)
            else:
                yield case

    def schedule(self) -> Iterator[Step]:
        """What is recorded, in order; the same every time, and in every lab."""
        return schedule(self.cases, self.conditions, self.order, self.label)

    @property
    def baseline(self) -> str | None:
        """The condition that the others are compared with."""
        return next((condition.id for condition in self.conditions if condition.baseline), None)

    def motion(self, name: str) -> Motion:
        """The motion that the suite calls so.

        Raises:
            ConfigError: there is no such generator, or its file is wrong, gone or another by now.
            DataError: its file is wrong.
        """
        return motion_of(self.motions[name], self._files)


def _distinct(ids: Sequence[str], what: str) -> None:
    twice = {name for name in ids if ids.count(name) > 1}
    if twice:
        raise ValueError(f"two {what} are called {', '.join(sorted(twice))}: an id each")


def _check_conditions(conditions: Sequence[Condition], order: Order, compare: str | None) -> None:
    if not conditions:
        for field, value in (("order", None if order == "given" else order), ("compare", compare)):
            if value is not None:
                raise ValueError(
                    f"{field} is {value}, and there are no conditions: "
                    "give conditions, one of them with baseline: true"
                )
        return
    base = [condition.id for condition in conditions if condition.baseline]
    if not base:
        raise ValueError("no condition is the baseline: give one of them baseline: true")
    if len(base) > 1:
        raise ValueError(f"{' and '.join(base)} are both the baseline: one condition is")
    if len(conditions) < 2:
        raise ValueError(f"{base[0]} is the only condition: give another to compare, or none")


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
    files = _motion_files(content, path, root)
    if "extends" not in content:
        suite = validate(content, Suite, path, root)
        suite._files.update(files)
        return suite
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
    suite._files.update({**base._files, **files})
    if suite.label == base.label:
        raise ConfigError(
            f"is called {suite.label}, as the suite it extends",
            file=f"{path}{line_of(root, ['suite'])}",
            field="suite",
            fix="give it a name or a version of its own",
        )
    return suite


def _motion_files(content: dict[str, Any], path: Path, root: yaml.Node) -> dict[str, Path]:
    """Puts into `content` what stands for the motion files it names; where each of them is."""
    files: dict[str, Path] = {}
    motions = content.get("motions")
    if not isinstance(motions, dict) or content.get("mover", "robot") != "robot":
        return files
    for name, value in motions.items():
        if isinstance(value, str) and is_file(value):
            where = f"{path}{line_of(root, ['motions', str(name)])}"
            motions[name] = identity(path.parent / value, where, f"motions.{name}")
            files[motions[name]] = path.parent / value
    return files
