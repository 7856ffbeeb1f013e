"""Results that others printed: reference rows beside what vrbench has scored, never ranked."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import Field, model_validator

from vrbench.config.shipped import shipped_files
from vrbench.config.strict import Strict
from vrbench.config.yaml_file import load_model
from vrbench.results.board import BoardKey, Entry

METRIC = "ape.translation.aligned"


class PublishedRow(Strict):
    """What was printed of one device: errors of translation [mm], or of hand-eye calibration."""

    suite: str
    case: str
    condition: str = "default"
    baseline: str | None = None
    device: str
    take: str
    rmse: float | None = Field(None, ge=0.0)
    mean: float | None = Field(None, ge=0.0)
    std: float | None = Field(None, ge=0.0)
    max: float | None = Field(None, ge=0.0)
    handeye_mm: float | None = None
    handeye_deg: float | None = None

    @model_validator(mode="after")
    def _possible(self) -> PublishedRow:
        if self.rmse is not None and self.mean is not None and self.rmse < self.mean:
            raise ValueError(f"an rmse of {self.rmse} below the mean of {self.mean} can't be")
        return self


class Published(Strict):
    """A publication's rows."""

    source: str
    lab: str
    protocol: str
    point: str
    rows: tuple[PublishedRow, ...] = Field(min_length=1)


def published() -> list[Published]:
    """The publications that come with vrbench.

    Raises:
        ConfigError: a file is wrong.
    """
    return [load_model(path, Published) for path in shipped_files("published").values()]


def published_entries(
    publications: Sequence[Published], key: BoardKey, *, change: bool
) -> list[Entry]:
    """The printed rows that belong beside a board: of its suite, case and condition.

    Their motion and protocol needn't be the board's; each entry says what they were.

    Args:
        publications: whose rows.
        key: of the board.
        change: whether the board is of changes against the baseline.
    """
    place = (key.suite.partition("@")[0], key.case, key.condition)
    return [
        _entry(publication, row, change=change)
        for publication in publications
        for row in publication.rows
        if (row.suite, row.case, row.condition) == place
    ]


def _entry(publication: Published, row: PublishedRow, *, change: bool) -> Entry:
    value = row.rmse
    if change:
        before = next((r.rmse for r in publication.rows if _is_baseline(r, row)), None)
        value = None if row.rmse is None or before is None else round(row.rmse - before, 9)
    return Entry(
        device=row.device,
        firmware="unknown",
        logger="unknown",
        logger_version="unknown",
        prediction="unknown",
        lab=publication.lab,
        value=value,
        unit="mm",
        statistics={"rmse": row.rmse, "mean": row.mean, "std": row.std, "max": row.max},
        status="published",
        reason=_reason(publication, row),
        runs=[row.take],
        source="published",
    )


def _is_baseline(other: PublishedRow, row: PublishedRow) -> bool:
    return (
        other.rmse is not None
        and (other.suite, other.case, other.device) == (row.suite, row.case, row.device)
        and other.condition == row.baseline
    )


def _reason(publication: Published, row: PublishedRow) -> str:
    told = f"printed in {publication.source}: not scored by vrbench, on real devices"
    if row.handeye_mm is not None:
        return f"hand-eye error of {row.handeye_mm:g} mm, {row.handeye_deg:g} deg, {told}"
    return f"{METRIC} at the {publication.point}, protocol {publication.protocol}, {told}"
