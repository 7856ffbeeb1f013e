"""Two references of one take, held against each other: what one sees that the other can't."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vrbench.errors import DataError, EstimationError
from vrbench.estimation.clock import estimate_clock
from vrbench.estimation.fit import fit
from vrbench.estimation.handeye import solve_handeye
from vrbench.estimation.interpolation import PoseSpline, paired
from vrbench.estimation.trim import active_window
from vrbench.geometry import quat_conjugate, quat_multiply, quat_to_rotvec
from vrbench.metrics.bands import slow_part
from vrbench.metrics.compared import MM
from vrbench.metrics.registry import Value
from vrbench.metrics.summary import absent, summarise
from vrbench.protocols.calibration import Verdict
from vrbench.protocols.protocol import reference_trajectory
from vrbench.results.record import TakeRecord
from vrbench.results.tables import Row
from vrbench.scoring.rules import Rules
from vrbench.statistics import NORMAL_95
from vrbench.streams import Columns
from vrbench.trajectory import NS

NAMES = {"references.translation": "mm", "references.rotation": "deg", "references.offset": "ms"}
# The body's place on the flange is fitted to each take: an hour of it tells no more than this.
LONGEST_S = 600.0
SHOWN = ("rmse", "mean", "p95", "max")


def crosscheck_rows(rules: Rules, take: TakeRecord, columns: Columns) -> list[Row]:
    """How far the motion capture's body is from where the robot says it must be.

    Where the body sits on the flange, where the capture's room stands, and the offset of the two
    clocks are fitted to this very take; what is left over is what the two disagree about. The band
    above 2 Hz holds what the robot's encoders can't see: the mount's vibration. None for takes that
    haven't both references, and for the second of them, which would say the same.
    """
    if rules.reference != "robot" or "mocap" not in rules.record.references:
        return []
    try:
        values = list(_values(columns))
    except (EstimationError, DataError) as error:
        values = [absent(name, unit, str(error), point="body") for name, unit in NAMES.items()]
    return [rules.row(take, value, Verdict()) for value in values]


def _values(columns: Columns) -> Iterator[Value]:
    robot, mocap = (reference_trajectory(columns, name) for name in ("robot", "mocap"))
    start, end = active_window(robot)
    robot = robot.between(start, min(end, start + round(LONGEST_S * NS)))
    clock = estimate_clock(robot, mocap).clock
    spline = PoseSpline(robot)
    covered, tcp = paired(spline, mocap, clock)
    rough = solve_handeye(tcp, mocap.pose[covered])
    free = ("offset", "x", "y")
    best = fit(spline, mocap, clock=clock, x=rough.x, y=rough.y, free=free)
    covered, tcp = paired(spline, mocap, best.clock)
    seen = mocap[covered]
    body = tcp @ best.x
    apart = (best.y @ seen.pose).p - body.p
    turned = quat_multiply(quat_conjugate(body.q), quat_multiply(best.y.q, seen.pose.q))
    turn = np.degrees(quat_to_rotvec(turned))
    for name, error in zip(NAMES, (MM * apart, turn), strict=False):
        unit = NAMES[name]
        slow = slow_part(seen.t, error)
        for band, part in (("all", error), ("<2Hz", slow), (">2Hz", error - slow)):
            lengths = np.linalg.norm(part, axis=1)
            yield from summarise(name, lengths, unit, point="body", band=band, only=SHOWN)
    offset = float(best.clock.offset_ns(int(seen.t[len(seen) // 2]))) / 1e6
    reach = NORMAL_95 * best.sigma("offset") * 1e3
    yield Value(
        *("references.offset", "value", offset, "ms", len(seen)),
        point="body",
        low=offset - reach,
        high=offset + reach,
    )
