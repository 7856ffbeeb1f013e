"""Pieces of work that peers and vrbench do, each in a process of its own: what counts is told.

python -m benchmarks.work NAME WORD...; the last line is JSON with the CPU time of the work alone.
"""

from __future__ import annotations

import json
import sys
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import made_up
from vrbench.geometry import Transform

# What a piece of work told of itself besides its time.
Told = dict[str, float] | None
Job = Callable[[], Told]
TOPIC, SCHEMA = "/robot/tcp", "geometry_msgs/msg/PoseStamped"


def poses(count: int) -> tuple[Any, Transform]:
    """So many stamps [ns] and poses at 120 Hz."""
    t = made_up.stamps(made_up.REFERENCE_HZ, count / made_up.REFERENCE_HZ)
    return t, made_up.pose_at(t)


def payloads(count: int) -> tuple[list[int], list[bytes]]:
    """Stamps, and CDR messages of poses."""
    from vrbench.recording.cdr import encode_poses

    t, pose = poses(count)
    return t.tolist(), encode_poses(t, pose, "base")


# ---- files


def make_tum(seconds: str, reference: str, headset: str) -> Job:
    """Two files of TUM text."""
    return lambda: made_up.write_tum_files(float(seconds), Path(reference), Path(headset))


def make_take(seconds: str, path: str, what: str) -> Job:
    """A take, with joints or poses alone."""
    return lambda: made_up.write_take(Path(path), float(seconds), joints=what == "joints")


# ---- writing a million poses


def write_vrbench(path: str, count: str) -> Job:
    """From columns: two messages a pose, as takes have them."""
    from vrbench.recording.take import TakeWriter
    from vrbench.streams import Columns

    t, pose = poses(int(count))
    whole = Columns({"robot/tcp": made_up.pose_stream(t, pose)})
    seconds = int(count) // made_up.REFERENCE_HZ

    def job() -> Told:
        with TakeWriter(Path(path), {}) as writer:
            for second in range(seconds + 1):
                writer.write(made_up.within(whole, made_up.START_NS + second * 10**9))
        return {"messages": 2.0 * len(t)}

    return job


def write_mcap(path: str, count: str) -> Job:
    """Bytes that are encoded already."""
    from mcap.writer import CompressionType, Writer

    stamps, messages = payloads(int(count))
    text = _schema_text()

    def job() -> Told:
        with Path(path).open("wb") as file:
            writer = Writer(file, chunk_size=512 * 1024, compression=CompressionType.ZSTD)
            writer.start(profile="ros2")
            schema = writer.register_schema(SCHEMA, "ros2msg", text)
            channel = writer.register_channel(TOPIC, "cdr", schema)
            for t, data in zip(stamps, messages, strict=True):
                writer.add_message(channel, t, data, t)
            writer.finish()
        return None

    return job


def write_foxglove(path: str, count: str) -> Job:
    """Bytes that are encoded already."""
    import foxglove

    stamps, messages = payloads(int(count))
    schema = foxglove.Schema(name=SCHEMA, encoding="ros2msg", data=_schema_text())
    channel = foxglove.Channel(TOPIC, schema=schema, message_encoding="cdr")

    def job() -> Told:
        with foxglove.open_mcap(path):
            for t, data in zip(stamps, messages, strict=True):
                channel.log(data, log_time=t)
        return None

    return job


def write_rosbags(path: str, count: str) -> Job:
    """Bytes that are encoded already, into a bag of ROS 2."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    stamps, messages = payloads(int(count))
    store = get_typestore(Stores.ROS2_HUMBLE)

    def job() -> Told:
        writer = Writer(Path(path), version=9, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            connection = writer.add_connection(TOPIC, SCHEMA, typestore=store)
            for t, data in zip(stamps, messages, strict=True):
                writer.write(connection, t, data)
        return None

    return job


def _schema_text() -> bytes:
    from vrbench.recording.cdr import SCHEMAS

    return SCHEMAS[SCHEMA].encode()


# ---- reading them to arrays


def read_vrbench(path: str, _topic: str = TOPIC) -> Job:
    """Only the poses, as `vrbench ape` does."""
    from vrbench.recording.poses import read_topics

    return lambda: {"poses": float(len(read_topics(Path(path), [TOPIC])[TOPIC]))}


def read_take(path: str) -> Job:
    """All that a take holds."""
    from vrbench.recording.take import read_take as read

    def job() -> Told:
        columns = read(Path(path))
        streams = [*columns.poses.values(), *columns.joints.values()]
        # poses are there twice, as samples and as poses
        twice = sum(map(len, columns.poses.values()))
        return {"messages": float(sum(map(len, streams)) + twice)}

    return job


def read_mcap(path: str) -> Job:
    """Raw messages, decoded together by numpy: the least a reader by message can do."""
    from mcap.reader import make_reader

    def job() -> Told:
        with Path(path).open("rb") as file:
            found = make_reader(file).iter_messages(topics=[TOPIC], log_time_order=False)
            raw = [message.data for _, _, message in found]
        # the seven numbers are what a message ends with
        layout = np.dtype([("head", f"V{len(raw[0]) - 56}"), ("pose", "<f8", 7)])
        return {"poses": float(len(np.frombuffer(b"".join(raw), layout)["pose"].copy()))}

    return job


def read_ros2(path: str) -> Job:
    """Messages as objects, by the support that mcap's own project has."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    def job() -> Told:
        with Path(path).open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            return {
                "poses": float(len(_listed(m for *_, m in reader.iter_decoded_messages([TOPIC]))))
            }

    return job


