"""A metric family's rows of a take: its numbers, or why there are none."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from vrbench.cache.stages import family_code
from vrbench.errors import EstimationError
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.protocols.calibration import Verdict
from vrbench.results.record import TakeRecord
from vrbench.results.tables import Row
from vrbench.scoring.rules import Rules


def family_rows(
    rules: Rules,
    take: TakeRecord,
    family: Family,
    part: ScoredTake,
    verdict: Verdict,
    *,
    kept_as: str | None = None,
) -> list[Row]:
    """A family's rows. One that fails, a plugin's perhaps, costs its own rows and no others.

    `kept_as` says which part of the take this is, for what is computed once; None to compute it.
    """
    if family.of_take is None:
        return []
    try:
        compute = partial(_values, family, part)
        of = rules.reference, take.name, str(kept_as)
        name, code = f"metric {family.name}", family_code(family)
        once = kept_as is not None
        values = rules.stages.kept(name, compute, *of, code=code) if once else compute()
    except EstimationError as error:
        verdict, values = Verdict("skipped", str(error)), list(absent_values([family]))
    except Exception as error:
        why = f"metric {family.name} failed: {type(error).__name__}: {error}"
        verdict, values = Verdict("failed", why), list(absent_values([family]))
    return [rules.row(take, value, verdict) for value in values]


def _values(family: Family, part: ScoredTake) -> list[Value]:
    assert family.of_take is not None
    values = [replace(value, segment=part.segment) for value in family.of_take(part)]
    odd = next((v for v in values if v.value is not None and not np.isfinite(v.value)), None)
    if odd is not None:
        raise ValueError(f"{odd.metric} {odd.statistic} is {odd.value}")
    return values


def absent_values(families: Sequence[Family]) -> Iterator[Value]:
    """One value without a number for each metric, to carry the reason."""
    for family in families:
        if family.of_take is not None:
            for metric, unit in family.units.items():
                yield Value(metric, "value", None, unit, 0)
