"""What a protocol is: a named, versioned chain of estimators that scores takes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol as Interface

from vrbench.clocks import ClockMap, Skew
from vrbench.errors import DataError
from vrbench.geometry import Transform
from vrbench.metrics.registry import Family
from vrbench.metrics.scored import ScoredTake
from vrbench.protocols.calibration import Calibration
from vrbench.streams import Columns, Samples
from vrbench.trajectory import Trajectory

HEADSET = "headset/eye"
# The streams that count as truth, by what suites call them.
REFERENCES = {"robot": "robot/tcp", "mocap": "mocap/"}


class Prepare(Interface):
    """Makes a take ready for scoring.

    `anchor_s` is the length of the anchor window, `skew` the clock's by the calibrations; with
    `measured`, a clock known from elsewhere, none is estimated.
    """

    def __call__(
        self,
        columns: Columns,
        reference: str,
        x: Transform | None,
        *,
        anchor_s: float | None = None,
        skew: Skew | None = None,
        measured: ClockMap | None = None,
    ) -> ScoredTake: ...


def as_asked(columns: Columns, reference: str) -> str:  # noqa: ARG001
    """The reference that was asked for, whatever else the take has."""
    return reference


@dataclass(frozen=True, slots=True)
class Protocol:
    """A chain from takes to numbers.

    Attributes:
        name: name and version, `vrbench-1`.
        title: what it does, in a sentence.
        prepare: a take made ready for the metrics, with X from elsewhere.
        calibrate: X of a calibration take, given its columns, `robot` or `mocap`, and its name;
            None where the protocol brings X along,
        given_x: and this is it, of a take. Then no gate applies.
        reference: the stream a take is scored against, given `robot` or `mocap`: that one, or
            another robot's log.
        families: the metrics it prints; none where they are the suite's.
    """

    name: str
    title: str
    prepare: Prepare
    calibrate: Callable[[Columns, str, str], Calibration] | None = None
    given_x: Callable[[Columns], Transform] | None = None
    reference: Callable[[Columns, str], str] = as_asked
    families: Sequence[Family] = ()


def headset_samples(columns: Columns) -> Samples:
    """All samples of the headset.

    Raises:
        DataError: the take has none.
    """
    if HEADSET not in columns.poses:
        raise DataError(f"the take has no {HEADSET}", fix=f"it has {', '.join(columns.poses)}")
    return columns.poses[HEADSET]


def world_of(columns: Columns) -> str | None:
    """Names the world frame that a take's good poses lie in; takes of one name share it.

    None where nobody knows, or there are several. It is the epoch, in the numbering that the
    take's metadata names as `world`.
    """
    name, epochs = columns.metadata.get("world"), headset_samples(columns).epochs
    return f"{name}, epoch {epochs[0]}" if name and len(epochs) == 1 else None


def reference_samples(columns: Columns, reference: str) -> Samples:
    """The stream that counts as truth: `robot`, `mocap`, or another robot's log `robot_NAME`.

    Raises:
        DataError: the take has none, or several bodies of motion capture.
    """
    wanted = REFERENCES.get(reference, f"{reference}/tcp")
    found = [stream for stream in columns.poses if stream.startswith(wanted)]
    if not found:
        raise DataError(f"the take has no {wanted}", fix=f"it has {', '.join(columns.poses)}")
    if len(found) > 1:
        raise DataError(
            f"the take has several references: {', '.join(found)}",
            fix="record the body that carries the headset alone",
        )
    return columns.poses[found[0]]


def reference_trajectory(columns: Columns, reference: str) -> Trajectory:
    """The good poses of `reference_samples`."""
    return reference_samples(columns, reference).trajectory()


def recorded_span(columns: Columns, reference: str) -> tuple[int, int]:
    """When the reference's samples arrived, first and last, by the recorder's clock [ns].

    It orders the takes of a mount even where a device's own clock started anew.
    """
    received = reference_samples(columns, reference).receive_t
    return int(received.min()), int(received.max())
