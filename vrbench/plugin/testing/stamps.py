"""Whether stamps are times: in nanoseconds, as fast as time passes, arrivals on our clock."""

from __future__ import annotations

import numpy as np

from vrbench.plugin.testing.opening import Recorded
from vrbench.plugin.testing.verdicts import require
from vrbench.trajectory import NS

# What the stamps' span is to the time that passed, where a unit was taken for another.
MISTAKEN = {
    1e-9: "seconds were taken for nanoseconds",
    1e-6: "milliseconds were taken for nanoseconds",
    1e-3: "microseconds were taken for nanoseconds",
    1e3: "nanoseconds were taken for microseconds",
    1e6: "nanoseconds were taken for milliseconds",
}
# How long a take lasts is known about as well: a device may begin late, or send what it kept.
TIMES = 10.0
SLACK_NS = 1_000_000_000


def check_times(recorded: Recorded) -> None:
    """That arrivals lie in the take, and stamps span about as much.

    Raises:
        NonconformityError: they don't; says which unit was taken for another.
    """
    samples, began = recorded.samples, recorded.rehearsal.began
    early, late = int(samples.receive_t.min()), int(samples.receive_t.max())
    off = max(began - SLACK_NS - early, late - recorded.ended - SLACK_NS)
    require(
        off <= 0,
        f"poses arrive outside the take, {off / NS:.6g} s off the recorder's clock",
        "receive_t is session.host.now() when a pose arrives.",
    )
    told = told_unit(samples.source_t, recorded.lasted_s)
    require(
        told is None,
        told or "",
        "Stamps are int64 nanoseconds: multiply what the device sends.",
    )


def told_unit(t: object, passed_s: float) -> str | None:
    """What is wrong with the unit of stamps t (n,) [ns] of about so many seconds; None: nothing."""
    spanned = float(np.ptp(np.asarray(t, dtype=np.float64))) / NS
    ratio = spanned / passed_s
    if 1 / TIMES < ratio < TIMES:
        return None
    said = f"stamps span {spanned:.3g} s, and {passed_s:.3g} s passed"
    for times, mistaken in MISTAKEN.items():
        if 1 / TIMES < ratio / times < TIMES:
            return f"{said}: {mistaken}"
    return said