def read_rosbags(path: str) -> Job:
    """Messages as objects."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)

    def job() -> Told:
        with AnyReader([Path(path)], default_typestore=store) as reader:
            wanted = [c for c in reader.connections if c.topic == TOPIC]
            found = reader.messages(wanted)
            return {"poses": float(len(_listed(reader.deserialize(m, SCHEMA) for *_, m in found)))}

    return job


def _listed(messages: Any) -> Any:
    """Rows (n, 3) of positions."""
    return np.array([(m.pose.position.x, m.pose.position.y, m.pose.position.z) for m in messages])


# ---- hand-eye

MOUNT = Transform.of((0.003, 0.087, 0.276), (0.6, 0.1, -0.2, 0.75))


def hand_eye_poses(count: str) -> tuple[Transform, Transform]:
    """Poses of the tcp, and of the eye with 1 mm and 0.1 deg of noise."""
    from vrbench.geometry import quat_multiply, rotvec_to_quat

    rng = np.random.default_rng(3)
    tcp = made_up.pose_at(made_up.START_NS + rng.integers(0, 10**12, int(count)))
    eye = made_up.WORLD.inverse() @ tcp @ MOUNT
    turn = rotvec_to_quat(rng.normal(0.0, np.radians(0.1) / 3**0.5, (len(eye), 3)))
    noise = rng.normal(0.0, 1e-3 / 3**0.5, (len(eye), 3))
    return tcp, Transform(eye.p + noise, quat_multiply(eye.q, turn))


def _errors(x: Transform) -> Told:
    """How far X is off: mm and deg."""
    from vrbench.geometry import relative_angle

    off = np.degrees(relative_angle(x.q, MOUNT.q))
    return {"mm": 1e3 * float(np.linalg.norm(x.p - MOUNT.p)), "deg": float(off)}


def handeye_vrbench(count: str) -> Job:
    """The linear solve, robust."""
    from vrbench.estimation.handeye import solve_handeye

    tcp, eye = hand_eye_poses(count)
    return lambda: _errors(solve_handeye(tcp, eye).x)


def handeye_opencv(method: str, count: str) -> Job:
    """One of OpenCV's five."""
    import cv2

    from vrbench.geometry import quat_to_matrix

    tcp, eye = hand_eye_poses(count)
    world = eye.inverse()
    given = (
        *(list(quat_to_matrix(tcp.q)), list(tcp.p)),
        *(list(quat_to_matrix(world.q)), list(world.p)),
    )
    number = getattr(cv2, f"CALIB_HAND_EYE_{method.upper()}")

    def job() -> Told:
        rotation, translation = cv2.calibrateHandEye(*given, method=number)
        return _errors(Transform.from_matrix(np.column_stack((rotation, translation))))

    return job


# ---- the clock

OFFSET_S = 0.7312


def hills(seconds: str) -> tuple[Any, Any]:
    """A motion in whose height one peak stands out every ten seconds, and the same one late."""
    from vrbench.geometry import quat_multiply, rotvec_to_quat
    from vrbench.trajectory import NS, Trajectory

    span = float(seconds)
    t = made_up.stamps(made_up.HEADSET_HZ, span)

    def at(stamps: Any, noise: Any) -> Trajectory:
        pose = made_up.pose_at(stamps)
        s = (stamps - made_up.START_NS) / NS
        tops = np.arange(4.0, span - 4.0, 10.0) + np.sin(np.arange(4.0, span - 4.0, 10.0))
        nearest = tops[np.clip(np.searchsorted(tops, s - 5.0), 0, len(tops) - 1)]
        height = 0.2 * np.exp(-((s - nearest) ** 2)) + 0.001 * noise
        p = np.column_stack((pose.p[:, :2], height))
        turn = rotvec_to_quat(np.radians(0.05) * noise[:, None] * (1.0, -1.0, 1.0))
        return Trajectory(t, Transform(p, quat_multiply(pose.q, turn)))

    rng = np.random.default_rng(5)
    noise = rng.normal(0.0, 1.0, (2, len(t)))
    return at(t, noise[0]), at(t - round(OFFSET_S * NS), noise[1])


