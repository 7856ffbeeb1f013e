"""The recordings files that come with vrbench, against the datasets they refer to."""

from pathlib import Path

import pytest
import yaml

from vrbench.recording.datasets import known
from vrbench.recording.importers import rosbag1

FOLDER = Path(__file__).parents[2] / "recordings"
FILES = {path.stem: yaml.safe_load(path.read_text("utf-8")) for path in FOLDER.glob("*.yaml")}


def sources(content):
    return [
        (stream, take[stream])
        for take in content["takes"]
        for stream in ("headset", "robot", "robot_paper", "mocap")
        if stream in take
    ]


def test_each_headset_and_speed_of_the_paper_has_a_file_of_its_own():
    seen = {
        name: (content["device"]["headset"], content["takes"][-1]["speed"])
        for name, content in FILES.items()
        if content["suite"] == "gameplay-replay"
    }
    assert seen == {
        "banaszczyk2024-quest-2": ("quest-2", 1.0),
        "banaszczyk2024-quest-2-traj2": ("quest-2", 1.24),
        "banaszczyk2024-quest-pro": ("quest-pro", 1.0),
        "banaszczyk2024-quest-pro-traj2": ("quest-pro", 1.24),
    }


@pytest.mark.parametrize("name", FILES)
def test_every_path_is_a_file_of_the_dataset(name):
    files = known(FILES[name]["dataset"]).files
    for _, source in sources(FILES[name]):
        assert source["path"] in files


@pytest.mark.parametrize("name", [name for name in FILES if "quest" in name])
def test_streams_of_a_take_belong_to_the_same_headset_and_motion(name):
    content = FILES[name]
    folder = content["device"]["headset"].replace("quest-2", "quest2").replace("-", "_")
    for take in content["takes"]:
        parts = {Path(take[stream]["path"]).parts[2] for stream in ("headset", "robot")}
        stems = {Path(take[stream]["path"]).stem for stream in ("headset", "robot")}
        assert parts == {folder}
        assert len(stems) == 1
    assert [take["case"] for take in content["takes"]] == ["calibrate", "replay"]


@pytest.mark.parametrize("name", [name for name in FILES if "quest" in name])
def test_the_quest_pro_has_the_robot_s_log_of_the_quest_2_besides(name):
    for take in FILES[name]["takes"]:
        if FILES[name]["device"]["headset"] == "quest-2":
            assert "robot_paper" not in take
        else:
            own = take["robot"]["path"]
            assert take["robot_paper"]["path"] == own.replace("quest_pro", "quest2")


@pytest.mark.parametrize("name", FILES)
def test_options_are_those_of_the_importers(name):
    for stream, source in sources(FILES[name]):
        options = {k: v for k, v in source.items() if k not in ("format", "path")}
        if stream == "headset":
            assert (source["format"], options) == ("quest-unity-csv", {})
        else:
            assert source["format"] == rosbag1.IMPORTER.name
            rosbag1.IMPORTER.options.model_validate(options)
