"""Finds where a motion can start: position and yaw of the eye, so that one posture carries it all.

Coarse to fine, and the same every time: a low-discrepancy sample of starts is thinned by a few
poses each, then by speeds and singularities at 12 Hz, then by distances; the best are moved about.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from vrbench.geometry import Floats
from vrbench_ur.arms import POSITION
from vrbench_ur.cell import Cell
from vrbench_ur.inverse import BRANCHES, solve
from vrbench_ur.options import Limits, Start
from vrbench_ur.targets import Task, beside_base, postures, reached

# Told what is being done and the part done, 0..1.
Progress = Callable[[str, float], None]


def quiet(_what: str, _done: float) -> None:
    """Progress that nobody is told of."""


CANDIDATES = 8192
BATCH = 256
# How many starts are looked at in full, how many of them are moved about, and how often.
LOOKED_AT, REFINED, ROUNDS, NEIGHBOURS = 320, 4, 4, 16
THIN_POSES = 24
# Poses of a motion at most whose distances the search looks at: two minutes at its rate.
CLEARED_POSES = 1500
COARSE_HZ = 12.0
# Cost of a start that can't reach everything, or touches something: 10 and the part it misses.
UNREACHED = 10.0
SEED = 1


@dataclass(frozen=True, slots=True)
class Candidate:
    """A start and how one posture does from it.

    Attributes:
        start: position and yaw.
        branch: which of the eight postures.
        cost: worst use of any limit at the coarse rate; 1 or less can be done.
        fraction: share of the coarse poses before the first one out of reach.
    """

    start: Start
    branch: int
    cost: float
    fraction: float


def search(task: Task, cell: Cell, progress: Progress) -> list[Candidate]:
    """Starts by cost, best first; the best few of each lie near one another.

    Args:
        task: the motion; its stretch counts.
        cell: the arm and what is around it.
        progress: told how it goes on.
    """
    coarse = task.coarse(COARSE_HZ)
    p, yaw = _sample(task, cell)
    thin = np.concatenate(
        [
            _thin_cost(coarse, cell, p[i : i + BATCH], yaw[i : i + BATCH])
            for i in range(0, len(p), BATCH)
        ]
    )
    order = np.argsort(thin, kind="stable")[:LOOKED_AT]
    found = []
    total = len(order) + REFINED * ROUNDS * NEIGHBOURS
    for n, k in enumerate(order):
        found.append(look_at(coarse, cell, _start(p[k], yaw[k])))
        progress(_told("starts", found), (n + 1) / total)
    found.sort(key=_cost)
    rng = np.random.default_rng(SEED)
    done = len(order)
    for best in found[:REFINED]:
        for turn in range(ROUNDS):
            shrink = 0.5**turn
            around = best
            for _ in range(NEIGHBOURS):
                step = rng.normal(size=4) * np.array([0.05, 0.05, 0.05, 12.0]) * shrink
                at = np.array(around.start.p_m) + step[:3]
                new = look_at(coarse, cell, _start(at, np.radians(around.start.yaw_deg + step[3])))
                best = min(best, new, key=_cost)
                done += 1
            found.append(best)
            progress(_told("better starts", found), done / total)
    return sorted(found, key=_cost)


def look_at(coarse: Task, cell: Cell, start: Start) -> Candidate:
    """The best posture from one start, at the coarse rate, distances included."""
    flange = coarse.flange(start)
    q = postures(flange, cell.arm.dh)
    share = reached(q).argmin(axis=1) / q.shape[1]
    share[reached(q).all(axis=1)] = 1.0
    cost = np.where(share < 1.0, UNREACHED + 1.0 - share, 0.0)
    whole = np.flatnonzero(share == 1.0)
    limits, t = coarse.options.limits, coarse.times()
    beside = limits.shoulder_m / max(float(beside_base(flange, cell.arm.dh).min()), 1e-4)
    for branch in whole:
        cost[branch] = max(_motion_cost(q[branch], t, cell, limits), beside)
    keep = max(coarse.options.workspace.clearance_m, 1e-6)
    for branch in sorted(whole, key=lambda b: cost[b]):
        if cost[branch] >= cost[whole].min() + 1.0 or cost[branch] > 1.5:
            continue
        cost[branch] = max(cost[branch], _near_cost(q[branch], cell, keep))
    for branch in whole:
        # what breaks another limit is told of, and a start that isn't in the table says more
        if cost[branch] > 1.5:
            few = q[branch][:: max(1, q.shape[1] // THIN_POSES)]
            cost[branch] = max(cost[branch], _near_cost(few, cell, keep))
    best = int(np.argmin(cost))
    return Candidate(start, best, float(cost[best]), float(share[best]))


def _near_cost(q: Floats, cell: Cell, keep: float) -> float:
    """What is kept clear [m] over the least distance along angles (n, 6).

    Where the arm touches, that is as bad as what it can't reach, and later is better: what can't be
    done is told of the start that gets far.
    """
    clearance = cell.clearance(q[:: -(-len(q) // CLEARED_POSES)])[0]
    least = float(clearance.min())
    if least <= 0.0:
        return UNREACHED + 1.0 - int(np.argmax(clearance < keep)) / len(clearance)
    return 1.0 + 4.0 * (1.0 - least / keep) if least < keep else keep / least


def _motion_cost(q: Floats, t: Floats, cell: Cell, limits: Limits) -> float:
    """Worst use of the limits of position, speed and singularity by angles (n, 6) at t (n,) [s]."""
    velocity = np.diff(q, axis=0) / np.diff(t)[:, None]
    speed = np.abs(velocity).max(axis=0)
    middle = np.diff((t[1:] + t[:-1]) / 2)
    bend = np.abs(np.diff(velocity, axis=0) / middle[:, None]).max()
    wrist = np.arcsin(np.abs(np.sin(q[:, 4]))).min()
    elbow = np.arcsin(np.abs(np.sin(q[:, 2]))).min()
    uses = (
        (speed / (cell.arm.speed * limits.speed_percent / 100)).max(),
        bend / limits.acceleration,
        (np.abs(q).max(axis=0) / (POSITION - np.radians(limits.margin_deg))).max(),
        np.radians(limits.wrist_deg) / max(wrist, 1e-3),
        np.radians(limits.elbow_deg) / max(elbow, 1e-3),
    )
    return float(max(uses))


def _sample(task: Task, cell: Cell) -> tuple[Floats, Floats]:
    """Starts all over the arm's reach: positions (k, 3) [m], yaws (k,) [rad]."""
    workspace, reach = task.options.workspace, cell.arm.reach + cell.arm.dh.d[4]
    unit = qmc.Sobol(4, seed=SEED).random(CANDIDATES)
    radius = (0.15 + 0.95 * unit[:, 0]) * reach
    z = (-0.2 + 1.3 * unit[:, 1]) * reach + cell.arm.dh.d[0]
    # an empty cell looks the same from every side, but for where joint 1 starts
    crowded = workspace.boxes or workspace.tcp_min_m or workspace.tcp_max_m
    spread = (unit[:, 3] - 0.5) * 2 * np.pi if crowded else np.zeros(CANDIDATES)
    azimuth = np.radians(workspace.front_deg) + spread
    p = np.column_stack((radius * np.cos(azimuth), radius * np.sin(azimuth), z))
    return p, azimuth + unit[:, 2] * 2 * np.pi


