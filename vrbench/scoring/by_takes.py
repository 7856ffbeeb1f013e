"""Intervals of what no model of a take's errors tells: by how the takes of a case scatter."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import get_args

import numpy as np

from vrbench.results.tables import Member, Row
from vrbench.statistics.bootstrap import Statistic, scope_of
from vrbench.statistics.of_takes import drawn_takes, interval_of_takes

STATISTICS = get_args(Statistic)
# Variant, band and segment of what has an interval.
PLAIN = "main", "all", "all"


def by_takes(
    pooled: Sequence[Row],
    rows: Sequence[Row],
    places: Mapping[Member, tuple[str, str]],
    modelled: Collection[tuple[str, str]],
    rng: np.random.Generator,
) -> list[Row]:
    """The pooled rows, those that have one with their interval by the scatter of takes.

    Where there are too few takes for it to speak for more than themselves there is none: so few
    scatter by chance alone as if they were alike.

    Args:
        pooled: over all takes of a case and condition.
        rows: of each of these takes.
        places: sitting and mount of each take, by its mount and repeat.
        modelled: metrics and points whose intervals models tell.
        rng: where the randomness comes from.
    """
    of = list(places.values())
    if scope_of(of) == "take":
        return list(pooled)
    drawn = drawn_takes(of, rng)
    own = {(row.mount, row.repeat, *_what(row)): row for row in rows if _plain(row)}
    found = []
    for row in pooled:
        parts = [own.get((member[0], member[1], *_what(row))) for member in places]
        known = [(part.value, part.samples) for part in parts if part and part.value is not None]
        modelled_too = (row.metric, row.point) in modelled
        if not _plain(row) or modelled_too or row.value is None or len(known) < len(parts):
            found.append(row)
            continue
        values, samples = np.array(known, dtype=np.float64).T
        statistic: Statistic = "rmse" if row.statistic == "rmse" else "mean"
        interval = interval_of_takes(values, samples, drawn, of, statistic)
        found.append(
            replace(row, ci_low=interval.low, ci_high=interval.high, ci_scope=interval.scope)
        )
    return found


def _plain(row: Row) -> bool:
    return (row.variant, row.band, row.segment) == PLAIN and row.statistic in STATISTICS


def _what(row: Row) -> tuple[str, str, str]:
    return row.metric, row.point, row.statistic
