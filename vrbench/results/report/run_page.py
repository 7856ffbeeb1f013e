"""A run's report: what was measured, how sure it is, what it rests on, and plots of each take."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrbench.config.suite import Suite
from vrbench.geometry import quat_to_rotvec
from vrbench.results.bundle import Bundle
from vrbench.results.calibrations import CALIBRATIONS, CalibrationRecord, parse_calibrations
from vrbench.results.files import replace_text
from vrbench.results.leaderboard import leaderboard
from vrbench.results.plot_data import curves_file, parse_curves
from vrbench.results.report.pages import json_text, render
from vrbench.results.report.run_intervals import changes, forest_of_changes, forests, separate
from vrbench.results.report.run_tables import (
    HEADINGS,
    STATISTICS,
    columns,
    headline,
    metrics,
    numbers_of,
    results_of,
    shown,
)
from vrbench.results.tables import parse_cells, rows_of

REPORT = "report.html"
# More rows than these would make a table that nobody reads and a page that is slow to load.
MOST_ROWS = 800
STATUS_WORDS = {
    "ok": "as good as the recording",
    "unbracketed": "a calibration on one side of the take only: scored, not ranked",
    "extrapolated": "the motion leaves what was calibrated: scored, not ranked",
    "invalid": "the calibration fails the suite's gate, or there is none",
    "failed": "could not be scored",
    "skipped": "can't be had from this take",
}
KINDS = {
    "simulated": "Simulated: this says something about vrbench, and nothing about the headset "
    "that was stood in for.",
}


@dataclass(frozen=True, slots=True)
class Stand:
    """Where a run stands on a board.

    Attributes:
        board: the board, in words.
        page: its page in the site, if there is one.
        places: its rank, or `-`.
        status: `ok`, or why it has none, and `reason` in words.
    """

    board: str
    page: str | None
    places: str
    status: str
    reason: str


@dataclass(frozen=True, slots=True)
class Site:
    """The site that a run's page belongs to.

    Attributes:
        home: its first page.
        stands: where the run stands in it.
    """

    home: str
    stands: Sequence[Stand]


def run_page(bundle: Bundle, protocol: str, site: Site | None = None) -> str:
    """The page of a run: a file of its own, or a page of a site.

    Raises:
        ConfigError: jinja2 isn't installed.
        DataError: no metrics yet, or a file was changed since it was written.
    """
    record = bundle.record
    suite = record.resolved_suite()
    table, plots = f"metrics/{protocol}.csv", curves_file(protocol)
    lines = parse_cells(bundle.content(table), bundle.folder / table)
    rows = rows_of(shown(lines, suite), bundle.folder / table)
    curves, curves_json, calibrations = None, b"", {}
    if plots in record.files:
        curves_json = bundle.content(plots)
        curves = parse_curves(curves_json, bundle.folder / plots)
    if CALIBRATIONS in record.files:
        path = bundle.folder / CALIBRATIONS
        calibrations = parse_calibrations(bundle.content(CALIBRATIONS), path, protocol)
    numbers = numbers_of(rows)
    results = results_of(rows, numbers, suite)
    every, changed = metrics(rows), changes(rows, suite)
    return render(
        "run.html.j2",
        shared=site is not None,
        home=site.home if site else None,
        record=record,
        suite=suite,
        protocol=protocol,
        kind_notice=KINDS.get(record.kind),
        headline=headline(results, numbers, suite),
        results=results,
        columns=columns(rows, suite),
        stands=site.stands if site else alone(bundle, protocol),
        gate=_gate(suite),
        statuses=STATUS_WORDS,
        takes=curves.takes if curves else [],
        first_take=next(
            (k for k, take in enumerate(curves.takes if curves else []) if take.role == "scored"), 0
        ),
        left_out=curves.left_out if curves else 0,
        has_curves=curves is not None,
        calibrations={r: [_calibration(c) for c in found] for r, found in calibrations.items()},
        headings=HEADINGS,
        statistics=STATISTICS,
        metrics=every[:MOST_ROWS],
        line_count=len(every),
        row_count=len(lines),
        repairs=[(take.name, repair) for take in record.takes for repair in take.repairs],
        forests=[*forests(results, numbers, suite), *forest_of_changes(changed, suite)],
        changes=[(row, separate(row)) for row in changed],
        curves=json_text(curves_json.decode()),
    )


def write_report(bundle: Bundle, protocol: str) -> None:
    """Writes `report.html` into the bundle, and enters it there; raises as `run_page` does."""
    replace_text(bundle.folder / REPORT, run_page(bundle, protocol))
    bundle.enter(REPORT)


def alone(bundle: Bundle, protocol: str) -> list[Stand]:
    """Where a run would stand on a leaderboard by itself."""
    found = leaderboard([bundle.folder], protocol)
    return [
        Stand(board.title, None, entry.places, entry.status, entry.reason)
        for board in found.boards
        for entry in board.entries
        if entry.source == "measured"
    ]


def _gate(suite: Suite) -> str:
    gate = suite.gate
    return (
        f"A calibration may leave {gate.handeye_translation * 1e3:g} mm and "
        f"{math.degrees(gate.handeye_rotation):.3g} deg at most, lie no more than "
        f"{gate.max_age / 60:g} min from the take, and must agree with the others of its mount "
        f"within {gate.bracket * 1e3:g} mm beyond what their uncertainty explains."
    )


def _calibration(found: CalibrationRecord) -> dict[str, Any]:
    """A calibration's X in mm and deg, with standard deviations."""
    covariance = found.tcp_eye_covariance
    sigma = None
    if covariance is not None:
        sigma = np.sqrt(np.maximum(np.diag(np.array(covariance)), 0.0))
    turn = quat_to_rotvec(np.array(found.tcp_eye.q_xyzw))
    return {
        "take": found.take,
        "p": [1e3 * value for value in found.tcp_eye.p_m],
        "r": np.degrees(turn).tolist(),
        "p_sigma": None if sigma is None else (1e3 * sigma[3:]).tolist(),
        "r_sigma": None if sigma is None else np.degrees(sigma[:3]).tolist(),
        "residual_mm": found.residual_mm,
        "residual_deg": found.residual_deg,
    }
