"""Protocol `banaszczyk2024`: the paper's own chain on the same takes, so that its numbers come out.

Banaszczyk et al., "How Accurate is the Positioning in VR?", ISMAR-Adjunct 2024, doi
10.1109/ISMAR-Adjunct64951.2024.00027; code and recordings: AdamBanaszczyk/head_trajectory. All its
constants stand here and serve nothing else: X and offsets hold for the paper's two mountings.

They turn Unity's frame right-handed by mirroring x, where takes hold poses mirrored in z. The two
differ by half a turn about y, of the world and of the eye, which X takes in. Their pose chain
`X U_0^-1 U_i X^-1` is `U_i X^-1` up to a transform from the left, which the alignment removes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from vrbench.clocks import ClockMap, Skew
from vrbench.errors import DataError, EstimationError
from vrbench.estimation.alignment import align
from vrbench.estimation.handeye import paper_residual
from vrbench.estimation.peaks import peak_offset
from vrbench.geometry import Floats, Ints, Transform
from vrbench.metrics.association import associate
from vrbench.metrics.compared import MM, aligned
from vrbench.metrics.pose_errors import ape_translation
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.metrics.summary import absent, summarise
from vrbench.protocols.protocol import Protocol, headset_samples, reference_samples
from vrbench.streams import Columns
from vrbench.trajectory import NS, Trajectory

MS = 1_000_000
MAX_DIFF_S = 0.01
MAX_DIFF_ROBOTS_S = 0.11
WINDOW_RADIUS_M = 0.005
WINDOW_MARGIN_NS = NS
HALF_TURN_ABOUT_Y = Transform(np.zeros(3), np.array([0.0, 1.0, 0.0, 0.0]))


@dataclass(frozen=True, slots=True)
class _Headset:
    """What the authors found for one of their headsets.

    Attributes:
        offset_s: its clock minus the robot's [s], tuned by hand on peaks.
        tcp_eye: the rows of their X (12,) [1 and m].
    """

    offset_s: float
    tcp_eye: tuple[float, ...]


# fmt: off
HEADSETS = {
    "quest-2": _Headset(-0.27, (
        -0.999505, -0.0153348, 0.0274682, 0.00268286,
        0.0277369, -0.0175974, 0.99946, 0.0867053,
        -0.0148431, 0.999728, 0.018014, 0.276278,
    )),
    "quest-pro": _Headset(0.0, (
        -0.999487, 0.0211027, 0.0240903, -0.00143335,
        0.0228977, -0.0550391, 0.998222, 0.099671,
        0.0223911, 0.998261, 0.0545277, 0.248939,
    )),
}
# fmt: on

APE = "ape.translation.aligned"
HANDEYE = {"handeye.translation.to_first": "mm", "handeye.rotation.to_first": "deg"}
ROBOTS = "repeatability.robot"


def given_x(columns: Columns) -> Transform:
    """Their `T_tcp_eye` of a take's headset, in the convention of takes.

    Raises:
        DataError: another headset than the paper's two.
    """
    rows = np.reshape(_headset(columns).tcp_eye, (3, 4))
    return Transform.from_matrix(rows) @ HALF_TURN_ABOUT_Y


def reference(columns: Columns, asked: str) -> str:
    """`robot_paper` where the take has it: the Quest Pro is scored against the Quest 2's run."""
    return "robot_paper" if asked == "robot" and "robot_paper/tcp" in columns.poses else asked


def prepare(
    columns: Columns,
    reference: str,
    x: Transform | None,
    *,
    anchor_s: float | None = None,
    skew: Skew | None = None,
    measured: ClockMap | None = None,
) -> ScoredTake:
    """A take on the reference's clock, in pairs of nearest neighbours.

    Calibrations are not cut: the paper's numbers of them are of whole recordings.

    Raises:
        EstimationError: peaks that can't be paired, no neighbours.
        DataError: a stream is missing, another headset than the paper's two.
    """
    del anchor_s, skew, measured  # the paper knows none of them
    truth = bag_time(columns, reference)
    offset_s = _headset(columns).offset_s
    if reference == "robot_paper":
        offset_s += peak_offset(truth, bag_time(columns, "robot")).offset_s
    estimate = whole_ms(columns)
    clock = ClockMap.affine(int(estimate.t[0]), offset_s)
    if not _is_calibration(columns):
        truth = truth.between(*window(truth))
    samples = headset_samples(columns)
    pose_t = clock.to_reference(samples.pose_t)
    within = (pose_t >= truth.t[0]) & (pose_t <= truth.t[-1])
    moved = Trajectory(clock.to_reference(estimate.t), estimate.pose)
    i, j = neighbours(truth, moved, MAX_DIFF_S)
    # evo keeps a pose of the reference that is nearest to several; a trajectory has each once
    i, once = np.unique(i, return_index=True)
    return ScoredTake(
        columns=columns,
        reference=truth,
        samples=replace(samples, pose_t=pose_t)[within],
        estimate=Trajectory(truth.t[i], moved.pose[j[once]]),
        truth=truth.pose[i],
        clock=clock,
        x=x,
    )


