"""What is the same for all takes of a run, and what its gate says of one of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from zlib import crc32

import numpy as np

from vrbench.cache.stages import Stages
from vrbench.config.suite import Case, Suite
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.protocols.calibration import Calibration, Limits, Verdict, gate
from vrbench.protocols.fixing import Fixing
from vrbench.protocols.protocol import Protocol
from vrbench.results.record import RunRecord, TakeRecord
from vrbench.results.tables import Row

SUFFICIENT = ("ok", "unbracketed", "extrapolated")


@dataclass(frozen=True, slots=True)
class Rules:
    """What is the same for all takes of a run.

    Attributes:
        record: the run's.
        suite: its suite, resolved.
        families: the metrics to compute.
        protocol: how to score.
        reference: `robot`, `mocap`, or another robot's log that the protocol asks for.
        stages: what needn't be computed again.
    """

    record: RunRecord
    suite: Suite
    families: Sequence[Family]
    protocol: Protocol
    reference: str
    stages: Stages = field(default_factory=Stages)

    def row(self, take: TakeRecord, value: Value, verdict: Verdict) -> Row:
        """A value of a take as a row; what has no number says why."""
        status, reason = verdict.status, verdict.reason
        if value.value is None and status in SUFFICIENT:
            status, reason = "skipped", value.reason
        return Row(
            protocol=self.protocol.name,
            device=self.record.device.headset,
            suite=self.suite.label,
            case=take.case,
            condition=take.condition,
            sitting=self.record.sitting,
            mount=str(take.mount),
            repeat=str(take.repeat),
            segment=value.segment,
            reference=self.reference,
            variant=value.variant,
            metric=value.metric,
            point=value.point,
            band=value.band,
            statistic=value.statistic,
            value=value.value,
            unit=value.unit,
            ci_low=value.low,
            ci_high=value.high,
            ci_scope="" if value.low is None else "take",
            samples=value.samples,
            status=status,
            reason=reason,
        )

    def case(self, take: TakeRecord) -> Case:
        """The take's case, as its condition has it."""
        return self.suite.case_under(take.case, take.condition)

    @property
    def checks(self) -> frozenset[str]:
        """Names of the takes that check the mount."""
        return frozenset(take.name for take in self.record.takes if take.role == "check")

    def rng(self, *names: str) -> np.random.Generator:
        """A generator of its own for each name, the same in every evaluation."""
        return np.random.default_rng([crc32(name.encode()) for name in (self.reference, *names)])


def verdict_of(
    rules: Rules,
    take: TakeRecord,
    span: tuple[int, int],
    scored: ScoredTake,
    fixing: Fixing,
    own: Calibration | None,
    failures: Mapping[str, str],
) -> Verdict:
    """What the gate says of a take, and which calibrations it had to do without."""
    if rules.protocol.given_x is not None:
        return Verdict()
    told = "; ".join(f"{name}: {why}" for name, why in failures.items() if name != take.name)
    if not fixing.members and take.role != "scored" and not told:
        return Verdict("skipped", "no other calibration of this mount to score it with")
    if not fixing.members and told:
        return Verdict("invalid", f"no calibration of this mount succeeded: {told}")
    if not fixing.members and "x" not in rules.case(take).needs:
        return Verdict("skipped", "no calibration in this mount, and the case asks for none")
    bounds = rules.suite.gate
    limits = Limits(
        translation_m=bounds.handeye_translation,
        rotation_rad=bounds.handeye_rotation,
        max_age_s=bounds.max_age,
        bracket_m=bounds.bracket,
    )
    checks = [c for c in fixing.members if c not in fixing.best]
    verdict = gate(fixing.best, own, *span, scored.truth, limits, checks)
    notes = [verdict.reason, fixing.moved]
    if told and verdict.status != "ok":
        notes.append(f"failed: {told}")
    return Verdict(verdict.status, "; ".join(note for note in notes if note))
