import numpy as np
import pytest

from vrbench.config.rig import load_rig
from vrbench.errors import ConfigError

TEXT = """\
lab: example
headset: {plugin: webxr, device: quest-pro, options: {listen: 192.168.1.5:8765}, firmware: "60.0"}
mocap: {plugin: optitrack, options: {body: headset, up: y}}
robot:
  plugin: ur5e
  options: {host: 192.168.1.20}
mounting:
  tcp_eye:
    p_m: [0.003, 0.087, 0.276]
    q_xyzw: [0.7071, 0, 0, 0.7071]
environment: {lux: 400, room: lab 2, since: 2024-01-31}
"""


@pytest.fixture
def load(tmp_path):
    def load(text: str):
        path = tmp_path / "lab.yaml"
        path.write_text(text, encoding="utf-8")
        return load_rig(str(path))

    return load


def test_a_rig_is_what_its_file_says(load):
    rig = load(TEXT)
    assert rig.headset.model == "quest-pro"
    assert rig.headset.options == {"listen": "192.168.1.5:8765"}
    assert rig.robot.plugin == "ur5e"
    assert rig.mocap.options == {"body": "headset", "up": "y"}
    assert rig.environment == {"lux": 400, "room": "lab 2", "since": "2024-01-31"}


def test_the_mounting_is_a_unit_transform(load):
    mounting = load(TEXT).mounting.tcp_eye.transform()
    np.testing.assert_allclose(mounting.p, [0.003, 0.087, 0.276])
    assert np.linalg.norm(mounting.q) == pytest.approx(1.0, abs=1e-12)


def test_the_ranked_model_is_the_plugin_where_no_device_is_named(load):
    rig = load("lab: example\nheadset: {plugin: quest-3}\n")
    assert rig.headset.model == "quest-3"
    assert (rig.robot, rig.mocap, rig.headset.firmware) == (None, None, "unknown")


@pytest.mark.parametrize(
    ("old", "new", "place", "says"),
    [
        ("lab: example\n", "", "1:1", "lab: is missing"),
        ("lab: example", 'lab: ""', "1:1", "lab: found '' .*at least 1 character"),
        ("robot:", "robots:", "4:1", "robots: .*no such field .*robot, mocap, mounting"),
        (
            "plugin: ur5e",
            "plugins: ur5e",
            "5:3",
            r"robot\.plugins: .*1 more besides.*plugin, options",
        ),
        ('"60.0"', "60.0", "2:82", r'headset\.firmware: found 60.0 .*quotes: "60.0"'),
        ("{host: 192.168.1.20}", "[]", "6:3", r"robot\.options: .*dictionary"),
        ("[0.003, 0.087, 0.276]", "[0.003, 0.087]", "9:5", r"p_m\.2: is missing"),
        ("0.003,", "far,", "9:11", r"p_m\.0: found 'far' .*valid number"),
        ("0.003,", "nan,", "9:11", r"p_m\.0: found 'nan' .*finite"),
        ("[0.7071, 0, 0, 0.7071]", "[1, 0, 0, 1]", "10:5", "unit quaternion.* length 1.414"),
        ("[0.7071, 0, 0, 0.7071]", "[0, 0, 0, nan]", "10:23", r"q_xyzw\.3: .*finite"),
    ],
)
def test_an_error_says_where_what_and_what_would_be_right(load, old, new, place, says):
    assert TEXT.count(old) == 1
    with pytest.raises(ConfigError, match=rf"lab\.yaml:{place}: .*{says}") as error:
        load(TEXT.replace(old, new))
    assert error.value.fix


@pytest.mark.parametrize(
    ("name", "model"),
    [("sim", "quest-2"), ("sim:quest-2", "quest-2"), ("sim:quest-pro", "quest-pro")],
)
def test_simulated_rigs_need_no_file(name, model):
    rig = load_rig(name)
    assert rig.headset.plugin == rig.robot.plugin == "sim"
    assert rig.headset.model == model


@pytest.mark.parametrize("name", ["none.yaml", "simulated", "."])
def test_what_is_no_rig_says_what_one_is(name):
    with pytest.raises(ConfigError, match=r"no such rig file .*\.yaml file, or sim:DEVICE"):
        load_rig(name)


def robot(load, line):
    return load(TEXT.replace("  options: {host: 192.168.1.20}\n", line)).robot


def test_what_a_robot_carries_and_what_stands_around_it_are_options_of_it(load, tmp_path):
    (tmp_path / "table.yaml").write_text("table_m: -0.01\n", encoding="utf-8")
    wanted = {
        "host": "h",
        "tcp": [0, 0, 0.1, 0, 0, 0],
        "payload": {"kg": 1.9},
        "workspace": {"table_m": -0.01},
    }
    beside = robot(
        load,
        "  options: {host: h}\n  tcp: [0, 0, 0.1, 0, 0, 0]\n  payload: {kg: 1.9}\n"
        "  workspace: table.yaml\n",
    )
    assert beside.options == wanted
    inside = robot(
        load,
        "  options: {host: h, tcp: [0, 0, 0.1, 0, 0, 0], payload: {kg: 1.9}, "
        "workspace: table.yaml}\n",
    )
    assert inside.options == wanted
    # errors name a field as the file has it
    assert beside.beside_options == ("tcp", "payload", "workspace")
    assert inside.beside_options == ()
    # and what is kept with a run has each of them once
    assert beside.model_dump() == inside.model_dump()


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("  workspace: nowhere.yaml\n", r"nowhere.yaml: no such file"),
        ("  options: {payload: {kg: 1}}\n  payload: {kg: 2}\n", r"robot.payload: is given twice"),
    ],
)
def test_a_robot_line_that_is_wrong_is_told(load, line, says):
    with pytest.raises(ConfigError, match=says):
        robot(load, line)
