"""A run that meets trouble: what is kept of it, what is told, and how it is gone on with."""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import Quiet, evaluated
from vrbench.cli import cli
from vrbench.config.rig import load_rig
from vrbench.config.suite import Suite, load_suite
from vrbench.devices.simulated.headset import SimulatedHeadset
from vrbench.devices.simulated.robot import SimulatedRobot
from vrbench.errors import ConfigError, DeviceError
from vrbench.plugin.manager import Plugins
from vrbench.recording.guard import DiskFullError
from vrbench.recording.take import read_take
from vrbench.results.bundle import Bundle
from vrbench.results.lock import locked
from vrbench.runner import InterruptedRunError, record_suite
from vrbench.running.forecast import run_bytes
from vrbench.running.opening import nominal_rates
from vrbench.streams import Columns

STEPS = ["calibrate.default.m1.r1", "replay.default.m1.r1", "replay.default.m1.r2"]
STEPS += ["calibrate.default.m1.r2"]


class Watcher(Quiet):
    """Remembers what it is told, and does something when the movement of a take goes on."""

    def __init__(self, act=lambda take: None):
        self.takes, self.notices, self.last, self._act = [], [], None, act

    def take(self, name, index, total):
        self.takes.append(name)

    def moving(self, progress):
        self.last = progress
        self._act(self.takes[-1])

    def notice(self, text):
        self.notices.append(text)


def run(suite, folder, watcher=None, **more) -> Bundle:
    rig = more.pop("rig", load_rig("sim:sim"))
    plugins = more.pop("plugins", Plugins())
    return record_suite(suite, rig, "sim:sim", folder, plugins, watcher=watcher or Quiet(), **more)


def statuses(folder: Path) -> dict[str, str]:
    return {take.name: take.status for take in Bundle.begun(folder).record.takes}


@pytest.fixture
def going_on(short_suite: Suite) -> Suite:
    return short_suite.model_copy(update={"on_loss": "continue"})


def fail_reading(monkeypatch, device, take, after):
    """The device's `read` fails in this take from the n-th time on."""
    whole, seen = device.read, []

    def read(self):
        if self_take[0] == take:
            seen.append(1)
            if len(seen) > after:
                raise DeviceError("is gone", field="device")
        return whole(self)

    self_take, start = [""], device.start

    def begin(self, name):
        self_take[0] = name
        start(self, name)

    monkeypatch.setattr(device, "start", begin)
    monkeypatch.setattr(device, "read", read)


# -- losses


def test_a_headset_lost_in_mid_take_fails_it_and_stops_the_run(tmp_path, short_suite, monkeypatch):
    fail_reading(monkeypatch, SimulatedHeadset, STEPS[1], 3)
    watcher = Watcher()
    with pytest.raises(DeviceError, match="is gone"):
        run(short_suite, tmp_path / "run", watcher)
    assert watcher.takes == STEPS[:2]
    assert statuses(tmp_path / "run") == {STEPS[0]: "ok", STEPS[1]: "failed"}
    kept = read_take(tmp_path / "run" / "takes" / f"{STEPS[1]}.mcap.part")
    assert len(kept.poses["headset/eye"]) > 100
    # the robot was stopped then, and what it sent until then is there
    assert kept.poses["robot/tcp"].trajectory().duration_s < 30.0


def test_where_the_suite_goes_on_the_robot_ends_its_motion(tmp_path, going_on, monkeypatch):
    fail_reading(monkeypatch, SimulatedHeadset, STEPS[1], 3)
    watcher = Watcher()
    bundle = run(going_on, tmp_path / "run", watcher)
    assert watcher.takes == STEPS
    assert bundle.record.status == "complete"
    assert [take.status for take in bundle.record.takes] == ["ok", "failed", "ok", "ok"]
    assert "is gone" in bundle.record.takes[1].reason
    assert "the suite goes on" in watcher.notices[0]
    kept = read_take(bundle.folder / bundle.record.takes[1].file)
    assert kept.poses["robot/tcp"].trajectory().duration_s > 30.0
    status = {row.repeat: row.status for row in evaluated(bundle) if row.case == "replay"}
    assert status["1"] == "failed"


def test_a_headset_that_falls_silent_is_lost(tmp_path, going_on, monkeypatch):
    whole, watcher = SimulatedHeadset.read, Watcher()

    def read(self):
        columns = whole(self)
        return Columns({}) if watcher.takes[-1] == STEPS[2] else columns

    monkeypatch.setattr(SimulatedHeadset, "read", read)
    bundle = run(going_on, tmp_path / "run", watcher)
    assert [take.status for take in bundle.record.takes] == ["ok", "ok", "failed", "ok"]
    assert "the headset was lost: nothing came for" in bundle.record.takes[2].reason


