"""From recordings of a person, by way of a run, to a motion file at the eye."""

import numpy as np
import pytest
from click.testing import CliRunner

from vrbench.cli._motion_extract import extract
from vrbench.errors import ConfigError, VrbenchError
from vrbench.extraction import find_take
from vrbench.geometry import Transform, relative_angle, rotvec_to_quat
from vrbench.importing import import_recordings
from vrbench.motion.files import read_motion
from vrbench.motion.generators import generate
from vrbench.plugin.manager import Plugins
from vrbench.recording.datasets import find
from vrbench.results.bundle import Bundle
from vrbench.trajectory import NS, Trajectory, write_tum

START = 1_700_000_000 * NS
X = Transform.of([0.03, -0.06, 0.08], [0.1, -0.2, 0.05, 0.97])
ROOM = Transform.of([0.3, 1.2, 0.1], rotvec_to_quat(np.array([0.0, 0.7, 0.0])))
PERSON = """licence: CC-BY-4.0
consent: written, for publication
"""


def recorded(folder, name, motion, start):
    """The head as mocap sees its body and as the headset sees its eye, in a world of its own."""
    path = generate(motion).trajectory
    eye = Trajectory(path.t + start, ROOM @ path.pose)
    write_tum(eye.mapped(lambda pose: pose @ X.inverse()), folder / f"{name}-mocap.tum")
    world = Transform.of([1.0, 0.2, -3.0], rotvec_to_quat(np.array([0.0, -1.1, 0.0])))
    rng = np.random.default_rng(start % 1000)
    n = len(eye)
    error = Transform(rng.normal(0, 3e-4, (n, 3)), rotvec_to_quat(rng.normal(0, 3e-4, (n, 3))))
    seen = eye.mapped(lambda pose: world @ pose @ error)
    write_tum(Trajectory(seen.t + 13_000_000, seen.pose), folder / f"{name}-eye.tum")
    return eye


def take(case, name, motion="", repeat=1, headset=True):
    lines = [f"  - case: {case}", f"    repeat: {repeat}"]
    if motion:
        lines.append(f"    motion: {motion}")
    if headset:
        lines.append(f"    headset: {{format: tum, path: {name}-eye.tum}}")
    return "\n".join([*lines, f"    mocap: {{format: tum, path: {name}-mocap.tum}}"])


def recordings(folder, takes, person=PERSON):
    path = folder / "capture.yaml"
    head = "suite: head-capture\nlab: example\ndevice: {headset: quest-2}\n"
    path.write_text(head + person + "takes:\n" + "\n".join(takes) + "\n")
    return str(path)


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    folder = tmp_path_factory.mktemp("capture")
    recorded(folder, "first", "saturate-30s-1", START)
    eye = recorded(folder, "play", "saturate-30s-1", START + 100 * NS)
    recorded(folder, "last", "saturate-30s-1", START + 200 * NS)
    takes = [take("calibrate", "first"), take("play", "play", "seated-shooter")]
    takes.append(take("calibrate", "last", repeat=2))
    path = recordings(folder, takes)
    run = import_recordings(path, folder / "run", Plugins(), lambda *_: None)
    return folder, run, eye


def run_extract(*arguments):
    return CliRunner().invoke(extract, list(map(str, arguments)), standalone_mode=True)


def test_the_motion_file_is_the_eyes_motion(capture, tmp_path):
    _, run, eye = capture
    assert run.record.licence == "CC-BY-4.0"
    out = tmp_path / "head.tum"
    ran = run_extract(run.folder, "--name", "seated-shooter", "--rate", 60, "-o", out)
    assert ran.exit_code == 0, ran.output
    motion = read_motion(out)
    want = eye.pose[0].inverse() @ eye.at(motion.trajectory.t + eye.t[0])
    assert np.linalg.norm(motion.trajectory.pose.p - want.p, axis=1).max() < 5e-4
    assert relative_angle(motion.trajectory.pose.q, want.q).max() < 1e-3
    assert motion.name == "seated-shooter-1"
    assert "consent: written, for publication" in out.read_text()