def _thin_cost(coarse: Task, cell: Cell, p: Floats, yaw: Floats) -> Floats:
    """A lower bound (k,) of each start's cost, from a few of its poses."""
    every = max(1, len(coarse.motion) // THIN_POSES)
    few = Task(coarse.motion[::every], coarse.mounting, coarse.options)
    q = solve(few.flanges(p, yaw), cell.arm.dh)  # (k, n, 8, 6)
    there = reached(q)
    share = there.mean(axis=1)
    limits = coarse.options.limits
    with np.errstate(invalid="ignore"):
        wrist = np.nanmin(np.abs(np.sin(q[..., 4])), axis=1, initial=1.0, where=there)
        elbow = np.nanmin(np.abs(np.sin(q[..., 2])), axis=1, initial=1.0, where=there)
    cost = np.maximum(
        np.sin(np.radians(limits.wrist_deg)) / np.maximum(wrist, 1e-3),
        np.sin(np.radians(limits.elbow_deg)) / np.maximum(elbow, 1e-3),
    )
    beside = beside_base(few.flanges(p, yaw), cell.arm.dh).min(axis=1)
    cost = np.maximum(cost, limits.shoulder_m / np.maximum(beside, 1e-4)[:, None])
    cost = np.where(share < 1.0, UNREACHED * 100 * (2.0 - share), cost)
    best: Floats = cost.reshape(-1, BRANCHES).min(axis=1)
    return best


def _start(p: Floats, yaw: float) -> Start:
    """Rounded to 0.1 mm and 0.01 deg, as people can write it."""
    x, y, z = (round(float(v), 4) for v in p)
    return Start(p_m=(x, y, z), yaw_deg=round((float(np.degrees(yaw)) + 180.0) % 360.0 - 180.0, 2))


def _cost(candidate: Candidate) -> float:
    return candidate.cost


def _told(what: str, found: list[Candidate]) -> str:
    good = sum(candidate.cost <= 1.0 for candidate in found)
    return f"{what}: {good} of {len(found)} can be done"
