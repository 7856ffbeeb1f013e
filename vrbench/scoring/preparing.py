"""Takes made ready to be scored: with what the others of their mount found, whole and by epoch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from vrbench.clocks import Skew
from vrbench.errors import EstimationError
from vrbench.geometry import Floats, Ints, Transform
from vrbench.metrics.scored import ScoredTake
from vrbench.protocols.calibration import Calibration, mean_skew, mean_x
from vrbench.protocols.fixing import Fixing, fixing_at
from vrbench.protocols.protocol import (
    HEADSET,
    headset_samples,
    recorded_span,
    reference_samples,
)
from vrbench.protocols.sitting import in_sitting
from vrbench.protocols.stretches import spans, without
from vrbench.results.record import TakeRecord
from vrbench.scoring.rules import Rules
from vrbench.streams import Columns


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """A take as it is scored.

    Attributes:
        whole: the take as a whole,
        parts: and by epoch, `all` where there is one: ready, or why it isn't.
        x_covariance: of the X it is scored with.
        span: when it was recorded, first and last, by the recorder's clock [ns].
        fixing: what X is taken from.
    """

    whole: ScoredTake
    parts: Mapping[str, ScoredTake | str]
    x_covariance: Floats | None
    span: tuple[int, int]
    fixing: Fixing

    @property
    def ready(self) -> dict[str, ScoredTake]:
        """The parts that could be made ready."""
        return {name: part for name, part in self.parts.items() if isinstance(part, ScoredTake)}


def prepared(
    rules: Rules, take: TakeRecord, columns: Columns, calibrations: Mapping[str, Calibration]
) -> Prepared:
    """A take made ready with what the others of its mount found.

    Raises:
        EstimationError: the streams can't be synchronised.
        DataError: a stream is missing.
    """
    span = recorded_span(columns, rules.reference)
    bracket_m = rules.suite.gate.bracket
    fixing = fixing_at(list(calibrations.values()), rules.checks, span[0], bracket_m)
    fixing = fixing.without(take.name)
    x, covariance = _mounting(rules, columns, fixing.best)
    skew = mean_skew(fixing.best)
    whole, parts = _prepared(rules, take, columns, x, covariance, skew)
    parts = {
        name: in_sitting(part, fixing.best, span[0]) if isinstance(part, ScoredTake) else part
        for name, part in parts.items()
    }
    return Prepared(whole, parts, covariance, span, fixing)


def _mounting(
    rules: Rules, columns: Columns, others: Sequence[Calibration]
) -> tuple[Transform | None, Floats | None]:
    """X and its covariance (6, 6), as far as they are known."""
    if rules.protocol.given_x is not None:
        return rules.protocol.given_x(columns), None
    return mean_x(others) if others else (None, None)


def _prepared(
    rules: Rules,
    take: TakeRecord,
    columns: Columns,
    x: Transform | None,
    covariance: Floats | None,
    skew: Skew | None,
) -> tuple[ScoredTake, dict[str, ScoredTake | str]]:
    """The take as a whole, and by epoch: each ready, or why it isn't."""
    case = rules.case(take)
    anchor_s = case.anchor
    epochs = headset_samples(columns).epochs
    several = len(epochs) > 1
    # No one world spans several epochs, so as a whole such a take has no X to be compared by.
    whole = rules.protocol.prepare(
        columns, rules.reference, None if several else x, anchor_s=anchor_s, skew=skew
    )
    left_out = excluded(rules, take, columns)
    if not several:
        whole = replace(without(whole, left_out), x_covariance=covariance)
        return whole, {"all": whole}
    parts: dict[str, ScoredTake | str] = {}
    for epoch in epochs:
        segment = f"epoch:{epoch}"
        try:
            part = rules.protocol.prepare(_epoch(columns, epoch), rules.reference, x, skew=skew)
            part = without(part, left_out)
            parts[segment] = replace(part, segment=segment, x_covariance=covariance)
        except EstimationError as error:
            parts[segment] = str(error)
    return whole, parts


def excluded(rules: Rules, take: TakeRecord, columns: Columns) -> list[Ints]:
    """The spans (k, 2) [ns] of a take that its case declares not to be scored."""
    reference = reference_samples(columns, rules.reference)
    return [spans(columns, kind, reference) for kind in rules.case(take).exclude]


def _epoch(columns: Columns, epoch: int) -> Columns:
    samples = headset_samples(columns)
    return replace(columns, poses={**columns.poses, HEADSET: samples[samples.epoch == epoch]})
