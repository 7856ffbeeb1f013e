"""A sample for a new plugin: simulated logs as its device would write them, and the robot's TUM.

Nothing in it was recorded: it is made anew for each scaffold, so that a plugin has something to be
tried on before the first real log is at hand.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import yaml

from vrbench.config.rig import Mounting
from vrbench.devices.ports import Session
from vrbench.devices.simulated.headset import Options as HeadsetOptions
from vrbench.devices.simulated.headset import SimulatedHeadset
from vrbench.devices.simulated.mocap import Options as MocapOptions
from vrbench.devices.simulated.mocap import SimulatedMocap
from vrbench.devices.simulated.robot import Options as RobotOptions
from vrbench.devices.simulated.robot import SimulatedRobot
from vrbench.devices.simulated.stage import Stage, VirtualClock
from vrbench.devices.specs import HeadsetProfile
from vrbench.geometry import UNITY, Axes, Transform
from vrbench.motion.generators import generate
from vrbench.streams import Samples
from vrbench.trajectory import write_tum

MOTION = "saturate-30s-1"
# A calibration before and one after the take that is scored.
TAKES = (("calibrate", 1), ("replay", 1), ("calibrate", 2))
RATE_HZ = 72.0
SEED = 9
HEADER = "t_us,x,y,z,qx,qy,qz,qw,tracked,epoch"
# How the made-up vendor of each kind writes poses; a robot's are in its base, as they are.
CONVENTIONS: Mapping[str, Axes | None] = {
    "headset": UNITY,
    "importer": UNITY,
    "mocap": Axes(up="z", forward="y", unit_m=0.001),
    "robot": None,
}
# Which stream of the recordings the plugin's own format holds.
STREAM = {"headset": "headset", "importer": "headset", "mocap": "mocap", "robot": "robot"}


def write_sample(kind: str, name: str, folder: Path, suite: str) -> None:
    """Logs of three simulated takes and a recordings file.

    Args:
        kind: of the plugin.
        name: of what it offers: its logs have the format `NAME-csv`.
        folder: to be filled; it exists.
        suite: that the recordings belong to.
    """
    own = STREAM.get(kind)
    takes = []
    for case, repeat in TAKES:
        streams = _take(f"{case}-{repeat}")
        if kind != "mocap":
            del streams["mocap"]
        entry: dict[str, object] = {"case": case, "repeat": repeat, "motion": MOTION}
        for stream, samples in streams.items():
            file = f"{case}-{repeat}.{stream}.{'csv' if stream == own else 'tum'}"
            if stream == own:
                _write_csv(samples, CONVENTIONS[kind], folder / file)
            else:
                write_tum(samples.trajectory(), folder / file)
            entry[stream] = {"format": f"{name}-csv" if stream == own else "tum", "path": file}
        takes.append(entry)
    content = {
        "suite": suite,
        "lab": "simulated",
        "device": {"headset": name if kind == "headset" else "sim", "logger": "simulated"},
        "takes": takes,
    }
    text = yaml.safe_dump(content, sort_keys=False)
    (folder / "recordings.yaml").write_text(f"# Simulated: see README.\n{text}", encoding="utf-8")


def write_calibration(
    folder: Path, stream: str, source: Mapping[str, object], write: Callable[[Samples, Path], None]
) -> Path:
    """A recordings file with one simulated calibration, for the tests of an importer.

    Args:
        folder: to be filled; it exists.
        stream: that the importer's files hold: `headset`, `robot` or `mocap`.
        source: its entry in the recordings file, `format` and options; `path` is added.
        write: writes samples as the vendor would, to a file.

    Returns:
        the recordings file; the headset beside a reference, or the robot beside a headset, is TUM.
    """
    case, repeat = TAKES[0]
    streams = _take(f"{case}-{repeat}")
    other = "robot" if stream == "headset" else "headset"
    write(streams[stream], folder / f"{stream}.log")
    write_tum(streams[other].trajectory(), folder / f"{other}.tum")
    content = {
        "suite": "gameplay-replay",
        "lab": "simulated",
        "device": {"headset": "sim", "logger": "simulated"},
        "takes": [
            {
                "case": case,
                "motion": MOTION,
                stream: {**source, "path": f"{stream}.log"},
                other: {"format": "tum", "path": f"{other}.tum"},
            }
        ],
    }
    path = folder / "recordings.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


def _take(name: str) -> dict[str, Samples]:
    """The streams of one simulated take."""
    clock = VirtualClock()
    session = Session(clock, Mounting().tcp_eye.transform(), SEED, Stage())
    robot = SimulatedRobot(RobotOptions(rate_hz=50.0), session)
    mocap = SimulatedMocap(MocapOptions(rate_hz=60.0, clock_offset_s=0.3), session)
    headset = SimulatedHeadset(HeadsetOptions(), HeadsetProfile(rate_hz=RATE_HZ), session)
    plan = robot.plan(generate(MOTION).trajectory)
    # each take begins at another time, as takes do
    clock.wait(60.0 * [f"{case}-{repeat}" for case, repeat in TAKES].index(name))
    for device in (robot, mocap, headset):
        device.start(name)
    for _ in robot.execute(plan):
        pass
    return {
        "headset": headset.read().poses["headset/eye"],
        "robot": robot.read().poses["robot/tcp"],
        "mocap": mocap.read().poses["mocap/body"],
    }


def _write_csv(samples: Samples, axes: Axes | None, path: Path) -> None:
    """A log as the made-up vendor writes it: `HEADER`."""
    pose: Transform = samples.pose if axes is None else axes.from_openxr(samples.pose)
    rows = [HEADER]
    for t, p, q, good, epoch in zip(
        samples.source_t.tolist(), pose.p, pose.q, samples.good, samples.epoch, strict=True
    ):
        numbers = ",".join(f"{x:.7g}" for x in np.concatenate((p, q)))
        rows.append(f"{t // 1000},{numbers},{int(good)},{int(epoch)}")
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
