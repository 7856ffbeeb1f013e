"""Scores takes in other ways too, so that a reader sees what those would have claimed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from vrbench.clocks import ClockMap
from vrbench.errors import DataError, EstimationError
from vrbench.geometry import Transform
from vrbench.metrics.scored import ScoredTake
from vrbench.protocols.calibration import Calibration, Verdict
from vrbench.protocols.protocol import headset_samples, recorded_span
from vrbench.protocols.stretches import without
from vrbench.results.record import TakeRecord
from vrbench.results.tables import Row
from vrbench.scoring.cases import Scored
from vrbench.scoring.family_rows import absent_values, family_rows
from vrbench.scoring.preparing import excluded
from vrbench.scoring.rules import Rules
from vrbench.streams import Columns
from vrbench.trajectory import NS

# What a headset whose clock was asked is known to be off by: its poses are on the host's clock.
ASKED = ClockMap(np.array([0], dtype=np.int64), np.array([0.0]))
# X fitted on hours is no use, and dear.
LONGEST_S = 600.0


def variant_rows(
    rules: Rules, scored: Scored, columns: Columns, calibrations: Mapping[str, Calibration]
) -> list[Row]:
    """The variants `in-sample` and `fixed-offset` of a take's APE; none of a take that failed."""
    if scored.whole is None:
        return []
    return [
        *_in_sample(rules, scored.take, columns, calibrations),
        *_fixed_offset(rules, scored.take, columns, scored.whole.x, scored.verdict),
    ]


def _in_sample(
    rules: Rules, take: TakeRecord, columns: Columns, calibrations: Mapping[str, Calibration]
) -> list[Row]:
    """APE with X fitted on this very take: better than it can truly be."""
    calibrate = rules.protocol.calibrate
    if calibrate is None:
        return []

    def prepare() -> ScoredTake:
        own = calibrations.get(take.name) or calibrate(columns, rules.reference, take.name)
        return rules.protocol.prepare(columns, rules.reference, own.x, skew=own.skew)

    return _variant(rules, take, columns, "in-sample", prepare, Verdict())


def _fixed_offset(
    rules: Rules, take: TakeRecord, columns: Columns, x: Transform | None, verdict: Verdict
) -> list[Row]:
    """APE at the clock that the headset itself told, where it was asked: prediction counts."""
    if x is None or "headset" not in columns.clocks:
        return []

    def prepare() -> ScoredTake:
        return rules.protocol.prepare(columns, rules.reference, x, measured=ASKED)

    return _variant(rules, take, columns, "fixed-offset", prepare, verdict)


def _variant(
    rules: Rules,
    take: TakeRecord,
    columns: Columns,
    name: str,
    prepare: Callable[[], ScoredTake],
    verdict: Verdict,
) -> list[Row]:
    """APE of a take made ready in another way; where it can't be, why."""
    ape = next((f for f in rules.families if f.name == "ape"), None)
    if ape is None:
        return []
    part: ScoredTake | str
    try:
        if len(headset_samples(columns).epochs) > 1:
            raise EstimationError("not computed for takes of several epochs")
        if _seconds(columns, rules.reference) > LONGEST_S:
            raise EstimationError(f"not computed for takes over {LONGEST_S / 60:g} min")
        part = without(prepare(), excluded(rules, take, columns))
    except (EstimationError, DataError) as error:
        part, verdict = str(error), Verdict("skipped", str(error))
    if isinstance(part, str):
        rows = [rules.row(take, value, verdict) for value in absent_values([ape])]
    else:
        rows = family_rows(rules, take, ape, part, verdict)
    return [replace(row, variant=name) for row in rows]


def _seconds(columns: Columns, reference: str) -> float:
    began, ended = recorded_span(columns, reference)
    return (ended - began) / NS
