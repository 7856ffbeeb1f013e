"""The picture of a plan: joint speeds, clearance, and the eye's path, as SVG written by hand."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from vrbench.geometry import Floats
from vrbench_ur.arms import JOINTS
from vrbench_ur.plan import UrPlan

WIDTH, LEFT, RIGHT = 900.0, 70.0, 20.0
COLOURS = ("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377")
POINTS = 900


def svg(plan: UrPlan) -> str:
    """The picture as text."""
    t, checks = plan.examined.t, plan.examined
    speed, least = 100.0 * checks.speed, 1e3 * checks.clearance
    keep = 1e3 * checks.keep_m
    most = max(float(np.percentile(least, 99)), 1.2 * keep)
    rows = [
        _text(LEFT, 24, f"{plan.arm}, plan {plan.hash[:12]}: {plan.path.duration_s:.1f} s", 16),
        *_panel(
            60, 220, t, [speed[:, j] for j in range(6)], "joint speed, % of full", 100.0, 100.0
        ),
        *(_text(LEFT + 10 + 120 * j, 56, name, 12, COLOURS[j]) for j, name in enumerate(JOINTS)),
        *_panel(330, 140, t, [least], "clearance, mm", most, keep, np.minimum),
        *_views(plan, 540, 300),
    ]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH:g}" height="880" '
        f'viewBox="0 0 {WIDTH:g} 880" font-family="sans-serif">\n'
        '<rect width="100%" height="100%" fill="white"/>\n' + "\n".join(rows) + "\n</svg>\n"
    )


def _text(x: float, y: float, text: str, size: int = 12, fill: str = "#222") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" fill="{fill}">{escape(text)}</text>'


def _thinned(t: Floats, y: Floats, worst: np.ufunc) -> tuple[Floats, Floats]:
    """At most POINTS of a curve; each keeps the worst value of those it stands for."""
    if len(t) <= POINTS:
        return t, y
    edges = np.linspace(0, len(t), POINTS + 1).astype(np.int64)[:-1]
    kept: Floats = worst.reduceat(y, edges)
    return t[edges], kept


def _line(x: Floats, y: Floats, colour: str) -> str:
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    return f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1"/>'


def _panel(
    top: float,
    height: float,
    t: Floats,
    curves: Sequence[Floats],
    label: str,
    most: float,
    limit: float,
    worst: np.ufunc = np.maximum,
) -> list[str]:
    """Curves over time in a frame, with a line at the limit; `worst` is what draws near to it."""
    most = max(most, 1e-6)
    inner = WIDTH - LEFT - RIGHT
    rows = [
        f'<rect x="{LEFT}" y="{top}" width="{inner}" height="{height}" fill="none" stroke="#999"/>',
        _text(LEFT, top + height + 32, f"{label}; time, s"),
    ]
    for part in (0.0, 0.5, 1.0):
        rows.append(_text(LEFT - 45, top + height * (1 - part) + 4, f"{part * most:.0f}"))
        rows.append(_text(LEFT + inner * part - 8, top + height + 16, f"{part * t[-1]:.0f}"))
    for j, curve in enumerate(curves):
        x, y = _thinned(t, curve, worst)
        level = top + height * (1 - np.clip(y / most, 0, 1))
        rows.append(_line(LEFT + inner * x / t[-1], level, COLOURS[j % len(COLOURS)]))
    y0 = top + height * (1 - limit / most)
    rows.append(f'<path d="M{LEFT} {y0:.1f}h{inner}" stroke="#c00" stroke-dasharray="4"/>')
    return rows


def _views(plan: UrPlan, top: float, size: float) -> list[str]:
    """The TCP's path from above and from the side."""
    p = plan.target.pose.p[:: max(1, len(plan.target) // 2000)]
    rows = []
    for column, (a, b, name) in enumerate(((0, 1, "from above: x, y"), (0, 2, "side: x, z"))):
        left = LEFT + column * (size + 120)
        low, high = p.min(axis=0), p.max(axis=0)
        span = max(float(np.max(high - low)), 1e-3) * 1.1
        middle = (low + high) / 2
        x = left + size * (0.5 + (p[:, a] - middle[a]) / span)
        y = top + size * (0.5 - (p[:, b] - middle[b]) / span)
        rows += [
            f'<rect x="{left}" y="{top}" width="{size}" height="{size}" '
            'fill="none" stroke="#999"/>',
            _line(x, y, COLOURS[0]),
            f'<circle cx="{x[0]:.1f}" cy="{y[0]:.1f}" r="4" fill="{COLOURS[1]}"/>',
            _text(left, top + size + 18, f"tcp {name}; {span:.2f} m wide, dot = start"),
        ]
    return rows
