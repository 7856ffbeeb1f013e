import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pluggy
import pytest
import vrbench_ur
import yaml
from vrbench_ur.primary import read_kinematics
from vrbench_ur.search import quiet
from vrbench_ur.specs import ROBOTS
from vrbench_ur.testing import nod

from vrbench.config.rig import load_rig
from vrbench.config.suite import Suite
from vrbench.devices.permit import SHOWN, Permit
from vrbench.errors import ConfigError
from vrbench.plugin.manager import Plugins
from vrbench.running.permission import permission, plan_suite
from vrbench.trajectory import write_tum

HERE = Path(__file__).parents[1]
START = {"p_m": [0.5754, 0.0082, 0.8157], "yaw_deg": -85.53}
RIG = {
    "lab": "example",
    "headset": {"plugin": "webxr", "device": "quest-2"},
    "robot": {"plugin": "ur5e", "options": {"host": "127.0.0.77", "start": START}},
}


@pytest.fixture
def rig(tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text(yaml.safe_dump(RIG), encoding="utf-8")
    return path


def vrbench(*words, cwd):
    return subprocess.run(
        [sys.executable, "-m", "vrbench", *map(str, words)],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        stdin=subprocess.DEVNULL,
        env={**os.environ, "COLUMNS": "200"},
    )


def test_the_entry_point_names_the_package():
    project = tomllib.loads((HERE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["entry-points"] == {"vrbench": {"ur": vrbench_ur.__name__}}
    assert project["name"] == "vrbench-ur"


def test_the_hook_gives_three_arms():
    manager = pluggy.PluginManager("vrbench")
    manager.register(vrbench_ur, "ur")
    (robots,) = manager.hook.vrbench_robots()
    assert [x.name for x in robots] == ["ur3e", "ur5e", "ur10e"]
    assert all(robot.real and robot.planner for robot in robots)


def test_listing_and_planning_need_no_control_library():
    code = (
        "import sys, vrbench_ur; assert 'numpy' not in sys.modules\n"
        "import vrbench_ur.specs; assert 'pinocchio' not in sys.modules\n"
        "import vrbench_ur.planner; sys.exit('rtde_control' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("spec", ROBOTS, ids=lambda spec: spec.name)
def test_every_arm_has_an_emulator_that_tells_its_options(spec):
    ran = subprocess.run(
        [sys.executable, "-m", spec.emulator, "--help"], capture_output=True, text=True, check=True
    )
    assert "--host" in ran.stdout


def test_a_motion_file_is_planned_from_the_command_line(tmp_path, rig):
    write_tum(nod(), tmp_path / "nod.tum")
    done = vrbench("motion", "plan", "nod.tum", "--rig", rig, "-o", "plan.json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "strict 1.000" in done.stdout
    told = json.loads((tmp_path / "plan.json").read_text(encoding="utf-8"))
    assert told["arm"] == "ur5e"
    assert (tmp_path / "plan.svg").is_file()


def test_a_motion_that_cannot_be_done_is_one_error_and_exit_code_1(tmp_path, rig):
    write_tum(nod(), tmp_path / "nod.tum")
    for limits, payload, code, why in (
        ({"speed_percent": 3.0}, {}, 1, "a stretch of "),
        ({}, {"kg": 9.0}, 2, "above the payload of ur5e"),
    ):
        told = {"start": START, "limits": limits, "payload": payload}
        changed = {**RIG, "robot": {"plugin": "ur5e", "options": told}}
        rig.write_text(yaml.safe_dump(changed), encoding="utf-8")
        done = vrbench("motion", "plan", "nod.tum", "--rig", rig, cwd=tmp_path)
        assert done.returncode == code
        assert why in done.stderr
        assert "Traceback" not in done.stderr


def suite():
    return Suite.model_validate(
        {
            "suite": "short",
            "version": 1,
            "title": "Short",
            "motions": {"calibration": "saturate-30s-1"},
            "cases": [
                {"id": "calibrate", "motion": "calibration", "role": "calibration"},
                {"id": "slow", "motion": "calibration", "speed": 0.5},
            ],
            "metrics": ["ape"],
            "rank": {"metric": "ape.translation.aligned"},
        }
    )


def test_all_motions_of_a_suite_are_planned_before_anything_moves(rig):
    planned = plan_suite(suite(), load_rig(str(rig)), str(rig), Plugins(), quiet)
    assert planned.robot == "ur5e at 127.0.0.77"
    assert set(planned.plans) == {("saturate-30s-1", 1.0), ("saturate-30s-1", 0.5)}
    with pytest.raises(ConfigError, match="dry run"):
        permission(planned, None)
    asked = []
    allowed = permission(planned, planned.hash[:SHOWN])
    object.__setattr__(allowed, "ask", lambda *told: asked.append(told))
    permit = Permit()
    permit.grant(planned.hashes)
    allowed.again(permit)
    # what was granted is taken back before anybody is asked
    assert asked == [("ur5e at 127.0.0.77", planned.hashes, permit)]
    assert not permit.allows(planned.hashes[0])


def test_a_run_on_a_real_arm_is_a_dry_run_that_says_the_hash(tmp_path, rig):
    text = yaml.safe_dump(suite().model_dump(mode="json", by_alias=True))
    (tmp_path / "short.yaml").write_text(text, encoding="utf-8")
    done = vrbench("record", "short.yaml", "--rig", rig, "-o", "run", cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert "dry run" in done.stderr
    assert "--execute " in done.stderr
    assert not (tmp_path / "run").exists()


def test_a_simulated_headset_on_a_real_arm_is_refused_before_anything_is_planned(rig):
    rig.write_text(yaml.safe_dump({**RIG, "headset": {"plugin": "sim"}}), encoding="utf-8")
    told = []
    with pytest.raises(ConfigError, match="is simulated, and other devices of the rig are not"):
        plan_suite(suite(), load_rig(str(rig)), str(rig), Plugins(), lambda *x: told.append(x))
    assert told == []


def test_execute_means_nothing_on_a_simulated_rig(tmp_path):
    done = vrbench("record", "calibration", "--rig", "sim", "--execute", "0" * 12, cwd=tmp_path)
    assert done.returncode == 2
    assert "no real robot moves on this rig" in done.stderr


def test_without_pinocchio_the_plugin_is_listed_and_says_what_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    for name in ("cell", "planner", "planning", "robot", "plan_file", "search", "checks"):
        monkeypatch.delitem(sys.modules, f"vrbench_ur.{name}", raising=False)
    with pytest.raises(ConfigError, match="pinocchio is not installed"):
        ROBOTS[0].planner(ROBOTS[0].options(), None)


@pytest.mark.skipif(sys.platform != "linux", reason="addresses of loopback are Linux's")
def test_the_emulator_is_a_command_and_ends_with_it():
    host = f"127.98.{os.getpid() % 250 + 1}.1"
    running = subprocess.Popen(
        [sys.executable, "-m", "vrbench", "plugin", "emulate", "ur3e", "--", "--host", host],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert running.stdout.readline() == f"ready: ur3e at {host}\n"
        assert read_kinematics(host, 5.0).a[1] == pytest.approx(-0.24355)
    finally:
        running.terminate()
        running.wait(20)
        running.stdout.close()
    assert running.returncode == 0
    assert read_kinematics(host, 0.5) is None