def test_a_headset_that_can_t_begin_fails_that_take(tmp_path, going_on, monkeypatch):
    whole = SimulatedHeadset.start

    def start(self, take):
        if take == STEPS[1]:
            raise DeviceError("no headset is connected")
        whole(self, take)

    monkeypatch.setattr(SimulatedHeadset, "start", start)
    bundle = run(going_on, tmp_path / "run")
    assert [take.status for take in bundle.record.takes] == ["ok", "failed", "ok", "ok"]


@pytest.mark.parametrize("fails", ["read", "execute", "prepare"])
def test_whatever_happens_to_the_robot_ends_the_run(tmp_path, going_on, monkeypatch, fails):
    if fails == "read":
        fail_reading(monkeypatch, SimulatedRobot, STEPS[1], 3)
    else:
        whole, calls = getattr(SimulatedRobot, fails), []

        def break_down(self, plan):
            calls.append(1)
            for done in whole(self, plan):
                if len(calls) == 2:
                    raise DeviceError("protective stop")
                yield done

        monkeypatch.setattr(SimulatedRobot, fails, break_down)
    with pytest.raises(DeviceError, match=r"is gone|protective stop"):
        run(going_on, tmp_path / "run")
    record = Bundle.begun(tmp_path / "run").record
    assert record.status == "failed"
    assert "is gone" in record.reason or "protective stop" in record.reason
    assert [take.name for take in record.takes if take.status == "ok"] == STEPS[:1]


# -- Ctrl-C


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_stops_the_robot_first_and_keeps_what_was_recorded(
    tmp_path, short_suite, monkeypatch, number
):
    order = []
    whole, stop = SimulatedRobot.execute, SimulatedHeadset.stop

    def execute(self, plan):
        try:
            yield from whole(self, plan)
        except GeneratorExit:
            order.append("robot stopped")
            raise

    def stopped(self):
        order.append("headset stopped")
        stop(self)

    monkeypatch.setattr(SimulatedRobot, "execute", execute)
    monkeypatch.setattr(SimulatedHeadset, "stop", stopped)

    def press(take):
        if take == STEPS[1] and "pressed" not in order:
            order.append("pressed")
            os.kill(os.getpid(), number)

    handler = signal.getsignal(number)
    with pytest.raises(InterruptedRunError, match="interrupted: 1 of 4 takes") as told:
        run(short_suite, tmp_path / "run", Watcher(press))
    assert told.value.exit_code == 1
    assert order[1:] == ["pressed", "robot stopped", "headset stopped"]
    assert signal.getsignal(number) is handler
    assert Bundle.begun(tmp_path / "run").record.status == "incomplete"
    assert statuses(tmp_path / "run") == {STEPS[0]: "ok"}
    kept = read_take(tmp_path / "run" / "takes" / f"{STEPS[1]}.mcap.part")
    assert len(kept.poses["headset/eye"]) > 100
    resumed = run(short_suite, tmp_path / "run", resume=True)
    assert [take.name for take in resumed.record.takes] == STEPS


# -- going on


