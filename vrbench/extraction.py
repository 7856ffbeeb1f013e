"""Extracts: a captured take -> the motion of the eye, as a motion file keeps it."""

from __future__ import annotations

from vrbench.errors import ConfigError, DataError, EstimationError
from vrbench.evaluation import calibrated
from vrbench.geometry import Transform
from vrbench.motion.files import resampled
from vrbench.protocols.body import body_shapes, usable
from vrbench.protocols.calibration import mean_x
from vrbench.protocols.protocol import Protocol, reference_trajectory
from vrbench.results.bundle import Bundle
from vrbench.results.record import TakeRecord
from vrbench.trajectory import NS, Trajectory

REFERENCE = "mocap"
MAX_GAP_S = 0.1


def eye_motion(
    bundle: Bundle,
    take: TakeRecord,
    protocol: Protocol | None,
    *,
    rate_hz: float,
    start_s: float = 0.0,
    end_s: float | None = None,
) -> Trajectory:
    """Where the eye was, `T_mocap_eye`, at an even rate: the body's poses with X behind them.

    X is measured by the calibrations of the take's mount; motion capture follows the body, and the
    eye is not where the body is. Without a headset in the recordings X can't be had: then there is
    the motion of the body alone.

    Args:
        bundle: the run.
        take: of it.
        protocol: measures X; None for the body's own motion.
        rate_hz: of the poses returned.
        start_s: where the motion begins, after the take's first pose [s].
        end_s: where it ends; the take's end where None.

    Raises:
        DataError: the take has no motion capture, no part of that name, or gaps over 0.1 s.
        EstimationError: no calibration of its mount, made with the same body, succeeds.
    """
    body = reference_trajectory(bundle.columns(take), REFERENCE)
    x = Transform.identity() if protocol is None else _x_of(bundle, take, protocol)
    begin = int(body.t[0]) + round(start_s * NS)
    end = int(body.t[-1]) if end_s is None else int(body.t[0]) + round(end_s * NS)
    part = body.between(begin, end)
    if len(part) < 2:
        raise DataError(
            f"the take has nothing between {start_s:g} s and {end_s or body.duration_s:g} s",
            fix=f"it is {body.duration_s:.1f} s long",
        )
    return resampled(part.mapped(lambda pose: pose @ x), rate_hz, max_gap_s=MAX_GAP_S)


def _x_of(bundle: Bundle, take: TakeRecord, protocol: Protocol) -> Transform:
    """`T_body_eye`, from the calibrations of the take's mount."""
    own = body_shapes(bundle.columns(take), REFERENCE)
    good, failures = usable(*calibrated(bundle, protocol, REFERENCE, take.mount), own)
    if not good:
        told = "; ".join(f"{name}: {why}" for name, why in failures.items()) or "there is none"
        raise EstimationError(f"no calibration of the take's mount is of use: {told}")
    x, _ = mean_x(list(good.values()))
    return x


def find_take(bundle: Bundle, name: str | None) -> TakeRecord:
    """The take of this name; without one the run's only scored take.

    Raises:
        ConfigError: no such take, no scored one, or several.
    """
    takes = [take for take in bundle.record.takes if name in (take.name, take.case)]
    if name is None:
        takes = [take for take in bundle.record.takes if take.role == "scored"]
    if len(takes) != 1:
        there = ", ".join(take.name for take in bundle.record.takes)
        what = "several takes could be meant"
        if not takes:
            what = "no take is scored" if name is None else f"no take is called {name!r}"
        raise ConfigError(what, file=bundle.folder, field="--take", fix=f"there are {there}")
    return takes[0]
