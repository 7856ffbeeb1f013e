"""Bundles whose truth is known, with empty takes: what a leaderboard reads, and nothing more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from vrbench.config.suite import Suite
from vrbench.results.bundle import Bundle
from vrbench.results.phases import PhaseRow, write_phases
from vrbench.results.record import DeviceRecord, OcclusionRecord, RunRecord, TakeRecord
from vrbench.results.tables import Row, pool, write_rows
from vrbench.statistics.bootstrap import scope_of

PROTOCOL = "vrbench-1"
PHASES = 116
SUITE = {
    "suite": "made-up",
    "version": 1,
    "title": "What nobody recorded",
    "motions": {"head": "shooter-1", "calibration": "saturate-1"},
    "cases": [
        {"id": "calibrate", "motion": "calibration", "role": "calibration"},
        {"id": "replay", "motion": "head", "repeats": 3, "remounts": 1},
    ],
    "metrics": ["ape"],
    "rank": {"metric": "ape.translation.aligned"},
}


def made_up(
    folder: Path,
    *,
    error: float | Mapping[str, float] = 2.0,
    rng: np.random.Generator,
    device: str = "headset-a",
    lab: str = "lab-1",
    sitting: str = "1",
    mounts: int = 2,
    repeats: int = 3,
    mount_scatter: float = 0.02,
    coverage: float = 99.5,
    epochs: int = 1,
    floor: float | None = 0.05,
    kind: str = "recorded",
    suite: Mapping[str, Any] = SUITE,
    created: str = "2026-01-01T00:00:00+00:00",
    occlusion: OcclusionRecord | None = None,
    filler: int = 0,
    all_phases: bool = False,
    **facts: str,
) -> Path:
    """A bundle of a device whose true error is `error` [mm], by condition where it is a mapping.

    Args:
        mount_scatter: standard deviation of the mounts' true errors, as a share.
        filler: further metric rows of each take, for tables as long as true ones,
        all_phases: and further errors by phase.
        facts: of the device: firmware, logger ...
    """
    resolved = Suite.model_validate(suite)
    errors = error if isinstance(error, Mapping) else {"default": error}
    hard = np.random.default_rng(1).uniform(0.5, 1.5, PHASES)  # the motion's, for every device
    hard /= np.sqrt(np.mean(hard**2))
    takes: list[TakeRecord] = []
    rows: list[Row] = []
    phases: list[PhaseRow] = []

    def row(take: TakeRecord, metric: str, statistic: str, value: float | None, **more: Any) -> Row:
        cells = {"point": "", "unit": "mm", "samples": PHASES * 72, **more}
        return Row(
            *(PROTOCOL, device, resolved.label, take.case, take.condition, sitting),
            *(str(take.mount), str(take.repeat), "all", "robot", "main", metric),
            cells.pop("point"),
            *("all", statistic, value, cells.pop("unit")),
            **cells,
        )

    for mount in range(1, mounts + 1):
        off = np.exp(rng.normal(0.0, mount_scatter))
        for condition, truth in errors.items():
            for repeat in range(1, repeats + 1):
                name = f"replay.{condition}.m{mount}.r{repeat}"
                take = TakeRecord(
                    file=f"takes/{name}.mcap",
                    sha256=sha256(f"{name} {rng.integers(2**60)}".encode()).hexdigest(),
                    case="replay",
                    condition=condition,
                    mount=mount,
                    repeat=repeat,
                    role="scored",
                    motion="shooter-1",
                    motion_digest=sha256(b"shooter-1").hexdigest(),
                )
                takes.append(take)
                square = (truth * off * hard * np.exp(rng.normal(0.0, 0.2, PHASES))) ** 2
                mean, rmse = float(np.sqrt(square).mean()), float(np.sqrt(square.mean()))
                for point in ("eye", "tcp"):
                    numbers = {"rmse": rmse, "mean": mean, "std": float(np.sqrt(square).std())}
                    numbers["max"] = float(np.sqrt(square.max()))
                    for statistic, value in numbers.items():
                        rows.append(
                            row(take, "ape.translation.aligned", statistic, value, point=point)
                        )
                    rows.append(row(take, "floor.total", "value", floor, point=point))
                    phases += (
                        PhaseRow(
                            *("replay", condition, mount, repeat, "robot"),
                            *("ape.translation.aligned", point, k),
                            *(float(np.sqrt(square[k])), float(square[k]), "mm"),
                        )
                        for k in range(PHASES)
                    )
                if all_phases:
                    more = [p for p in phases if (p.mount, p.repeat) == (mount, repeat)]
                    phases += [replace(p, metric="ape.rotation.aligned") for p in more]
                    phases += [replace(p, case="calibrate") for p in more]
                rows.append(row(take, "coverage.valid", "value", coverage, unit="%"))
                rows.append(row(take, "coverage.epochs", "count", float(epochs), unit="count"))
                rows += [row(take, f"filler.{i}", "value", 1.0) for i in range(filler)]
    for condition in errors:
        rows += _pooled(rows, [t for t in takes if t.condition == condition], sitting)
    if resolved.baseline is not None:
        rows += _changes(rows, resolved.baseline)
    record = RunRecord(
        status="complete",
        kind=kind,  # type: ignore[arg-type]
        created=created,
        suite=resolved.canonical(),
        suite_digest=resolved.digest,
        lab=lab,
        sitting=sitting,
        device=DeviceRecord(headset=device, **facts),
        references=["robot"],
        occlusion=occlusion,
        versions={"vrbench": "0"},
        takes=takes,
    )
    bundle = Bundle.create(folder, record, {})
    for take in takes:
        (folder / take.file).touch()
    write_rows(rows, folder / f"metrics/{PROTOCOL}.csv")
    write_phases(phases, folder / f"metrics/{PROTOCOL}.phase.csv")
    bundle.enter(f"metrics/{PROTOCOL}.csv", f"metrics/{PROTOCOL}.phase.csv")
    return folder


def _pooled(rows: Sequence[Row], takes: Sequence[TakeRecord], sitting: str) -> list[Row]:
    members = {(str(t.mount), str(t.repeat)): "" for t in takes}
    mine = [row for row in rows if row.condition == takes[0].condition]
    scope = scope_of([(sitting, t.mount) for t in takes])
    return [
        replace(row, ci_low=0.9 * row.value, ci_high=1.1 * row.value, ci_scope=scope)
        if row.statistic == "rmse" and row.value is not None
        else row
        for row in pool(mine, ("mount", "repeat"), members)
    ]


def _changes(rows: Sequence[Row], baseline: str) -> list[Row]:
    """By how much the pooled rmse of each condition is above that of the baseline."""
    pooled = [row for row in rows if (row.mount, row.statistic) == ("all", "rmse")]
    before = {row.point: row.value for row in pooled if row.condition == baseline}
    changes = []
    for row in pooled:
        first, second = row.value, before[row.point]
        if row.condition != baseline and first is not None and second is not None:
            change, width = first - second, 0.1 * first
            changes.append(
                replace(
                    row,
                    variant="vs-baseline",
                    value=change,
                    ci_low=change - width,
                    ci_high=change + width,
                )
            )
    return changes