@pytest.fixture(scope="module")
def whole(tmp_path_factory, short_suite) -> Path:
    """A run that nothing happened to."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    run(short_suite, folder)
    return folder


@pytest.fixture
def broken(whole, tmp_path) -> Path:
    """That run as a crash in its third take leaves it: half of that take, and a lock's file."""
    folder = tmp_path / "run"
    shutil.copytree(whole, folder)
    record = json.loads((folder / "run.json").read_text())
    record["status"], record["takes"] = "incomplete", record["takes"][:2]
    (folder / "run.json").write_text(json.dumps(record))
    third = folder / "takes" / f"{STEPS[2]}.mcap"
    half = third.read_bytes()[: third.stat().st_size // 2]
    third.with_name(f"{third.name}.part").write_bytes(half)
    third.unlink()
    (folder / "takes" / f"{STEPS[3]}.mcap").unlink()
    (folder / "run.lock").write_text("1")
    return folder


def test_resume_records_what_is_missing_as_if_nothing_had_happened(whole, broken, short_suite):
    watcher = Watcher()
    bundle = run(short_suite, broken, watcher, resume=True)
    assert watcher.takes == STEPS[2:]
    assert len(bundle.record.resumed) == 1
    for name in STEPS:
        path = Path("takes") / f"{name}.mcap"
        assert (broken / path).read_bytes() == (whole / path).read_bytes(), name
    assert not list(broken.rglob("*.part"))
    assert not (broken / "run.lock").exists()


def test_a_take_that_was_changed_is_recorded_again(whole, broken, short_suite):
    first = broken / "takes" / f"{STEPS[1]}.mcap"
    first.write_bytes(first.read_bytes()[:-1])
    watcher = Watcher()
    run(short_suite, broken, watcher, resume=True)
    assert watcher.takes == STEPS[1:]


def test_a_complete_run_has_nothing_left_to_do(whole, tmp_path, short_suite):
    folder = tmp_path / "run"
    shutil.copytree(whole, folder)
    watcher = Watcher()
    assert run(short_suite, folder, watcher, resume=True).record.status == "complete"
    assert watcher.takes == []


def test_resume_refuses_another_suite_rig_seed_or_version(broken, short_suite, monkeypatch):
    def refused(what, suite=short_suite, **more):
        with pytest.raises(ConfigError, match=f"begun with another {what}"):
            run(suite, broken, resume=True, **more)

    refused("suite", short_suite.model_copy(update={"on_loss": "continue"}))
    rig = load_rig("sim:sim")
    refused("rig", rig=rig.model_copy(update={"environment": {"lux": 40}}))
    refused("seed", seed=2)
    plugins = Plugins()
    monkeypatch.setattr(plugins, "versions", lambda: {"vrbench-other": "1"})
    refused("version of ", plugins=plugins)
    assert Bundle.begun(broken).record.resumed == []


def test_there_must_be_a_run_to_go_on_with(tmp_path, short_suite):
    with pytest.raises(ConfigError, match="is not a run"):
        run(short_suite, tmp_path / "none", resume=True)


def test_a_mount_that_is_over_is_not_recorded_again(tmp_path, going_on, monkeypatch):
    two = going_on.model_copy(
        update={
            "cases": tuple(
                c.model_copy(update={"remounts": 1} if c.role == "scored" else {})
                for c in going_on.cases
            )
        }
    )
    fail_reading(monkeypatch, SimulatedHeadset, STEPS[1], 3)
    folder = tmp_path / "run"

    def press(take):
        if take == "replay.default.m2.r2":
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(InterruptedRunError):
        run(two, folder, Watcher(press))
    watcher = Watcher()
    bundle = run(two, folder, watcher, resume=True)
    assert watcher.takes == ["replay.default.m2.r2", "calibrate.default.m2.r2"]
    assert statuses(folder)[STEPS[1]] == "failed"
    truth = [
        json.loads((folder / "truth" / f"{t.name}.json").read_text())["headset"]["tcp_eye"]["p_m"]
        for t in bundle.record.takes
        if t.mount == 2
    ]
    assert len({tuple(x) for x in truth}) == 1


# -- one folder, one run


def test_a_folder_in_use_is_refused(broken, short_suite):
    says = f"process {os.getpid()} is at work in this folder"
    with locked(broken), pytest.raises(ConfigError, match=says):
        run(short_suite, broken, resume=True)
    run(short_suite, broken, resume=True)


HOLDER = """
import sys, time
from pathlib import Path
from vrbench.results.lock import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_lock_dies_with_its_process(tmp_path):
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(tmp_path)], stdout=subprocess.PIPE, text=True
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(ConfigError, match=f"process {holder.pid} is at work"):
            locked(tmp_path).__enter__()
        holder.kill()
    assert (tmp_path / "run.lock").exists()
    with locked(tmp_path):
        pass
    assert not (tmp_path / "run.lock").exists()


# -- the disk and the clock


def test_a_run_that_the_disk_has_no_room_for_is_refused_before_it_begins(
    tmp_path, short_suite, monkeypatch
):
    free = shutil.disk_usage(tmp_path)._replace(free=35_000_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: free)
    says = r"will take about \d+ MB and leaves 32 MB alone, and 35 MB are free"
    with pytest.raises(ConfigError, match=says):
        run(short_suite, tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_run_takes_less_than_was_estimated_and_not_by_far(whole, short_suite):
    rates = nominal_rates(load_rig("sim:sim"), "sim:sim", Plugins())
    estimated = run_bytes(short_suite, list(short_suite.schedule()), rates)
    actual = sum(path.stat().st_size for path in (whole / "takes").iterdir())
    assert actual < estimated < 8 * actual


def test_a_disk_that_fills_up_ends_the_run_in_order(tmp_path, short_suite, monkeypatch):
    usage = shutil.disk_usage(tmp_path)
    left = [usage._replace(free=10**10)]
    monkeypatch.setattr(shutil, "disk_usage", lambda _: left[-1])

    def fill(take):
        if take == STEPS[1]:
            left.append(usage._replace(free=1_000_000))

    with pytest.raises(DiskFullError, match="the disk is full"):
        run(short_suite, tmp_path / "run", Watcher(fill))
    record = Bundle.begun(tmp_path / "run").record
    assert record.status == "incomplete"
    assert len(read_take(tmp_path / "run" / "takes" / f"{STEPS[1]}.mcap.part").poses) == 3
    left.append(usage._replace(free=10**10))
    assert run(short_suite, tmp_path / "run", resume=True).record.status == "complete"


def test_a_write_that_the_system_refuses_is_a_full_disk(tmp_path, short_suite_path):
    """A limit on the size of files stands in for a disk without room."""

    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (600_000, 600_000))

    command = ["record", str(short_suite_path), "--rig", "sim:sim", "-o", str(tmp_path / "run")]
    ran = subprocess.run(
        [sys.executable, "-m", "vrbench", *command],
        capture_output=True,
        text=True,
        preexec_fn=limit,
        check=False,
    )
    assert ran.returncode == 1
    assert "the disk is full" in ran.stderr
    assert "Traceback" not in ran.stderr
    assert Bundle.begun(tmp_path / "run").record.status == "incomplete"
    (part,) = (tmp_path / "run" / "takes").glob("*.part")
    assert len(read_take(part).poses["headset/eye"]) > 100


# -- kill -9


def test_killed_at_any_moment_every_chunk_reads_back_and_resume_finishes(
    tmp_path, whole, short_suite_path
):
    rng = np.random.default_rng(5)
    folder = tmp_path / "run"
    command = [sys.executable, "-m", "vrbench", "record", str(short_suite_path)]
    command += ["--rig", "sim:sim", "-o", str(folder), "--seed", "1"]
    for _ in range(3):
        more = ["--resume"] if (folder / "run.json").exists() else []
        before = len(statuses(folder)) if more else 0
        with subprocess.Popen(
            [*command, *more], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        ) as process:
            assert process.stderr is not None
            # the first take begins; where none does, all were recorded before
            next((line for line in process.stderr if b"take" in line), None)
            time.sleep(float(rng.uniform(0.0, 0.6)))
            process.kill()
        for part in folder.glob("takes/*.part"):
            read_take(part)
        assert len(statuses(folder)) >= before
    done = subprocess.run([*command, "--resume"], capture_output=True, check=False, text=True)
    assert done.returncode == 0, done.stderr
    for name in STEPS:
        path = Path("takes") / f"{name}.mcap"
        assert (folder / path).read_bytes() == (whole / path).read_bytes(), name


# -- the command line


def test_the_command_line_names_the_run_and_how_to_go_on(tmp_path, short_suite_path, monkeypatch):
    from click.testing import CliRunner

    fail_reading(monkeypatch, SimulatedHeadset, STEPS[1], 3)
    given = ["record", str(short_suite_path), "--rig", "sim:sim", "-o", str(tmp_path / "run")]
    failed = CliRunner().invoke(cli, given)
    assert isinstance(failed.exception, DeviceError)
    assert f"run: {tmp_path / 'run'} (failed; --resume goes on with it)" in failed.output
    monkeypatch.undo()
    with locked(tmp_path / "run"):  # somebody is going on with it
        second = CliRunner().invoke(cli, [*given, "--resume"])
    assert isinstance(second.exception, ConfigError)
    assert "goes on with it" not in second.output
    again = CliRunner().invoke(cli, given)
    assert "is there already" in str(again.exception)
    went_on = CliRunner().invoke(cli, [*given, "--resume"], catch_exceptions=False)
    assert went_on.exit_code == 0
    assert "take 2 of 4, replay.default.m1.r1" in went_on.output


def test_resume_wants_to_know_which_run(short_suite_path):
    from click.testing import CliRunner

    asked = CliRunner().invoke(cli, ["run", str(short_suite_path), "--rig", "sim", "--resume"])
    assert "which run is to be gone on with" in str(asked.exception)


def test_on_loss_is_a_suite_s_to_say(tmp_path, short_suite_path):
    path = tmp_path / "suite.yaml"
    path.write_text(short_suite_path.read_text() + "on_loss: continue\n")
    assert load_suite(str(path)).on_loss == "continue"
    path.write_text(short_suite_path.read_text() + "on_loss: wait\n")
    with pytest.raises(ConfigError, match="on_loss"):
        load_suite(str(path))
