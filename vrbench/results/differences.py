"""Where a run's files differ from those that evaluating its takes again has made."""

from __future__ import annotations

from base64 import b64decode
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vrbench.geometry import Floats, quat_to_matrix
from vrbench.results.calibrations import CALIBRATIONS, CalibrationRecord, parse_calibrations
from vrbench.results.phases import read_phases
from vrbench.results.plot_data import MISSING, Packed, curves_file, parse_curves
from vrbench.results.tables import read_rows

# How far numbers evaluated again may be off: relative, and in the unit they are printed in.
RELATIVE, ABSOLUTE = 1e-6, 1e-4
# Of what is drawn: numbers of five digits, and columns of 16 bits, of which rounding may turn one.
DRAWN, CODES = 1e-4, 2
Cells = dict[str, object]
Read = Callable[[Path], Iterable[tuple[str, Cells]]]


def compared(protocol: str) -> list[tuple[str, Read]]:
    """The files that evaluation by a protocol makes, and how each is read, row by row."""
    return [
        (f"metrics/{protocol}.csv", _metric_cells),
        (f"metrics/{protocol}.phase.csv", _phase_cells),
        (CALIBRATIONS, lambda path: _calibration_cells(path, protocol)),
        (curves_file(protocol), _curve_cells),
    ]


def _metric_cells(path: Path) -> list[tuple[str, Cells]]:
    return [
        (
            " ".join(cell for cell in row.key[3:] if cell),
            {
                "device": row.device,
                "suite": row.suite,
                "value": row.value,
                "ci_low": row.ci_low,
                "ci_high": row.ci_high,
                "ci_scope": row.ci_scope,
                "unit": row.unit,
                "samples": row.samples,
                "status": row.status,
            },
        )
        for row in read_rows(path)
    ]


def _phase_cells(path: Path) -> list[tuple[str, Cells]]:
    return [
        (
            f"{r.case} {r.condition} {r.mount} {r.repeat} {r.reference} {r.metric} {r.point} "
            f"phase {r.phase}",
            {"mean": r.mean, "mean_square": r.mean_square, "unit": r.unit},
        )
        for r in read_phases(path)
    ]


def _calibration_cells(path: Path, protocol: str) -> list[tuple[str, Cells]]:
    """X, its sigmas, Y and what they leave, in mm and deg; nothing where there is no such file."""
    content = path.read_bytes() if path.is_file() else b'{"protocols": {}}'
    return [
        (f"{reference} {one.take}", dict(_in_print(one)))
        for reference, found in parse_calibrations(content, path, protocol).items()
        for one in found
    ]


def _in_print(found: CalibrationRecord) -> Iterator[tuple[str, object]]:
    for name, pose in (("tcp_eye", found.tcp_eye), ("base_world", found.base_world)):
        # the transform itself: a rotation vector near half a turn has two signs
        matrix = quat_to_matrix(np.array(pose.q_xyzw))
        yield from ((f"{name} {axis}", 1e3 * p) for axis, p in zip("xyz", pose.p_m, strict=True))
        turns = np.degrees(matrix).ravel().tolist()
        yield from ((f"{name} rotation {k}", turn) for k, turn in enumerate(turns))
    yield "residual_mm", found.residual_mm
    yield "residual_deg", found.residual_deg
    if found.tcp_eye_covariance is None:
        yield "covariance", None
        return
    covariance = np.array(found.tcp_eye_covariance)
    # (rotation, translation), as variances in deg and mm
    unit = np.repeat([np.degrees(1.0), 1e3], 3)
    scaled = covariance * np.outer(unit, unit)
    yield "covariance", Drawn(scaled, DRAWN * float(np.abs(scaled).max()))


@dataclass(frozen=True, eq=False)
class Drawn:
    """Numbers to few digits, and how far others may be off; gaps are nan."""

    values: Floats
    off: float

    def __str__(self) -> str:
        known = self.values[np.isfinite(self.values)]
        ends = f", {known.min():.4g} to {known.max():.4g}" if len(known) else ""
        return f"{self.values.size} values{ends}"

    def like(self, other: Drawn) -> bool:
        """Whether the others are the same."""
        off = max(self.off, other.off)
        return self.values.shape == other.values.shape and np.allclose(
            self.values, other.values, rtol=DRAWN, atol=off, equal_nan=True
        )


def _curve_cells(path: Path) -> list[tuple[str, Cells]]:
    run = parse_curves(path.read_bytes(), path)
    takes = [(f"{t.take} {t.reference}", dict(_leaves(t.model_dump()))) for t in run.takes]
    return [("takes", {"left_out": run.left_out, "protocol": run.protocol}), *takes]


def _leaves(found: Any, name: str = "") -> Iterator[tuple[str, object]]:
    """What stands in nested columns, by its place."""
    if isinstance(found, dict) and found.keys() == Packed.model_fields.keys():
        data = b64decode(found["data"])
        codes = np.frombuffer(data[: len(data) // 2 * 2], dtype="<u2")
        step = (found["hi"] - found["lo"]) / (MISSING - 1)
        yield (
            name,
            Drawn(np.where(codes == MISSING, np.nan, found["lo"] + step * codes), CODES * step),
        )
    elif isinstance(found, dict):
        for key, value in found.items():
            yield from _leaves(value, f"{name}.{key}" if name else key)
    elif isinstance(found, list | tuple) and all(isinstance(one, float) for one in found):
        yield name, Drawn(np.array(found), 0.0)
    elif isinstance(found, list | tuple):
        for k, value in enumerate(found):
            yield from _leaves(value, f"{name}.{k}")
    else:
        yield name, Drawn(np.array(found), 0.0) if isinstance(found, float) else found


def differences(
    stated: Iterable[tuple[str, Cells]], again: Iterable[tuple[str, Cells]]
) -> Iterator[str]:
    """Rows that only one of two files has, and cells that differ."""
    listed, mine = list(stated), dict(again)
    names = [name for name, _ in listed]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        yield f"{twice}: stands there twice"
    for name, cells in listed:
        if name not in mine:
            yield f"{name}: evaluated here there is no such number"
            continue
        for column in cells | mine[name]:
            cell, here = cells.get(column), mine[name].get(column)
            if not _same(cell, here):
                yield f"{name}: {column} is {_shown(cell)}, here {_shown(here)}"
    for name in mine.keys() - set(names):
        yield f"{name}: is missing"


def _same(first: object, second: object) -> bool:
    if isinstance(first, Drawn) and isinstance(second, Drawn):
        return first.like(second)
    if isinstance(first, float) and isinstance(second, float):
        return abs(first - second) <= max(RELATIVE * abs(second), ABSOLUTE)
    return first == second


def _shown(cell: object) -> str:
    return (
        f"{cell:.10g}"
        if isinstance(cell, float)
        else str(cell)
        if cell not in (None, "")
        else "empty"
    )
