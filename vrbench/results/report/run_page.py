"""A run's report: what was measured, how sure it is, what it rests on, and plots of each take."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vrbench.config.suite import Suite
from vrbench.geometry import quat_to_rotvec
from vrbench.results.bundle import Bundle, replace_text
from vrbench.results.calibrations import CALIBRATIONS, CalibrationRecord, read_calibrations
from vrbench.results.leaderboard import leaderboard
from vrbench.results.plot_data import RunCurves, curves_file, read_curves
from vrbench.results.report.pages import render
from vrbench.results.report.run_tables import (
    COLUMNS,
    forests,
    headline,
    metrics,
    numbers_of,
    results_of,
)
from vrbench.results.tables import read_rows

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


def run_page(
    bundle: Bundle, protocol: str, *, shared: bool = False, home: str | None = None
) -> str:
    """The page of a run.

    Args:
        bundle: an evaluated run.
        protocol: whose metrics.
        shared: whether script and style lie beside the page, as in a site.
        home: the page of the site it belongs to.

    Raises:
        ConfigError: jinja2 isn't installed.
        DataError: no metrics yet, or a file was changed since it was written.
    """
    record = bundle.record
    suite = record.resolved_suite()
    rows = read_rows(bundle.checked(f"metrics/{protocol}.csv"))
    curves = read_curves(bundle.checked(curves_file(protocol)))
    calibrations = read_calibrations(bundle.checked(CALIBRATIONS), protocol)
    numbers = numbers_of(rows)
    results = results_of(numbers, suite)
    return render(
        "run.html.j2",
        shared=shared,
        home=home,
        record=record,
        suite=suite,
        protocol=protocol,
        kind_notice=KINDS.get(record.kind),
        headline=headline(results, numbers, suite),
        results=results,
        columns=COLUMNS,
        standings=_standings(bundle, protocol),
        gate=_gate(suite),
        statuses=STATUS_WORDS,
        takes=curves.takes if curves else [],
        left_out=curves.left_out if curves else 0,
        has_curves=curves is not None,
        calibrations={r: [_calibration(c) for c in found] for r, found in calibrations.items()},
        metrics=metrics(rows),
        row_count=len(rows),
        most_rows=MOST_ROWS,
        repairs=[(take.name, repair) for take in record.takes for repair in take.repairs],
        data=_data(curves, forests(results, numbers, suite)),
    )


def write_report(bundle: Bundle, protocol: str) -> None:
    """Writes `report.html` into the bundle, and enters it there; raises as `run_page` does."""
    replace_text(bundle.folder / REPORT, run_page(bundle, protocol))
    bundle.enter(REPORT)


def _standings(bundle: Bundle, protocol: str) -> list[dict[str, str]]:
    """Where the run would stand on a leaderboard by itself, or why nowhere."""
    return [
        {
            "board": f"{board.key.case}, {board.key.condition}, by {board.key.reference}",
            "status": entry.status,
            "reason": entry.reason,
        }
        for board in leaderboard([bundle], protocol)
        for entry in board.entries
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


def _data(curves: RunCurves | None, forests: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What the script draws from."""
    takes = [take.model_dump(mode="json") for take in curves.takes] if curves else []
    return {"forests": list(forests), "takes": takes}
