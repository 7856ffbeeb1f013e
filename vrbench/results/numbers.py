"""What a metric table says of the takes of one case under one condition."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from vrbench.config.suite import Rank
from vrbench.results.board import FLOORED, STATISTICS, BoardKey
from vrbench.results.record import TakeRecord
from vrbench.results.selection import MetricTable
from vrbench.results.tables import DIFFERENCE, Row

Place = tuple[int, int]
# A take's number, and how many samples it rests on.
Sampled = tuple[float, int]


@dataclass(frozen=True, slots=True)
class Numbers:
    """The numbers that rank, and what stands beside them.

    Attributes:
        takes: the ranking number of each take, by mount and repeat, or the row that says why it
            has none; None where the table says nothing of the take.
        pooled: the ranking metric over all takes, by statistic.
        change: the pooled number's change against the baseline; None where there is none.
        floor: the largest noise floor among the takes; None where one of them has none, and of
            metrics that it isn't the floor of.
        coverage: the least share of valid poses [%],
        epochs: and the most world frames; None where one of the takes lacks it.
    """

    takes: dict[Place, Row | None]
    pooled: dict[str, Row]
    change: Row | None
    floor: float | None
    coverage: float | None
    epochs: float | None

    @property
    def ranking(self) -> list[Row]:
        """All rows of the ranking metric: of the takes, and of all together."""
        return [*(row for row in self.takes.values() if row), *self.pooled.values()]

    @property
    def by_take(self) -> dict[Place, Sampled]:
        """The ranking number of each take that has one."""
        return {
            place: (row.value, row.samples)
            for place, row in self.takes.items()
            if row is not None and row.value is not None
        }

    def troubled(self, status: str) -> int:
        """How many takes are of this status; `failed` are those too that nothing is said of."""
        return sum((row.status if row else "failed") == status for row in self.takes.values())


def read_numbers(
    table: MetricTable,
    key: BoardKey,
    rank: Rank,
    takes: Sequence[TakeRecord],
    *,
    change: bool,
) -> Numbers:
    """The numbers of the takes of a board's case and condition.

    Args:
        table: the run's.
        key: of the board.
        rank: what ranks there.
        takes: the takes.
        change: whether the change against the baseline is wanted too.

    Raises:
        DataError: a cell of another type.
    """

    def row(place: tuple[str, str], variant: str, number: tuple[str, str, str]) -> Row | None:
        metric, point, statistic = number
        of = (key.case, key.condition, *place)
        which = ("all", key.reference, variant, metric, point, "all", statistic)
        return table.row(of, which)

    ranking = {name: (rank.metric, rank.point, name) for name in {rank.statistic, *STATISTICS}}
    # what could not be computed has neither point nor statistic
    absent = (rank.metric, "", "value")
    places = [(str(take.mount), str(take.repeat)) for take in takes]
    own = {
        (take.mount, take.repeat): row(place, "main", ranking[rank.statistic])
        or row(place, "main", absent)
        for take, place in zip(takes, places, strict=True)
    }
    together = ("all", "all")
    whole = places[0] if len(places) == 1 else together
    pooled = {name: row(whole, "main", number) for name, number in ranking.items()}

    def extreme(
        choose: Callable[[Iterable[float]], float], metric: str, point: str, statistic: str
    ) -> float | None:
        found = [row(place, "main", (metric, point, statistic)) for place in places]
        known = [one.value for one in found if one is not None and one.value is not None]
        return choose(known) if len(known) == len(places) else None

    floored = rank.metric.startswith(FLOORED)
    return Numbers(
        takes=own,
        pooled={name: one for name, one in pooled.items() if one is not None},
        change=row(together, DIFFERENCE, ranking[rank.statistic]) if change else None,
        floor=extreme(max, "floor.total", rank.point, "value") if floored else None,
        coverage=extreme(min, "coverage.valid", "", "value"),
        epochs=extreme(max, "coverage.epochs", "", "count"),
    )
