"""The paper's chain: its printed numbers come out of its recordings, and each step does as told."""

from __future__ import annotations

import numpy as np
import pytest

from vrbench.errors import DataError, EstimationError
from vrbench.evaluation import evaluate
from vrbench.geometry import Transform, rotvec_to_quat
from vrbench.importing import import_recordings
from vrbench.metrics.scored import ScoredTake
from vrbench.plugin.manager import Plugins
from vrbench.protocols import banaszczyk2024 as paper_chain
from vrbench.protocols.banaszczyk2024 import PROTOCOL
from vrbench.protocols.registry import builtin_protocols
from vrbench.streams import Columns, Samples
from vrbench.trajectory import NS, Trajectory

EPOCH = 1_706_706_424 * NS
TCP = "ape.translation.aligned"
ROBOTS = "repeatability.robot"
# case, metric, statistic: what the paper prints [mm], and how near this comes.
PRINTED = {
    "quest-2": {
        ("replay", TCP, "rmse"): (2.29, 0.05),
        ("replay", TCP, "mean"): (2.05, 0.05),
        ("replay", TCP, "max"): (8.32, 0.05),
        ("calibrate", TCP, "rmse"): (3.17, 0.05),
        ("calibrate", TCP, "max"): (10.48, 0.05),
        ("calibrate", "handeye.translation.to_first", "mean"): (9.3, 0.05),
        ("calibrate", "handeye.rotation.to_first", "mean"): (0.178, 0.003),
    },
    "quest-pro": {
        ("replay", TCP, "rmse"): (3.49, 0.05),
        ("replay", TCP, "mean"): (3.16, 0.05),
        ("replay", TCP, "max"): (8.83, 0.11),
        ("replay", ROBOTS, "rmse"): (1.53, 0.05),
        ("replay", ROBOTS, "max"): (3.69, 0.05),
        ("calibrate", TCP, "rmse"): (3.23, 0.05),
        ("calibrate", TCP, "max"): (11.97, 0.05),
        ("calibrate", ROBOTS, "rmse"): (0.570, 0.005),
        ("calibrate", ROBOTS, "mean"): (0.467, 0.005),
        ("calibrate", "handeye.translation.to_first", "mean"): (6.2, 0.05),
        ("calibrate", "handeye.rotation.to_first", "mean"): (0.209, 0.003),
    },
}


@pytest.mark.parametrize("headset", PRINTED)
def test_the_paper_s_numbers_come_out_of_its_recordings(paper, tmp_path, headset) -> None:
    bundle = import_recordings(
        f"banaszczyk2024-{headset}", tmp_path / "run", Plugins(), lambda *_: None
    )
    rows = evaluate(bundle, PROTOCOL.families, PROTOCOL, lambda *_: None)
    found = {(row.case, row.metric, row.statistic): row for row in rows if row.point == "tcp"}
    for key, (printed, near) in PRINTED[headset].items():
        assert found[key].value == pytest.approx(printed, abs=near), key
        assert found[key].status == "ok"
    reference = {"quest-2": "robot", "quest-pro": "robot_paper"}[headset]
    assert {row.reference for row in rows} == {reference}
    assert (bundle.folder / "metrics" / "banaszczyk2024.csv").is_file()
    assert not (bundle.folder / "calibration.json").exists()


def robot_motion(n: int = 3000, rate_hz: float = 30.0) -> Trajectory:
    """A motion with two high peaks of z, at rest for 5 s at both ends."""
    t = np.arange(n) / rate_hz
    moving = np.clip(t - 5.0, 0.0, t[-1] - 10.0)
    phase = 2 * np.pi * moving / (t[-1] - 10.0)
    z = 0.1 * (1.0 - np.cos(3 * phase)) / 2 + 0.01 * np.sin(phase)
    p = np.column_stack((0.2 * np.sin(phase), 0.1 * np.sin(2 * phase), z))
    turn = np.column_stack((0.3 * np.sin(2 * phase), 0.2 * np.sin(phase), np.sin(phase)))
    stamps = EPOCH + np.rint(t * NS).astype(np.int64)
    return Trajectory(stamps, Transform(p, rotvec_to_quat(turn)))


