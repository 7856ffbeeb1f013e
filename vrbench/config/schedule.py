"""The order in which a suite's takes are recorded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from random import Random
from typing import Literal

from vrbench.config.case import Case, Condition

# The condition of a take where the suite has none.
DEFAULT = "default"
Order = Literal["given", "abba", "shuffled"]


@dataclass(frozen=True, slots=True)
class Step:
    """One take that a suite asks for.

    Attributes:
        case: as its condition has it.
        mount: the n-th fixing of the headset, from 1.
        repeat: the n-th take of the case under its condition in this mount, from 1.
        condition: its id; `default` where the suite has none, and for calibrations.
    """

    case: Case
    mount: int
    repeat: int
    condition: str = DEFAULT

    @property
    def name(self) -> str:
        return take_name(self.case.id, self.condition, self.mount, self.repeat)


def take_name(case: str, condition: str, mount: int, repeat: int) -> str:
    """What a take is called: `<case>.<condition>.m<mount>.r<repeat>`."""
    return f"{case}.{condition}.m{mount}.r{repeat}"


def schedule(
    cases: Sequence[Case], conditions: Sequence[Condition], order: Order, seed: str
) -> Iterator[Step]:
    """Each mount is opened and closed by the calibrations, each change of condition by the checks.

    Args:
        cases: of the suite.
        conditions: of the suite, or none.
        order: in which conditions are visited: see `visits`.
        seed: of what is shuffled; the mount counts too.
    """
    scored = [case for case in cases if case.role == "scored"]
    under: dict[str, list[Case]] = {c.id: [c.of(case) for case in scored] for c in conditions}
    if not conditions:
        under = {DEFAULT: scored}
    covered = {condition.id: condition for condition in conditions}
    everything = [*cases, *(case for group in under.values() for case in group)]
    for mount in range(1, 2 + max(case.remounts for case in everything)):
        calibrations = [case for case in cases if case.role == "calibration"]
        yield from (Step(case, mount, 1) for case in calibrations)
        count: Counter[str] = Counter()
        before = None
        for visit in visits(conditions, order, f"{seed} {mount}") or [DEFAULT]:
            here = [case for case in under[visit] if mount <= case.remounts + 1]
            checks = [case for case in cases if case.role == "check" and here and visit != before]
            for case in checks:
                count[f"{case.id} {visit}"] += 1
                level = covered[visit].occlude
                checked = case if level is None else case.model_copy(update={"occlude": level})
                yield Step(checked, mount, count[f"{case.id} {visit}"], visit)
            for case in here:
                for _ in range(case.repeats):
                    count[f"{case.id} {visit}"] += 1
                    yield Step(case, mount, count[f"{case.id} {visit}"], visit)
            before = visit
        yield from (Step(case, mount, 2) for case in calibrations)


def visits(conditions: Sequence[Condition], order: Order, seed: str) -> list[str]:
    """The conditions' ids in the order in which one mount goes through them.

    `given` is that of the file. `abba` is the baseline, the others shuffled, and all of that
    backwards, so that what drifts evenly with time is the same for all. `shuffled` is the baseline,
    the others shuffled, and the baseline again.
    """
    if order == "given":
        return [condition.id for condition in conditions]
    base = [condition.id for condition in conditions if condition.baseline]
    others = [condition.id for condition in conditions if not condition.baseline]
    Random(seed).shuffle(others)
    return [*base, *others, *(reversed(others) if order == "abba" else []), *base]
