"""The importer on the paper's own logs."""

import numpy as np
import pytest
from vrbench_quest.unity_log import IMPORTER

from vrbench.errors import VrbenchError
from vrbench.recording.datasets import State, find, known, status
from vrbench.recording.importer import NoOptions

NAME = "banaszczyk2024"
# Measured on the files: whole lines, gaps over 25 ms, first stamp, largest step [mm], rounded up.
# The steps of 39 and 51 mm stand where the robot brakes at the end of traj1.
LOGS = {
    "quest2/center_eye_data/calib.txt": (16869, 0, "2024-01-31T13:00:50.693178", 8),
    "quest2/center_eye_data/traj1.txt": (9874, 1, "2024-01-31T13:07:04.628678", 51),
    "quest_pro/center_eye_data/calib.txt": (16514, 3, "2024-01-31T13:49:31.026087", 9),
    "quest_pro/center_eye_data/traj1.txt": (9426, 0, "2024-01-31T13:54:56.574025", 39),
}


@pytest.fixture(params=LOGS)
def log(request):
    path = f"data/experiments/{request.param}"
    try:
        folder = find(NAME)
    except VrbenchError:
        pytest.skip(f"dataset {NAME} is not here: {known(NAME).how_to_get}")
    state = next(x.state for x in status(NAME) if x.path == path)
    if state is not State.PRESENT:
        pytest.skip(f"{path} of {NAME} is {state}")
    return IMPORTER.read(folder / path, NoOptions()), LOGS[request.param]


def test_every_whole_line_is_a_pose_and_the_cut_one_is_recorded(log):
    imported, (lines, *_) = log
    assert len(imported.samples) == lines
    assert imported.repairs == (f"line {lines + 1} left out: the file ends in the midst of it",)


def test_stamps_are_utc_at_72_hz(log):
    imported, (_, gaps, start, _) = log
    t = imported.samples.pose_t
    assert np.datetime64(int(t[0]), "ns") == np.datetime64(start)
    interval_ms = np.diff(t) / 1e6
    assert 1e3 / interval_ms.mean() == pytest.approx(72.0, abs=0.03)
    assert 0.2 < interval_ms.std() < 0.4
    assert np.count_nonzero(interval_ms > 25) == gaps
    assert np.all(interval_ms > 0)


def test_the_jumps_as_the_robot_brakes_are_kept(log):
    imported, (*_, largest_mm) = log
    steps_mm = 1e3 * np.linalg.norm(np.diff(imported.samples.pose.p, axis=0), axis=1)
    assert largest_mm - 1 < steps_mm.max() < largest_mm


def test_quaternions_are_of_unit_length_and_never_change_sides(log):
    q = log[0].samples.pose.q
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-12)
    assert np.all(np.sum(q[1:] * q[:-1], axis=1) > 0.9)
