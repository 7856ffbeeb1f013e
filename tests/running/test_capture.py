"""A suite that a person moves, on a simulated rig: from the take to the motion at the eye."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from vrbench.cli._motion_extract import extract
from vrbench.cli.record import command as record
from vrbench.errors import ConfigError
from vrbench.geometry import Transform, relative_angle
from vrbench.motion.files import read_motion
from vrbench.motion.generators import generate
from vrbench.results.bundle import Bundle

RIG = """
lab: simulated
headset: {plugin: sim, device: sim}
mocap: {plugin: sim, options: {body: headset, lost_per_minute: 0.0}}
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("capture")
    (folder / "rig.yaml").write_text(RIG)
    arguments = ["head-capture", "--rig", str(folder / "rig.yaml"), "-o", str(folder / "run")]
    ran = CliRunner().invoke(record, arguments, catch_exceptions=False)
    assert ran.exit_code == 0
    return Bundle.open(folder / "run")


def test_every_take_of_the_suite_is_recorded_with_mocap_and_headset(run):
    assert [take.name.split(".")[0] for take in run.record.takes] == [
        "calibrate",
        "play",
        "calibrate",
    ]
    assert (run.record.kind, run.record.references) == ("simulated", ["mocap"])
    columns = run.columns(run.record.takes[1])
    assert set(columns.poses) == {"mocap/headset", "headset/eye"}
    assert len(columns.clocks["mocap"]) > 100
    assert columns.metadata["motion"] == "free"


def test_the_motion_extracted_is_what_the_eye_did(run, tmp_path):
    out = tmp_path / "head.tum"
    arguments = [str(run.folder), "--name", "simulated", "--start", "1.5", "-o", str(out)]
    permitted = ["--licence", "CC0-1.0", "--consent", "simulated"]
    assert CliRunner().invoke(extract, [*arguments, *permitted]).exit_code == 0
    found = read_motion(out).trajectory
    # the eye moved as shooter-1 and slipped on its mount; a second of rest came before it
    truth = json.loads((run.folder / "truth" / f"{run.record.takes[1].name}.json").read_text())
    x = Transform.of(truth["headset"]["tcp_eye"]["p_m"], truth["headset"]["tcp_eye"]["q_xyzw"])
    nominal = Transform.of((0.003, 0.087, 0.276), (0.70710678, 0.0, 0.0, 0.70710678))
    slipped = generate("shooter-1").trajectory.mapped(lambda pose: pose @ nominal.inverse() @ x)
    t = found.t + round(0.5e9) + 2_000_000
    inside = t < slipped.t[-1]
    want = slipped.at(t[inside])
    want = want[0].inverse() @ want
    off = np.linalg.norm(found.pose.p[inside] - want.p, axis=1)
    assert np.median(off) < 0.003
    assert np.median(relative_angle(found.pose.q[inside], want.q)) < 0.005


def test_a_motion_without_permission_is_not_extracted(run, tmp_path):
    arguments = [str(run.folder), "--name", "simulated", "-o", str(tmp_path / "head.tum")]
    with pytest.raises(ConfigError, match="a person's motion needs licence"):
        CliRunner().invoke(extract, arguments, standalone_mode=False, catch_exceptions=False)


@pytest.mark.parametrize(
    ("rig", "says"),
    [
        (RIG.replace("mocap:", "environment:").replace("plugin: sim, options", "o"), "has none"),
        (
            RIG.replace("mocap: {plugin: sim", "mocap: {plugin: other"),
            "is simulated, and other devices",
        ),
        (RIG.replace("plugin: sim", "plugin: other"), "needs a licence and their consent"),
    ],
)
def test_what_the_rig_or_the_person_lacks_is_told(tmp_path, rig, says):
    (tmp_path / "rig.yaml").write_text(rig)
    arguments = ["head-capture", "--rig", str(tmp_path / "rig.yaml"), "-o", str(tmp_path / "run")]
    with pytest.raises(ConfigError, match=says):
        CliRunner().invoke(record, arguments, standalone_mode=False, catch_exceptions=False)
    assert not (tmp_path / "run").exists()