def bag_time(columns: Columns, reference: str) -> Trajectory:
    """A robot's log as the authors stamped it: by the time at which the bag received it."""
    samples = reference_samples(columns, reference)
    return replace(samples, pose_t=samples.receive_t).trajectory()


def whole_ms(columns: Columns) -> Trajectory:
    """The headset's poses as the authors stamped them: in whole milliseconds, rounded down."""
    samples = headset_samples(columns)
    return replace(samples, pose_t=samples.pose_t // MS * MS).trajectory()


def window(moving: Trajectory) -> tuple[int, int]:
    """From 1 s before it leaves its first position by 5 mm, to 1 s before it enters its last [ns].

    Raises:
        EstimationError: it never does.
    """
    p = moving.pose.p
    away = [np.linalg.norm(p - end, axis=1) > WINDOW_RADIUS_M for end in (p[0], p[-1])]
    if not (away[0].any() and away[1].any()):
        raise EstimationError(f"the robot stays within {MM * WINDOW_RADIUS_M:g} mm")
    leaves = int(np.argmax(away[0]))
    enters = min(len(p) - int(np.argmax(away[1][::-1])), len(p) - 1)
    return int(moving.t[leaves]) - WINDOW_MARGIN_NS, int(moving.t[enters]) - WINDOW_MARGIN_NS


def neighbours(reference: Trajectory, estimate: Trajectory, max_diff_s: float) -> tuple[Ints, Ints]:
    """Indices (k,) of the poses of each that are nearest in time; none are interpolated.

    Raises:
        EstimationError: none are near enough.
    """
    origin = int(reference.t[0])
    return associate(reference.seconds(origin), estimate.seconds(origin), max_diff_s)


def of_take(take: ScoredTake) -> Iterator[Value]:
    """What the paper prints: the error at the TCP, the hand-eye error, robot against robot."""
    tcp = next(at for at in aligned(take) if at.point == "tcp")
    yield from summarise(APE, MM * ape_translation(tcp.truth, tcp.estimate), "mm", point="tcp")
    yield from _handeye(take)
    try:
        distance = robot_against_robot(take)
    except (EstimationError, DataError) as error:
        yield absent(ROBOTS, "mm", str(error), point="tcp")
    else:
        yield from summarise(ROBOTS, MM * distance, "mm", point="tcp")


def _handeye(take: ScoredTake) -> Iterator[Value]:
    """Of calibrations, whole, each against the robot's log of its own run."""
    if take.x is None or not _is_calibration(take.columns):
        for name, unit in HANDEYE.items():
            yield absent(name, unit, "the take is no calibration", statistic="mean", point="tcp")
        return
    own = prepare(take.columns, "robot", take.x)
    distance_m, angle_rad = paper_residual(own.truth, own.estimate.pose, take.x)
    means = (MM * distance_m, float(np.degrees(angle_rad)))
    for (name, unit), mean in zip(HANDEYE.items(), means, strict=True):
        yield Value(name, "mean", mean, unit, len(own.estimate), point="tcp")


def robot_against_robot(take: ScoredTake) -> Floats:
    """Distances (n,) [m] of the robot's TCP in the take to the one in `robot_paper`, aligned.

    Raises:
        EstimationError: peaks that can't be paired, no neighbours.
        DataError: the take has one log of the robot only.
    """
    paper, own = bag_time(take.columns, "robot_paper"), bag_time(take.columns, "robot")
    clock = ClockMap.affine(int(own.t[0]), peak_offset(paper, own).offset_s)
    moved = Trajectory(clock.to_reference(own.t), own.pose)
    part = paper.between(int(take.reference.t[0]), int(take.reference.t[-1]))
    i, j = neighbours(part, moved, MAX_DIFF_ROBOTS_S)
    truth, estimate = part.pose[i], moved.pose[j]
    return ape_translation(truth, align(truth.p, estimate.p) @ estimate)


def _is_calibration(columns: Columns) -> bool:
    return columns.metadata.get("role") == "calibration"


def _headset(columns: Columns) -> _Headset:
    name = columns.metadata.get("headset")
    if name is None or name not in HEADSETS:
        what = "a take that vrbench recorded" if name is None else f"this headset: {name}"
        raise DataError(
            f"the paper has no X and no clock of {what}",
            fix=f"protocol banaszczyk2024 scores its recordings: {', '.join(HEADSETS)}",
        )
    return HEADSETS[name]


FAMILY = Family(
    name="banaszczyk2024",
    title="What the paper prints",
    units={APE: "mm", **HANDEYE, ROBOTS: "mm"},
    of_take=of_take,
    needs=frozenset({"x"}),
)

PROTOCOL = Protocol(
    name="banaszczyk2024",
    title="The paper's chain: clocks by hand and by peaks, its own X, nearest neighbours",
    prepare=prepare,
    given_x=given_x,
    reference=reference,
    families=(FAMILY,),
)
