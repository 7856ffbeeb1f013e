"""Every scored sample as a row of a table: CSV a take, or Parquet for the whole run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from vrbench.errors import ConfigError, EstimationError
from vrbench.geometry import Floats
from vrbench.metrics.compared import MM, Compared, aligned
from vrbench.metrics.pose_errors import ape_rotation, ape_translation
from vrbench.results.export.part import Part
from vrbench.results.tables import COLUMNS, Row
from vrbench.trajectory import NS

NUMBERS = ("value", "ci_low", "ci_high")


def columns(part: Part, at: Compared) -> dict[str, Any]:
    """The samples of one point: stamps, truth and aligned estimate in the reference's frame.

    Returns:
        columns (n,) by name; the unit is in the name.
    """
    t = part.scored.estimate.t
    poses: dict[str, Floats] = {}
    for kind, pose in (("truth", at.truth), ("estimate", at.estimate)):
        poses |= {f"{kind}_{axis}_m": pose.p[:, k] for k, axis in enumerate("xyz")}
        poses |= {f"{kind}_q{axis}": pose.q[:, k] for k, axis in enumerate("xyzw")}
    return {
        "t_ns": t,
        "seconds": (t - int(part.scored.reference.t[0])) / NS,
        **poses,
        "error_mm": MM * ape_translation(at.truth, at.estimate),
        "error_deg": np.degrees(ape_rotation(at.truth, at.estimate)),
    }


def write_part(part: Part, folder: Path) -> list[Path]:
    """One CSV file a point.

    Raises:
        EstimationError: X is unknown, or positions that do not determine an alignment.
    """
    return [_write_csv(part, at, folder) for at in aligned(part.scored)]


def _write_csv(part: Part, at: Compared, folder: Path) -> Path:
    found = columns(part, at)
    path = folder / f"{part.stem}.{at.point}.csv"
    lines = [",".join(found)]
    texts = [[_text(value) for value in column.tolist()] for column in found.values()]
    lines += map(",".join, zip(*texts, strict=True))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _text(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.10g}"


def write_parquet(
    parts: Iterable[Part], rows: Sequence[Row], folder: Path, complain: Callable[[str], None]
) -> list[Path]:
    """`samples.parquet`, every sample of all takes, and `metrics.parquet`, the metric table.

    `complain` is told of each take that gives no errors, and why.

    Raises:
        ConfigError: pyarrow isn't installed.
    """
    try:
        arrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")
    except ImportError:
        raise ConfigError(
            "Parquet needs pyarrow, which is not installed",
            field="--format",
            fix="pip install 'vrbench[parquet]'",
        ) from None
    written = []
    tables = [arrow.table(dict(found)) for found in _labelled(parts, complain)]
    if tables:
        path = folder / "samples.parquet"
        parquet.write_table(arrow.concat_tables(tables), path, compression="zstd")
        written.append(path)
    path = folder / "metrics.parquet"
    metrics = {name: [getattr(row, name) for row in rows] for name in COLUMNS}
    types = {**dict.fromkeys(NUMBERS, arrow.float64()), "samples": arrow.int64()}
    schema = arrow.schema([(name, types.get(name, arrow.string())) for name in COLUMNS])
    parquet.write_table(arrow.table(metrics, schema=schema), path, compression="zstd")
    return [*written, path]


def _labelled(
    parts: Iterable[Part], complain: Callable[[str], None]
) -> Iterator[Mapping[str, Any]]:
    for part in parts:
        try:
            points = list(aligned(part.scored))
        except EstimationError as error:
            complain(f"{part.stem}: {error}")
            continue
        for at in points:
            found = columns(part, at)
            n = len(found["t_ns"])
            labels = {
                "device": part.device,
                "take": part.take,
                "reference": part.reference,
                "segment": part.scored.segment,
                "point": at.point,
            }
            yield {**{name: [label] * n for name, label in labels.items()}, **found}
