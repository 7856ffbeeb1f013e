from pathlib import Path

import pytest

from vrbench.config.recordings import load_recordings
from vrbench.errors import ConfigError

TEXT = """\
suite: gameplay-replay
dataset: banaszczyk2024
lab: put-poznan
device: {headset: quest-2, firmware: "60.0.0", logger: unity}
sitting: 2024-01-31
takes:
  - case: calibrate
    headset: {format: quest-unity-csv, path: a/calib.txt}
    robot: {format: rosbag1, path: a/calib.bag, topic: /tcp}
  - case: replay
    motion: spt-dx-a
    headset: {format: quest-unity-csv, path: a/traj1.txt}
    robot: {format: rosbag1, path: a/traj1.bag, topic: /tcp}
  - case: replay
    motion: spt-dx-a
    repeat: 2
    headset: {format: quest-unity-csv, path: a/traj2.txt}
    mocap: {format: tum, path: a/traj2.tum}
"""


@pytest.fixture
def load(tmp_path):
    def load(text: str):
        path = tmp_path / "lab.yaml"
        path.write_text(text, encoding="utf-8")
        return load_recordings(path)

    return load


def test_recordings_are_what_their_file_says(load):
    recordings = load(TEXT)
    assert recordings.sitting == "2024-01-31"
    assert [(take.case, take.mount, take.repeat) for take in recordings.takes] == [
        ("calibrate", 1, 1),
        ("replay", 1, 1),
        ("replay", 1, 2),
    ]
    assert recordings.takes[2].robot is None


def test_all_further_keys_of_a_source_are_its_importers_options(load):
    robot = load(TEXT).takes[0].robot
    assert (robot.format, robot.path, robot.options) == (
        "rosbag1",
        Path("a/calib.bag"),
        {"topic": "/tcp"},
    )


@pytest.mark.parametrize(
    ("old", "new", "place", "says"),
    [
        ("lab: put-poznan", "labs: put-poznan", "3:1", "labs: .*1 more besides"),
        ("lab: put-poznan\n", "", "1:1", "lab: is missing"),
        ("lab: put-poznan", "lab: p\nlabs: p", "4:1", "labs: .*no such field .*lab, device"),
        ("headset: quest-2", "headset: Quest 2", "4:10", r"device\.headset: found 'Quest 2'"),
        ("logger: unity", "log: unity", "4:48", r"device\.log: .*headset, firmware, logger"),
        ("sitting: 2024-01-31", "sitting: 1", "5:1", 'sitting: found 1 .*quotes: "1"'),
        ("path: a/calib.txt", "file: a/calib.txt", "8:5", r"takes\.0\.headset\.path: is missing"),
        ("repeat: 2", "repeats: 2", "16:5", r"takes\.2\.repeats: .*case, mount, repeat"),
        ("repeat: 2", "repeat: 0", "16:5", r"takes\.2\.repeat: found 0"),
        ("repeat: 2", "repeat: 1", "1:1", "two takes are case replay mount 1 repeat 1 .*repeat"),
        ("repeat: 2", "repeat: 2\n    speed: 1.24", "1:1", "case replay differ .*file for each"),
        (
            "    mocap: {format: tum, path: a/traj2.tum}\n",
            "",
            "14:5",
            r"takes\.2: no reference .*mocap",
        ),
    ],
)
def test_an_error_says_where_what_and_what_would_be_right(load, old, new, place, says):
    assert TEXT.count(old) == 1
    with pytest.raises(ConfigError, match=rf"lab\.yaml:{place}: .*{says}") as error:
        load(TEXT.replace(old, new))
    assert error.value.fix


def test_recordings_without_takes_are_none(load):
    with pytest.raises(ConfigError, match=r"lab\.yaml:6:1: takes: "):
        load(TEXT.partition("takes:")[0] + "takes: []\n")