def test_a_part_of_the_take_and_the_body_can_be_had(capture, tmp_path):
    _, run, eye = capture
    out = tmp_path / "part.tum"
    more = ("--start", 5, "--end", 15, "--at", "body")
    assert run_extract(run.folder, "--name", "part", *more, "-o", out).exit_code == 0
    motion = read_motion(out)
    assert motion.trajectory.duration_s == pytest.approx(10.0, abs=0.02)
    body = eye.between(eye.t[0] + 5 * NS, eye.t[0] + 15 * NS).mapped(lambda p: p @ X.inverse())
    want = body.pose[0].inverse() @ body.at(motion.trajectory.t + body.t[0])
    assert np.linalg.norm(motion.trajectory.pose.p - want.p, axis=1).max() < 1e-4


@pytest.mark.parametrize(("option", "value"), [("--start", -1), ("--rate", 0), ("--rate", 1e9)])
def test_what_no_motion_has_is_refused(capture, tmp_path, option, value):
    _, run, _ = capture
    ran = run_extract(run.folder, "--name", "x", option, value, "-o", tmp_path / "x.tum")
    assert ran.exit_code == 2
    assert f"Invalid value for '{option}'" in ran.output


@pytest.mark.parametrize("missing", ["licence", "consent"])
def test_a_persons_motion_without_permission_is_refused(capture, missing):
    folder, run, _ = capture
    said = "".join(line + "\n" for line in PERSON.splitlines() if not line.startswith(missing))
    path = recordings(folder, [take("play", "play", "seated-shooter")], said)
    with pytest.raises(ConfigError, match=f"{missing}: suite head-capture@1 records a person's"):
        import_recordings(path, folder / "refused", Plugins(), lambda *_: None)
    assert not (folder / "refused").exists()
    record = run.folder / "run.json"
    kept = record.read_text()
    try:
        record.write_text(kept.replace(getattr(run.record, missing), "none"))
        with pytest.raises(ConfigError, match=f"a person's motion needs {missing}"):
            Bundle.open(run.folder)
    finally:
        record.write_text(kept)


def test_a_take_that_isnt_there_is_told(capture, tmp_path):
    folder, run, _ = capture
    with pytest.raises(ConfigError, match=r"--take: no take is called 'gone' \(there are calibra"):
        find_take(run, "gone")
    path = recordings(folder, [take("calibrate", "first")])
    unscored = import_recordings(path, tmp_path / "run", Plugins(), lambda *_: None)
    with pytest.raises(ConfigError, match=r"--take: no take is scored \(there are calibrate"):
        find_take(unscored, None)


def test_the_papers_head_motion_is_imported_and_extracted(tmp_path):
    try:
        folder = find("banaszczyk2024")
    except VrbenchError as error:
        pytest.skip(str(error))
    if not list(folder.rglob("real_world_head_movement_example_0.bag")):
        pytest.skip("the dataset's head motion isn't here")
    run = import_recordings("banaszczyk2024-head", tmp_path / "run", Plugins(), lambda *_: None)
    out = tmp_path / "head.tum"
    assert run_extract(run.folder, "--name", "put", "--at", "body", "-o", out).exit_code == 0
    path = read_motion(out).trajectory
    # measured on the file: 112.3 s, 12.5 m, 0.875 m/s at most and 0.169 rms
    assert path.duration_s == pytest.approx(112.3, abs=0.1)
    assert path.speed().max() == pytest.approx(0.875, abs=0.03)
    assert np.sqrt(np.mean(path.speed() ** 2)) == pytest.approx(0.169, abs=0.005)
    steps = np.linalg.norm(np.diff(path.pose.p, axis=0), axis=1)
    assert steps.sum() == pytest.approx(12.5, abs=0.5)


def test_a_capture_without_a_headset_gives_the_bodys_motion_only(capture, tmp_path):
    folder, _, _ = capture
    path = recordings(folder, [take("play", "play", "seated-shooter", headset=False)])
    run = import_recordings(path, tmp_path / "run", Plugins(), lambda *_: None)
    out = tmp_path / "head.tum"
    ran = run_extract(run.folder, "--name", "body", "-o", out)
    assert ran.exit_code == 1
    assert "no calibration of the take's mount is of use: there is none" in str(ran.exception)
    assert not out.exists()
    assert run_extract(run.folder, "--name", "body", "--at", "body", "-o", out).exit_code == 0
