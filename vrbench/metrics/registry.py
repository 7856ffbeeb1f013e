"""Metric families: what each computes, in which units, and what it needs to be computed."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from vrbench import metrics
from vrbench.metrics.scored import ScoredTake


@dataclass(frozen=True, slots=True)
class Value:
    """One number of one metric, in the unit that tables print.

    Attributes:
        metric: its full name, `ape.translation.aligned`.
        statistic: `rmse mean median std min max p95 sse value slope last-first count`.
        value: the number; None where it couldn't be had, then `reason` says why.
        unit: `mm deg ms s ppm Hz % 1 count mm/m mm/h deg/h mm/(m/s)`.
        samples: how many samples it rests on.
        point: where it was evaluated: `eye`, `tcp`, `body`, or empty.
        band: `all`, `<2Hz`, `>2Hz`.
        segment: `all`, `epoch:2`, `loop:17`.
        variant: `main`, `in-sample`, `fixed-offset`, `vs-baseline`.
        low: lower end of its interval of 95 %, over this take; None where it has none.
        high: and its upper end.
    """

    metric: str
    statistic: str
    value: float | None
    unit: str
    samples: int
    point: str = ""
    band: str = "all"
    segment: str = "all"
    variant: str = "main"
    reason: str = ""
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, slots=True)
class Family:
    """A family of metrics, as suites name it.

    Attributes:
        name: `ape`.
        title: what it tells, in a sentence.
        units: unit of each metric, by full name.
        of_take: its values for one take.
        needs: what a take must have: `x` (a calibration), `target` (the planned motion), `joints`
            (joint and controller states, which are read for nobody else).
        of_repeats: its values across the repeats of one case, condition and mount.
    """

    name: str
    title: str
    units: Mapping[str, str]
    of_take: Callable[[ScoredTake], Iterable[Value]] | None = None
    needs: frozenset[str] = field(default_factory=frozenset)
    of_repeats: Callable[[Sequence[ScoredTake]], Iterable[Value]] | None = None


def builtin_families() -> list[Family]:
    """The `FAMILY` of each module of `vrbench.metrics` that has one, by name."""
    modules = (
        importlib.import_module(f"{metrics.__name__}.{info.name}")
        for info in pkgutil.iter_modules(metrics.__path__)
    )
    families = [module.FAMILY for module in modules if hasattr(module, "FAMILY")]
    return sorted(families, key=lambda family: family.name)
