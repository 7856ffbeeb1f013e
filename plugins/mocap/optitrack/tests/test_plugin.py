import subprocess
import sys
import tomllib
from pathlib import Path

import pluggy
import pytest
import vrbench_optitrack
from click.testing import CliRunner
from pydantic import ValidationError
from vrbench_optitrack.emulator import main
from vrbench_optitrack.options import Options

HERE = Path(__file__).parents[1]


def test_the_entry_point_names_the_package():
    project = tomllib.loads((HERE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["entry-points"] == {"vrbench": {"optitrack": vrbench_optitrack.__name__}}
    assert project["name"] == "vrbench-optitrack"


def test_the_hook_gives_motive_with_check_and_emulator():
    manager = pluggy.PluginManager("vrbench")
    manager.register(vrbench_optitrack, "optitrack")
    ((spec,),) = manager.hook.vrbench_mocap()
    assert spec.name == "optitrack"
    assert spec.check is not None
    assert spec.emulator == "vrbench_optitrack.emulator"


def test_the_plugin_is_listed_without_loading_numpy():
    code = "import sys, vrbench_optitrack; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    "wrong",
    [
        {},
        {"body": ""},
        {"body": "b", "up": "x"},
        {"body": "b", "echo_hz": 50},
        {"body": "b", "bitstream": "2.9"},
        {"body": "b", "server_address": "127.0.0.1"},
    ],
)
def test_options_that_are_wrong_are_refused(wrong):
    with pytest.raises(ValidationError):
        Options.model_validate(wrong)


def test_the_bitstream_is_a_version():
    assert Options(body="b", bitstream="4.1").wanted == (4, 1)
    assert Options(body="b").wanted is None


RIG = """
lab: test
headset: {{plugin: sim, device: sim}}
mocap: {{plugin: optitrack, options: {{server: 127.0.0.1, command_port: {port}, body: {body}}}}}
"""


def vrbench(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "vrbench", *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=30,
    )


def test_rig_check_says_what_is_there_and_what_is_wrong(motive, tmp_path):
    server = motive()
    rig = tmp_path / "lab.yaml"
    rig.write_text(RIG.format(port=server.port, body="headset"))
    ran = vrbench("rig", "check", str(rig))
    # this rig's headset rides on a simulated stage, and a run with it would be refused
    assert (ran.returncode, ran.stderr) == (1, "1 thing is wrong\n")
    assert "WRONG headset: is simulated, and other devices of the rig are not" in ran.stdout
    assert "ok    headset sim: simulated" in ran.stdout
    assert "ok    mocap optitrack: Motive 3.1 answers" in ran.stdout
    rig.write_text(RIG.format(port=server.port, body="hmd"))
    ran = vrbench("rig", "check", str(rig))
    assert ran.returncode == 1
    assert "WRONG mocap optitrack: Motive has no rigid body 'hmd'" in ran.stdout
    assert "fix: there are 'controller', 'headset'" in ran.stdout
    rig.write_text(RIG.format(port=server.port, body="b, up: x"))
    ran = vrbench("rig", "check", str(rig))
    assert ran.returncode == 2
    assert "mocap.options.up: found 'x'" in ran.stderr


@pytest.mark.parametrize(
    ("option", "value", "says"),
    [
        ("--host", "192.0.2.1", "'192.0.2.1' isn't a loopback address"),
        ("--group", "1.2.3.4", "'1.2.3.4' isn't a multicast address"),
        ("--version", "4.3", "'4.3' isn't a version of NatNet from 2.5 to 4.2"),
        ("--motion", "nosuch", "'nosuch' is not one of"),
        ("--frequency", "0", "0 is not in the range"),
        ("--unit-mm", "0", "0.0 is not in the range"),
    ],
)
def test_the_emulator_refuses_what_no_motive_has(option, value, says):
    ran = CliRunner().invoke(main, [option, value, "--duration", "0.1"])
    assert ran.exit_code == 2
    assert says in ran.output


def test_plugin_emulate_runs_the_emulator_with_its_own_arguments():
    more = ("--command-port", "0", "--data-port", "0", "--duration", "0.2", "--version", "3.1")
    ran = vrbench("plugin", "emulate", "optitrack", "--", *more)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert '"version": "3.1"' in ran.stdout
    ran = vrbench("plugin", "emulate", "nothing")
    assert ran.returncode == 2
    assert "no emulator of 'nothing' (there are optitrack" in ran.stderr
