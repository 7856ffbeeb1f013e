"""Made-up recordings of any length: a head's motion, told by a robot, motion capture and a headset.

The same length gives the same recording, so that files can be kept between calls.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vrbench.geometry import Ints, Transform, quat_multiply, rotvec_to_quat
from vrbench.recording.take import TakeWriter
from vrbench.streams import Columns, Joints, Samples
from vrbench.trajectory import NS, Trajectory, write_tum

REFERENCE_HZ, HEADSET_HZ, JOINT_HZ = 120, 72, 500
START_NS = 1_700_000_000 * NS
# Where the headset's world lies in the robot's base.
WORLD = Transform.of((0.3, -1.2, 0.8), (0.1, 0.7, 0.1, 0.7))
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
SINES = 16
# Frequencies [Hz], weights and phases of six channels (6, 16): so many that nothing repeats.
_RNG = np.random.default_rng(7)
_FREQUENCY = _RNG.uniform(0.05, 0.6, (6, SINES))
_WEIGHT = _RNG.uniform(0.5, 1.0, (6, SINES)) / SINES**0.5
_PHASE = _RNG.uniform(0.0, 2 * np.pi, (6, SINES))
BLOCK = 20_000


def stamps(hz: float, seconds: float) -> Ints:
    """Stamps (n,) [ns] at a rate."""
    return START_NS + np.rint(np.arange(round(hz * seconds)) * (NS / hz)).astype(np.int64)


def pose_at(t: Ints) -> Transform:
    """The true poses (n,) at stamps (n,) [ns]: decimetres and tens of degrees, in base."""
    if len(t) > BLOCK:
        return Transform.concatenate(pose_at(t[k : k + BLOCK]) for k in range(0, len(t), BLOCK))
    s = (t - START_NS) / NS
    angle = 2 * np.pi * _FREQUENCY[:, :, None] * s + _PHASE[:, :, None]
    values = np.einsum("ck,ckn->nc", _WEIGHT, np.sin(angle))
    return Transform(0.15 * values[:, :3], rotvec_to_quat(0.4 * values[:, 3:]))


def seen(t: Ints, seed: int = 1) -> Transform:
    """What the headset tells of them, in its world: 2 mm and 0.3 deg of slow and of fast errors."""
    rng = np.random.default_rng(seed)
    s = (t - START_NS)[:, None] / NS
    slow = 0.002 * np.sin(s * (0.05, 0.07, 0.11))
    true = WORLD.inverse() @ pose_at(t)
    noise = rng.normal(0.0, 1.0, (2, len(t), 3))
    turn = 0.005 * np.sin(s * (0.13, 0.09, 0.06)) + 0.001 * noise[1]
    return Transform(true.p + slow + 0.0005 * noise[0], quat_multiply(true.q, rotvec_to_quat(turn)))


def write_tum_files(seconds: float, reference: Path, headset: Path) -> None:
    """TUM text of a reference at 120 Hz and of a headset at 72 Hz."""
    t = stamps(REFERENCE_HZ, seconds)
    write_tum(Trajectory(t, pose_at(t)), reference)
    t = stamps(HEADSET_HZ, seconds)
    write_tum(Trajectory(t, seen(t)), headset)


def joint_states(seconds: float) -> Joints:
    """Joints at 500 Hz."""
    t = stamps(JOINT_HZ, seconds)
    rate = 2 * np.pi * _FREQUENCY[:, 0]
    phase = (t - START_NS)[:, None] / NS * rate
    return Joints(t, t + 1_000_000, np.sin(phase), rate * np.cos(phase), JOINTS)


def pose_stream(t: Ints, pose: Transform) -> Samples:
    """Samples that arrive a millisecond late."""
    return Samples.of(t, pose, receive_t=t + 1_000_000)


def columns(seconds: float, *, joints: bool = True) -> Columns:
    """A take's streams: `robot/tcp` at 120 Hz, `headset/eye` at 72 Hz, joints at 500 Hz."""
    robot, headset = stamps(REFERENCE_HZ, seconds), stamps(HEADSET_HZ, seconds)
    poses = {
        "robot/tcp": pose_stream(robot, pose_at(robot)),
        "headset/eye": pose_stream(headset, seen(headset)),
    }
    return Columns(poses, {"robot/joints": joint_states(seconds)} if joints else {})


def write_take(path: Path, seconds: float, *, joints: bool = True) -> None:
    """A take of those streams, written a second at a time, as a recorder does."""
    whole = columns(seconds, joints=joints)
    with TakeWriter(path, {}) as writer:
        for second in range(int(np.ceil(seconds))):
            writer.write(within(whole, START_NS + second * NS))


def within(whole: Columns, start_ns: int, length_ns: int = NS) -> Columns:
    """The part of a take whose stamps lie in [start, start + length) [ns]."""
    poses = {}
    for name, samples in whole.poses.items():
        a, b = np.searchsorted(samples.pose_t, (start_ns, start_ns + length_ns))
        poses[name] = samples[a:b]
    joints = {}
    for name, j in whole.joints.items():
        a, b = np.searchsorted(j.t, (start_ns, start_ns + length_ns))
        joints[name] = Joints(j.t[a:b], j.receive_t[a:b], j.position[a:b], j.velocity[a:b], j.names)
    return Columns(poses, joints)
