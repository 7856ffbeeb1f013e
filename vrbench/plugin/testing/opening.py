"""Opens a device as a run would, and records from it what a stand-in plays."""

from __future__ import annotations

import time
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrbench.config.rig import Mounting
from vrbench.devices.host import RealClock
from vrbench.devices.ports import PoseSource, Session
from vrbench.devices.rehearsal import Rehearsal
from vrbench.devices.specs import HeadsetProfile
from vrbench.plugin.testing.patience import Tell, limited
from vrbench.plugin.testing.verdicts import NonconformityError, require
from vrbench.streams import Columns, Samples
from vrbench.trajectory import NS

# A rehearsal is lost and recentred at least once in as long.
RECORD_S, LOOK_S, LAST_S = 3.3, 0.05, 1.0
# A device that takes longer to open, send and close hangs.
PATIENCE_S = 60.0
# Where neither profile nor plugin says it.
RATE_HZ = 72.0


def session(clock: RealClock | None = None) -> Session:
    """What a device is opened with on a rig that states nothing."""
    return Session(clock or RealClock(), Mounting().tcp_eye.transform(), seed=1)


def opened(
    kind: str, spec: Any, options: Any, within: Session | None = None
) -> AbstractContextManager[Any]:
    """The device, to be entered."""
    within = within or session()
    if kind == "headset":
        profile = spec.profile or HeadsetProfile(rate_hz=RATE_HZ)
        device: AbstractContextManager[Any] = spec.open(options, profile, within)
    else:
        device = spec.open(options, within)
    return device


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """What came of a rehearsal.

    Attributes:
        rehearsal: what was played.
        stream: the stream's name.
        samples: all of it.
        parts: every answer of `read`.
        options: that the stand-in gave.
        closed_again: what a second closing raised; None where it passed.
        ended: when the take ended, on the recorder's clock [ns].
        lasted_s: from its start [s].
        read_s: how long a call of `read` took, median [s].
    """

    rehearsal: Rehearsal
    stream: str
    samples: Samples
    parts: list[Columns]
    options: dict[str, Any]
    closed_again: Exception | None
    ended: int
    lasted_s: float
    read_s: float

    @property
    def followed(self) -> bool:
        """Whether the pose times are the recorder's: the take has clock exchanges."""
        return any(len(x) for part in self.parts for x in part.clocks.values())


def record(
    kind: str, spec: Any, stand_in: Any, stream: str, rate_hz: float | None = None
) -> Recorded:
    """Records a rehearsal.

    A device that hangs is given up.

    Args:
        kind: `headset` or `mocap`.
        spec: of the device.
        stand_in: that plays it.
        stream: how the stream's name begins.
        rate_hz: that the stand-in sends at; the declared rate where None.

    Raises:
        NonconformityError: no poses come, or something that is no `Columns`; or it hangs.
    """
    return limited(lambda tell: _record(kind, spec, stand_in, stream, rate_hz, tell), PATIENCE_S)


def options_of(spec: Any, stand_in: Any, rate_hz: float | None = None) -> dict[str, Any]:
    """The options with which the stand-in is found, where it plays nothing for long."""
    clock = RealClock()
    rehearsal = Rehearsal(clock.now, clock.now(), rate_hz or _rate(spec))
    with stand_in(rehearsal) as chosen:
        return dict(chosen)


def _record(
    kind: str, spec: Any, stand_in: Any, stream: str, rate_hz: float | None, tell: Tell
) -> Recorded:
    clock = RealClock()
    within = session(clock)
    rate_hz = rate_hz or _rate(spec)
    rehearsal = Rehearsal(clock.now, clock.now(), rate_hz, recentres=kind == "headset")
    with stand_in(rehearsal) as chosen:
        options = spec.options.model_validate(dict(chosen))
        source = opened(kind, spec, options, within)
        with source as device:
            parts, lasted_s, read_s = _take(device, tell)
            ended = clock.now()
            tell("closing")
        tell("closing again")
        again = _closed_again(source)
        tell("the stand-in's end")
    name, samples = _stream(parts, stream)
    return Recorded(rehearsal, name, samples, parts, dict(chosen), again, ended, lasted_s, read_s)


def _rate(spec: Any) -> float:
    profile = getattr(spec, "profile", None)
    return float(profile.rate_hz if profile else getattr(spec, "rate_hz", RATE_HZ))


def _take(device: PoseSource, tell: Tell) -> tuple[list[Columns], float, float]:
    """All that a take of a few seconds holds, how long it and a `read` took [s]."""
    tell("start()")
    device.start("conformance")
    tell("read()")
    started = time.monotonic()
    parts, took, end = [], [], started + RECORD_S
    while time.monotonic() < end:
        time.sleep(LOOK_S)
        begun = time.perf_counter()
        parts.append(device.read())
        took.append(time.perf_counter() - begun)
    tell("stop()")
    device.stop()
    lasted_s = time.monotonic() - started
    tell("read()")
    quiet, end = 0, time.monotonic() + LAST_S
    while quiet < 3 and time.monotonic() < end:
        parts.append(device.read())
        quiet = 0 if _any(parts[-1]) else quiet + 1
        time.sleep(LOOK_S)
    for part in parts:
        require(
            isinstance(part, Columns),
            f"read() returns a {type(part).__name__}",
            "Return vrbench.streams.Columns; Columns({}) where nothing came.",
        )
    return parts, lasted_s, float(np.median(took))


def _any(part: Any) -> bool:
    return isinstance(part, Columns) and any(len(x) for x in part.poses.values())


def _closed_again(source: Any) -> Exception | None:
    try:
        source.__exit__(None, None, None)
    except Exception as error:  # a plugin may raise anything
        return error
    return None


def _stream(parts: list[Columns], prefix: str) -> tuple[str, Samples]:
    names = sorted({name for part in parts for name, x in part.poses.items() if len(x)})
    ours = [name for name in names if name.startswith(prefix)]
    if len(ours) != 1:
        there = ", ".join(names) or "none"
        raise NonconformityError(
            f"it was to send the one stream {prefix}, and sends {there}",
            f"read() returns Columns({{{prefix!r}: Samples(...)}}) with what has arrived since the "
            "last call, from `start` on.",
        )
    found = [part.poses[ours[0]] for part in parts if ours[0] in part.poses]
    return ours[0], Samples.concatenate(found)


def median_rate(samples: Samples) -> float:
    """Poses a second [Hz], by the source's own stamps."""
    steps = np.diff(np.unique(samples.source_t))
    return NS / float(np.median(steps)) if len(steps) else 0.0
