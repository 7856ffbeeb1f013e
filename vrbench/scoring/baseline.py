"""Compares conditions with the baseline, second by second of the motion."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from vrbench.errors import EstimationError
from vrbench.metrics.registry import Value
from vrbench.results.phases import PhaseRow
from vrbench.results.tables import STATUSES, Row
from vrbench.scoring.cases import Scored
from vrbench.scoring.rules import Rules
from vrbench.statistics.paired import Phases, paired_difference

VARIANT = "vs-baseline"
# What is compared: each with its unit.
COMPARED = {
    (f"ape.{kind}.aligned", point): unit
    for kind, unit in (("translation", "mm"), ("rotation", "deg"))
    for point in ("eye", "tcp")
}


def baseline_rows(
    rules: Rules, groups: Mapping[tuple[str, str], Sequence[Scored]], phases: Sequence[PhaseRow]
) -> Iterator[Row]:
    """By how much the rmse under each condition is above that under the baseline.

    Paired by bins of 1 s of the motion; mounts and repeats are clusters. None for suites that don't
    say `compare: paired`.

    Args:
        rules: of the run.
        groups: its scored takes, by case and condition.
        phases: their errors by phase.
    """
    base = rules.suite.baseline
    if rules.suite.compare is None or base is None or "ape" not in {f.name for f in rules.families}:
        return
    for (case, condition), group in groups.items():
        if group[0].take.role != "scored" or condition == base or (case, base) not in groups:
            continue
        first, second = (_errors(rules, phases, case, of) for of in (condition, base))
        both = [one.verdict for one in (*group, *groups[case, base])]
        worst = min(both, key=lambda verdict: STATUSES.index(verdict.status))
        rng = rules.rng(case, condition, VARIANT)
        for (metric, point), unit in COMPARED.items():
            value = Value(metric, "rmse", None, unit, 0, point=point, variant=VARIANT)
            row = rules.row(group[0].take, value, worst).over("mount", "repeat")
            row = replace(row, status=worst.status)
            if worst.status in ("failed", "skipped"):
                yield row
            else:
                yield _compared(row, first[metric, point], second[metric, point], rng)


def _compared(
    row: Row, first: Sequence[Phases], second: Sequence[Phases], rng: np.random.Generator
) -> Row:
    """The row with the difference of two runs, or why there is none."""
    try:
        found = paired_difference(first, second, rng)
    except EstimationError as error:
        if row.status == "invalid":
            return row
        return replace(row, status="skipped", reason=str(error))
    return replace(
        row,
        value=found.value,
        ci_low=found.low,
        ci_high=found.high,
        ci_scope=found.scope,
        samples=found.bins,
        reason="; ".join(reason for reason in (row.reason, found.reason) if reason),
    )


def _errors(
    rules: Rules, phases: Sequence[PhaseRow], case: str, condition: str
) -> dict[tuple[str, str], list[Phases]]:
    """The errors of each take of a case and condition, by metric and point."""
    takes: dict[tuple[str, str, int, int], list[PhaseRow]] = defaultdict(list)
    for row in phases:
        if (row.case, row.condition, row.reference) == (case, condition, rules.reference):
            takes[row.metric, row.point, row.mount, row.repeat].append(row)
    found: dict[tuple[str, str], list[Phases]] = defaultdict(list)
    for (metric, point, mount, _), rows in takes.items():
        found[metric, point].append(
            Phases(
                np.array([row.phase for row in rows]),
                np.array([row.mean for row in rows]),
                np.array([row.mean_square for row in rows]),
                mount=str(mount),
                sitting=rules.record.sitting,
            )
        )
    return found