def take(
    headset: str = "quest-2", *, role: str = "scored", later_s: float | None = None
) -> Columns:
    """A perfect headset on the paper's mounting and clock; with a robot's log of another day."""
    robot = robot_motion()
    constants = paper_chain.HEADSETS[headset]
    metadata = {"headset": headset, "role": role}
    x = paper_chain.given_x(Columns({}, metadata=metadata))
    eye_t = np.arange(int(robot.t[0]), int(robot.t[-1]), NS // 72)
    world = Transform.of([0.3, 1.0, -0.2], [0.1, 0.7, 0.0, 0.7])
    eye = world @ robot.at(eye_t) @ x
    poses = {
        "headset/eye": Samples.of(eye_t + round(constants.offset_s * NS), eye),
        # stamped wrong by a second: only the time of receipt counts
        "robot/tcp": Samples.of(robot.t + NS, robot.pose, receive_t=robot.t),
    }
    if later_s is not None:
        paper_t = robot.t - round(later_s * NS)
        poses["robot_paper/tcp"] = Samples.of(paper_t, robot.pose)
    return Columns(poses, metadata=metadata)


def prepared(columns: Columns) -> ScoredTake:
    reference = PROTOCOL.reference(columns, "robot")
    return PROTOCOL.prepare(columns, reference, paper_chain.given_x(columns))


def numbers(columns: Columns) -> dict[tuple[str, str], float | None]:
    return {(v.metric, v.statistic): v.value for v in paper_chain.of_take(prepared(columns))}


def test_a_perfect_headset_errs_by_what_nearest_neighbours_and_whole_ms_cost() -> None:
    # at most 0.05 m/s for half a frame of 72 Hz and 1 ms
    assert 0.0 < numbers(take())[TCP, "rmse"] < 0.4


@pytest.mark.parametrize("later_s", [0.0, 2400.0])
def test_the_quest_pro_is_scored_against_the_other_run(later_s: float) -> None:
    columns = take("quest-pro", later_s=later_s)
    assert PROTOCOL.reference(columns, "robot") == "robot_paper"
    found = numbers(columns)
    assert 0.0 < found[TCP, "rmse"] < 0.4
    assert found[ROBOTS, "max"] < 1e-6


def test_without_another_log_the_robot_s_own_is_the_reference() -> None:
    columns = take()
    assert PROTOCOL.reference(columns, "robot") == "robot"
    assert PROTOCOL.reference(columns, "mocap") == "mocap"
    assert numbers(columns)[ROBOTS, "rmse"] is None


def test_hand_eye_is_of_calibrations_and_nought_for_a_perfect_one() -> None:
    assert numbers(take())["handeye.translation.to_first", "mean"] is None
    found = numbers(take(role="calibration"))
    assert 0.0 < found["handeye.translation.to_first", "mean"] < 1.0
    assert 0.0 < found["handeye.rotation.to_first", "mean"] < 0.2


def test_the_window_opens_and_closes_a_second_before_the_robot_does() -> None:
    robot = robot_motion()
    start, end = paper_chain.window(robot)
    p = robot.pose.p
    first = robot.t[np.argmax(np.linalg.norm(p - p[0], axis=1) > 0.005)]
    last = robot.t[np.flatnonzero(np.linalg.norm(p - p[-1], axis=1) > 0.005)[-1]]
    assert start == first - NS
    assert last - NS < end <= last - NS + NS // 29
    with pytest.raises(EstimationError, match="stays within 5 mm"):
        paper_chain.window(robot[:30])


def test_calibrations_are_not_cut() -> None:
    whole = len(prepared(take(role="calibration")).estimate)
    assert whole == pytest.approx(3000 - 0.27 * 30, abs=12)
    assert len(prepared(take()).estimate) < whole - 250


def test_the_headset_s_time_is_in_whole_milliseconds_rounded_down() -> None:
    columns = take()
    t = paper_chain.whole_ms(columns).t
    before = columns.poses["headset/eye"].pose_t - t
    assert not (t % 1_000_000).any()
    assert before.min() >= 0
    assert before.max() < 1_000_000


def test_x_is_the_paper_s_under_their_own_reflection() -> None:
    """x mirrored in Unity's frame, as they do, and their X: the same tcp as with ours."""
    x = paper_chain.given_x(take())
    rows = np.reshape(paper_chain.HEADSETS["quest-2"].tcp_eye, (3, 4))
    theirs = Transform.from_matrix(rows)
    unity = Transform.of([0.1, 1.2, 0.3], [0.1, -0.4, 0.2, 0.8])
    mirrored_x = Transform(unity.p * [-1, 1, 1], unity.q * [1, -1, -1, 1])
    mirrored_z = Transform(unity.p * [1, 1, -1], unity.q * [-1, -1, 1, 1])
    half_turn = paper_chain.HALF_TURN_ABOUT_Y
    ours = half_turn @ mirrored_z @ x.inverse()
    np.testing.assert_allclose((mirrored_x @ theirs.inverse()).p, ours.p, atol=1e-12)
    np.testing.assert_allclose(x.p, rows[:, 3])


def test_other_headsets_have_no_constants() -> None:
    columns = Columns({}, metadata={"headset": "quest-3"})
    with pytest.raises(DataError, match="quest-3"):
        paper_chain.given_x(columns)


def test_peaks_that_do_not_pair_are_told() -> None:
    columns = take("quest-pro", later_s=0.0)
    robot = columns.poses["robot/tcp"]
    cut = Columns(
        {**columns.poses, "robot/tcp": robot[: len(robot) // 3]}, metadata=columns.metadata
    )
    with pytest.raises(EstimationError, match=r"2 peaks of 0\.095 m against 1"):
        prepared(cut)


def test_protocols_are_found_by_their_modules() -> None:
    assert [protocol.name for protocol in builtin_protocols()] == ["banaszczyk2024", "vrbench-1"]