def clock_vrbench(seconds: str) -> Job:
    """Angular speeds, correlated; found without knowing where to look."""
    from vrbench.estimation.clock import estimate_clock

    first, second = hills(seconds)

    def job() -> Told:
        found = estimate_clock(first, second).clock
        offset = float(found.offset_ns(second.t[[len(second) // 2]])[0]) / 1e9
        return {"ms": 1e3 * abs(offset - OFFSET_S)}

    return job


def clock_peaks(seconds: str) -> Job:
    """Peaks of the height, in pairs: the paper's way."""
    import scipy.signal  # not what is measured

    from vrbench.estimation.peaks import peak_offset

    assert scipy.signal
    first, second = hills(seconds)
    return lambda: {"ms": 1e3 * abs(peak_offset(first, second).offset_s - OFFSET_S)}


# ---- inverse kinematics


def arm_poses(count: str) -> Any:
    """Matrices (n, 4, 4) of a UR5e's flange within reach, in the DH base."""
    from vrbench_ur.arms import UR5E
    from vrbench_ur.kinematics import flange

    q = np.random.default_rng(1).uniform(-3, 3, (int(count), 6))
    return flange(q, UR5E.dh)


def inverse_vrbench(count: str) -> Job:
    """All postures of all poses at once."""
    from vrbench_ur.arms import UR5E
    from vrbench_ur.inverse import solve

    pose = arm_poses(count)
    return lambda: {"postures": float(np.count_nonzero(~np.isnan(solve(pose, UR5E.dh)[..., 0])))}


def inverse_eaik(count: str) -> Job:
    """Pose by pose, through its batch call."""
    from eaik.IK_DH import DhRobot
    from vrbench_ur.arms import UR5E

    matrices = arm_poses(count).matrix()
    robot = DhRobot(UR5E.dh.alpha, UR5E.dh.a, UR5E.dh.d)

    def job() -> Told:
        found = robot.IK_batched(list(matrices))
        # not those that only come near
        return {"postures": float(sum(np.count_nonzero(~one.is_LS) for one in found))}

    return job


def inverse_analytic(count: str) -> Job:
    """Pose by pose."""
    from ur_analytic_ik import ur5e

    matrices = arm_poses(count).matrix()
    return lambda: {"postures": float(sum(len(ur5e.inverse_kinematics(m)) for m in matrices))}


def plan_vrbench(_count: str) -> Job:
    """Two minutes of a head's motion: all postures, one branch, limits and collisions."""
    from vrbench_ur.arms import UR5E
    from vrbench_ur.options import Options, Start
    from vrbench_ur.planner import Planner

    from vrbench.motion.generators import generate

    start = Start(p_m=(0.467, 0.0172, 0.9806), yaw_deg=155.43)
    mounting = Transform.of((0.003, 0.087, 0.276), (0.7071, 0.0, 0.0, 0.7071))
    planner = Planner(UR5E, Options(start=start), mounting)
    motion = generate("shooter-1").trajectory

    def job() -> Told:
        planner.plan(motion)
        return {"poses": float(len(motion))}

    return job


# ---- limits of the machine


def limit_read(path: str) -> Job:
    """The bytes of a file, and nothing else."""

    def job() -> Told:
        size = 0
        with Path(path).open("rb") as file:
            while part := file.read(1 << 20):
                size += len(part)
        return {"bytes": float(size)}

    return job


def limit_unpack(path: str) -> Job:
    """Its chunks read, unpacked and checked, and nothing else: by their index, a call for each."""
    from mcap.reader import make_reader

    def job() -> Told:
        import zstandard

        unpack, size = zstandard.ZstdDecompressor(), 0
        with Path(path).open("rb") as file:
            summary = make_reader(file).get_summary()
            assert summary is not None
            for chunk in summary.chunk_indexes:
                # the packed records end the chunk
                end = chunk.chunk_start_offset + chunk.chunk_length
                file.seek(end - chunk.compressed_size)
                packed = file.read(chunk.compressed_size)
                records = unpack.decompress(packed, chunk.uncompressed_size)
                zlib.crc32(records)
                size += len(records)
        return {"bytes": float(size)}

    return job


def limit_copy(megabytes: str) -> Job:
    """Memory copied once: what a column costs that is touched once."""
    here = np.zeros(int(megabytes) * 1_000_000 // 8)
    there = np.ones_like(here)

    def job() -> Told:
        for _ in range(5):
            np.copyto(there, here)
        return {"bytes": 5.0 * here.nbytes}

    return job


# ---- stages of an evaluation


def _takes(run: str) -> tuple[Path, Path]:
    """A run's first calibration, and its take."""
    folder = Path(run) / "takes"
    return folder / "calibrate.default.m1.r1.mcap", folder / "replay.default.m1.r1.mcap"


def stage_read(run: str) -> Job:
    """The take's bytes to arrays."""
    from vrbench.recording.take import read_take as read

    return lambda: {"poses": float(len(read(_takes(run)[1]).poses["headset/eye"]))}


def stage_calibrate(run: str) -> Job:
    """Clock, hand-eye and the fit of X, from arrays."""
    from vrbench.protocols.vrbench_1 import calibrate
    from vrbench.recording.take import read_take as read

    columns = read(_takes(run)[0])
    return lambda: {"mm": 1e3 * calibrate(columns, "robot", "1").translation_residual_m}


def stage_prepare(run: str) -> Job:
    """Clock and fit of the take, from arrays."""
    from vrbench.protocols.vrbench_1 import calibrate, prepare
    from vrbench.recording.take import read_take as read

    before, take = map(read, _takes(run))
    x = calibrate(before, "robot", "1").x
    return lambda: {"poses": float(len(prepare(take, "robot", x).estimate))}


def stage_fit(run: str) -> Job:
    """The fit alone: offset and Y, with X known."""
    from vrbench.estimation.fit import fit
    from vrbench.protocols.synchrony import synchronised
    from vrbench.protocols.vrbench_1 import calibrate
    from vrbench.recording.take import read_take as read

    before, take = map(read, _takes(run))
    x = calibrate(before, "robot", "1").x
    ready = synchronised(take, "robot")
    start = {"clock": ready.clock_fit.clock, "x": x}

    def job() -> Told:
        fit(ready.spline, ready.estimate, free=("offset", "y"), **start)
        return None

    return job


def stage_score(run: str) -> Job:
    """The errors and their intervals, of a take that is ready."""
    from vrbench.metrics.ape import FAMILY
    from vrbench.protocols.vrbench_1 import calibrate, prepare
    from vrbench.recording.take import read_take as read
    from vrbench.statistics.relative import relative_models
    from vrbench.statistics.uncertainty import error_models, intervals, translation_errors

    before, take = map(read, _takes(run))
    calibration = calibrate(before, "robot", "1")
    ready = prepare(take, "robot", calibration.x)

    def job() -> Told:
        values = list(FAMILY.of_take(ready)) if FAMILY.of_take else []
        models = {**error_models(ready, translation_errors(ready)), **relative_models(ready)}
        rng = np.random.default_rng(1)
        found = intervals([models], [calibration.x_covariance], [("s", "m")], rng)
        return {"values": float(len(values)), "intervals": float(len(found))}

    return job


def stage_take(path: str) -> Job:
    """A take to arrays, and how many bytes they have."""
    from vrbench.recording.take import read_take as read

    def job() -> Told:
        columns = read(Path(path))
        poses = sum(8 * (3 + 7) * len(s) for s in columns.poses.values())
        return {"bytes": float(poses + sum(8 * 14 * len(j) for j in columns.joints.values()))}

    return job


def stage_text(path: str) -> Job:
    """TUM text to arrays, and how many bytes the text has."""
    from vrbench.trajectory import read_tum_as_written

    def job() -> Told:
        read_tum_as_written(Path(path))
        return {"bytes": float(Path(path).stat().st_size)}

    return job


WORK: dict[str, Callable[..., Job]] = {
    name.replace("_", "-"): value
    for name, value in list(globals().items())
    if name.split("_")[0]
    in {"make", "write", "read", "handeye", "clock", "inverse", "plan", "limit", "stage"}
}


def main() -> None:
    """Does the work and tells."""
    job = WORK[sys.argv[1]](*sys.argv[2:])
    before = time.process_time()
    told = job() or {}
    print(json.dumps({"cpu_s": time.process_time() - before, **told}))


if __name__ == "__main__":
    main()
