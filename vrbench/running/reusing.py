"""Reusing the calibration of an earlier run, where nobody has touched the headset since."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from vrbench.config.suite import Suite
from vrbench.errors import ConfigError
from vrbench.results.bundle import Bundle
from vrbench.results.record import RECORD, RunRecord, TakeRecord, utc_now
from vrbench.running.resuming import ended, whole
from vrbench.trajectory import NS


@dataclass(frozen=True, slots=True)
class Reused:
    """The calibrations that ended an earlier run.

    Attributes:
        run: which run.
        takes: its takes, by the names of the takes that they stand for.
    """

    run: Bundle
    takes: Mapping[str, TakeRecord]

    def enter(self, bundle: Bundle) -> None:
        """Copies the takes into a new run, as those that open its first mount."""
        for name, take in self.takes.items():
            path = bundle.take_path(name)
            shutil.copyfile(self.run.folder / take.file, path)
            told = {"file": f"takes/{path.name}", "mount": 1, "repeat": 1}
            origin = f"{self.run.folder.name}/{take.name}"
            bundle.add(take.model_copy(update={**told, "origin": origin}))


def reused(folder: Path, suite: Suite, record: RunRecord, inputs: Mapping[str, str]) -> Reused:
    """The calibrations of an earlier run that a new one may begin with.

    Args:
        folder: the earlier run.
        suite: what is to be run.
        record: what the new run says of itself.
        inputs: the texts of the suite and the rig it will keep.

    Raises:
        ConfigError: no complete run is there, it was made with something else, it is too old, it
            doesn't end with the calibrations of this suite, or the headset was touched since.
    """
    bundle = Bundle.open(folder)
    for what, fix in _differences(bundle, record, inputs):
        raise ConfigError(
            f"the run has another {what}", file=folder / RECORD, field="--calibration", fix=fix
        )
    mount = max((take.mount for take in bundle.record.takes), default=1)
    if bundle.record.kind == "simulated" and mount > 1:
        raise _unfit(folder, "its simulated headset was fixed anew", "a run of one mount")
    takes = {}
    for step in suite.schedule():
        if step.case.role == "calibration" and (step.mount, step.repeat) == (1, 1):
            takes[step.name] = _closing(bundle, suite, step.case.id, mount)
    if not takes:
        raise _unfit(folder, f"suite {suite.label} has no calibration", "leave it out")
    for take in _may_tell_of_hands(bundle, takes.values()):
        if any(event.kind == "occlusion" for event in bundle.columns(take).events):
            told = f"hands were at its headset: cameras are covered in {take.name}"
            raise _unfit(folder, told, "a run that ends with a calibration, uncovered")
    age_s = 0.0
    if bundle.record.kind != "simulated":
        age_s = utc_now().timestamp() - (ended(bundle) or 0) / NS
    if age_s > suite.gate.max_age:
        told = f"it is {age_s / 60:.0f} min old, the gate is {suite.gate.max_age / 60:g} min"
        raise _unfit(folder, told, "calibrate anew")
    return Reused(bundle, takes)


def _may_tell_of_hands(bundle: Bundle, closing: Iterable[TakeRecord]) -> Iterator[TakeRecord]:
    """The closing calibrations, and what was recorded after the first of them.

    What hands did before, a real calibration has measured; a simulated headset's next run doesn't
    know of it, so there every take counts.
    """
    takes = [take for take in bundle.record.takes if take.status != "skipped"]
    first = min(takes.index(take) for take in closing)
    yield from takes if bundle.record.kind == "simulated" else takes[first:]


def _closing(bundle: Bundle, suite: Suite, case: str, mount: int) -> TakeRecord:
    """The last take of a calibration in the run's last mount."""
    motion = suite.motion(suite.case(case).motion)
    found = [
        take
        for take in bundle.record.takes
        if (take.case, take.role, take.mount) == (case, "calibration", mount)
        and take.motion_digest == motion.digest
        and whole(bundle, take)
    ]
    if not found:
        told = f"it has no whole calibration {case!r} by {motion.name}"
        raise _unfit(bundle.folder, told, "a run that ends with this suite's calibration")
    return max(found, key=lambda take: take.repeat)


def _differences(
    bundle: Bundle, record: RunRecord, inputs: Mapping[str, str]
) -> Iterator[tuple[str, str]]:
    """What isn't as in the earlier run, and what to do."""
    old, calibrate = bundle.record, "calibrate with what is measured now"
    if old.kind != record.kind:
        yield f"kind of rig: {old.kind}, not {record.kind}", calibrate
    rig = bundle.folder / "rig.yaml"
    if not rig.is_file() or rig.read_text(encoding="utf-8") != inputs["rig.yaml"]:
        yield "rig", calibrate
    if old.seed != record.seed:
        yield f"seed: {old.seed}, not {record.seed}", f"--seed {old.seed}"


def _unfit(folder: Path, what: str, fix: str) -> ConfigError:
    return ConfigError(what, file=folder, field="--calibration", fix=fix)
