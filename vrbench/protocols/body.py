"""The body that motion capture follows: takes whose markers or pivot differ don't go together.

Its pivot can be moved and its markers taught anew at any time, and X, which is from the pivot,
would change with it. Sources tell where the markers sit in events of the kind `body`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vrbench.geometry import Floats
from vrbench.streams import Columns

TOLERANCE_MM = 1.0


def body_shapes(columns: Columns, reference: str) -> list[Floats]:
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
