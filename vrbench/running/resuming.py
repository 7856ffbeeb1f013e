"""Going on with a run that was interrupted: whether it may be, and what of it is left to do."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from vrbench.config.suite import Step
from vrbench.errors import ConfigError
from vrbench.recording.recorder import SETTLE_S
from vrbench.recording.take import read_take
from vrbench.results.bundle import Bundle
from vrbench.results.files import file_digest
from vrbench.results.record import RECORD, RunRecord, TakeRecord, utc_now
from vrbench.trajectory import NS


def resumed(folder: Path, record: RunRecord, inputs: Mapping[str, str]) -> Bundle:
    """The run that stands in a folder, to be gone on with.

    Args:
        folder: where it is.
        record: what a new run would say of itself.
        inputs: the texts of the suite and the rig it would keep.

    Raises:
        ConfigError: no run is there, or it was begun with something else.
    """
    bundle = Bundle.begun(folder)
    for what, before, now in _differences(bundle, record, inputs):
        raise ConfigError(
            f"the run was begun with another {what}: {before}; now it is {now}",
            file=folder / RECORD,
            field="--resume",
            fix="go on with what it was begun with, or begin a new run",
        )
    bundle.record.resumed.append(utc_now().isoformat())
    return bundle


def _differences(
    bundle: Bundle, record: RunRecord, inputs: Mapping[str, str]
) -> Iterator[tuple[str, str, str]]:
    """What is not as it was: its name, what it was, what it is."""
    old = bundle.record
    if old.kind != record.kind:
        yield "kind of rig", old.kind, record.kind
    if old.suite_digest != record.suite_digest:
        yield "suite", _suite(old), _suite(record)
    if (bundle.folder / "rig.yaml").read_text(encoding="utf-8") != inputs["rig.yaml"]:
        yield "rig", "that of its rig.yaml", "different"
    if old.plans != record.plans:
        yield "set of plans", _short(old.plans), _short(record.plans)
    if old.seed != record.seed:
        yield "seed", str(old.seed), str(record.seed)
    for name in sorted({*old.versions, *record.versions}):
        before, now = (x.versions.get(name, "not there") for x in (old, record))
        if before != now:
            yield f"version of {name}", before, now


def _suite(record: RunRecord) -> str:
    return f"{record.suite['suite']}@{record.suite['version']} {record.suite_digest[:12]}"


def _short(plans: str | None) -> str:
    return "none" if plans is None else plans[:12]


def whole(bundle: Bundle, take: TakeRecord) -> bool:
    """Whether a take stands there as it was recorded."""
    path = bundle.folder / take.file
    return take.status == "ok" and path.is_file() and file_digest(path) == take.sha256


def left(bundle: Bundle, steps: Sequence[Step]) -> tuple[list[Step], int]:
    """What is still to be recorded, and the mount that the headset is fixed in now.

    A mount that was ended can't be had again: what failed in it stays failed.
    """
    takes = {take.name: take for take in bundle.record.takes}
    done = [step for step in steps if step.name in takes]
    mount = max((step.mount for step in done), default=1)
    todo = [
        step
        for step in steps
        if step.mount >= mount
        and not (
            step.name in takes
            and (takes[step.name].status == "skipped" or whole(bundle, takes[step.name]))
        )
    ]
    return todo, mount


def ended(bundle: Bundle) -> int | None:
    """When the last whole take ended [ns], recorder's clock; None where there is none."""
    last = None
    for take in bundle.record.takes:
        if whole(bundle, take):
            rest = [e.t for e in read_take(bundle.folder / take.file).events if e.kind == "phase"]
            last = max(last or 0, max(rest) + round(SETTLE_S * NS))
    return last
