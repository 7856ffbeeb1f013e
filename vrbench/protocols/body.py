"""The body that motion capture follows: takes whose markers or pivot differ don't go together.

Its pivot can be moved and its markers taught anew at any time, and X, which is from the pivot,
would change with it. Sources tell where the markers sit in events of the kind `body`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from vrbench.geometry import Floats
from vrbench.protocols.calibration import Calibration
from vrbench.streams import Columns

TOLERANCE_MM = 1.0
Shapes = list[Floats]
"""The bodies of a take: one, or one more at every change in it."""


def usable(
    calibrations: Mapping[str, Calibration],
    failures: Mapping[str, str],
    bodies: Mapping[str, Shapes],
    own: Shapes,
) -> tuple[dict[str, Calibration], dict[str, str]]:
    """The calibrations made with a take's own body, and why the others aren't to be used.

    Args:
        calibrations: of the take's mount, by take.
        failures: why others of the mount failed.
        bodies: of the calibrations' takes.
        own: the take's.
    """
    unlike = {name: difference(bodies[name], own) for name in calibrations}
    reasons = {name: reason for name, reason in unlike.items() if reason is not None}
    good = {name: c for name, c in calibrations.items() if name not in reasons}
    return good, {**failures, **reasons}


def body_shapes(columns: Columns, reference: str) -> Shapes:
    """Markers (k, 3) from the pivot [mm], as a take tells of its reference: one, or one a change.

    A reference without events of the kind has none.
    """
    return [
        np.array(event.detail["markers_mm"], dtype=np.float64).reshape(-1, 3)
        for event in columns.events
        if event.kind == "body"
        and "markers_mm" in event.detail
        and str(event.detail.get("stream", "")).startswith(f"{reference}/")
    ]


def difference(a: Sequence[Floats], b: Sequence[Floats]) -> str | None:
    """How the bodies of two takes differ; None where they don't, or where one take doesn't say."""
    shapes = [*a, *b]
    if not a or not b:
        return None
    counts = {len(shape) for shape in shapes}
    if len(counts) > 1:
        return f"the body's markers differ in number: {', '.join(map(str, sorted(counts)))}"
    away = [np.linalg.norm(shape - shapes[0], axis=1).max(initial=0.0) for shape in shapes]
    if max(away) > TOLERANCE_MM:
        return f"the body's markers lie up to {max(away):.1f} mm elsewhere from its pivot"
    return None
