"""A simulated truth: smooth head motion of a tcp, and what a headset on it would report."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from vrbench.geometry import (
    Transform,
    continuous_signs,
    quat_multiply,
    rotvec_to_quat,
    unity_to_openxr,
)
from vrbench.trajectory import NS, Trajectory

EPOCH_NS = 1_706_700_000 * NS
UNIX_EPOCH_TICKS = 621_355_968_000_000_000


@dataclass(frozen=True)
class Truth:
    """Head motion of rms 0.17 m/s and 30 deg/s, as sums of sines from 0.1 to 1.2 Hz."""

    frequency: np.ndarray
    phase: np.ndarray
    amplitude: np.ndarray
    x: Transform
    y: Transform

    @classmethod
    def of(cls, seed: int, axes: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)) -> Truth:
        """Six channels (x, y, z, yaw, pitch, roll), each scaled by its factor in `axes`."""
        rng = np.random.default_rng(seed)
        frequency = rng.uniform(0.1, 1.2, (6, 24))
        amplitude = rng.uniform(0.5, 1.0, (6, 24)) / frequency
        rate = np.sqrt(np.sum((2 * np.pi * frequency * amplitude) ** 2, axis=1) / 2)
        wanted = np.array([0.17 / np.sqrt(3)] * 3 + [np.radians(30.0) / np.sqrt(3)] * 3)
        amplitude *= (wanted / rate * np.array(axes))[:, None]
        phase = rng.uniform(0.0, 2 * np.pi, (6, 24))
        x = Transform(rng.normal(0.0, 0.15, 3), rotvec_to_quat(rng.normal(0.0, 1.0, 3)))
        y = Transform(rng.normal(0.0, 1.0, 3), rotvec_to_quat(rng.normal(0.0, 1.5, 3)))
        return cls(frequency, phase, amplitude, x, y)

    def tcp(self, s: np.ndarray) -> Transform:
        """`T_base_tcp` at times s (n,) [s]."""
        if len(s) > 20_000:  # bounds the memory of hours
            parts = [self.tcp(part) for part in np.array_split(s, len(s) // 10_000)]
            pose = Transform.concatenate(parts)
            return Transform(pose.p, continuous_signs(pose.q))
        angle = 2 * np.pi * self.frequency[:, :, None] * s + self.phase[:, :, None]
        values = np.einsum("ck,ckn->nc", self.amplitude, np.sin(angle))
        turns = [rotvec_to_quat(values[:, 3 + i, None] * np.eye(3)[2 - i]) for i in range(3)]
        q = quat_multiply(quat_multiply(turns[0], turns[1]), turns[2])
        return Transform(values[:, :3] + np.array([0.4, 0.2, 0.5]), continuous_signs(q))

    def reference(self, duration_s: float, rate_hz: float = 30.0) -> Trajectory:
        s = np.arange(0.0, duration_s, 1.0 / rate_hz)
        t = np.rint(s * NS).astype(np.int64)
        return Trajectory(EPOCH_NS + t, self.tcp(t / NS))

    def estimate(
        self,
        duration_s: float,
        rate_hz: float = 72.0,
        *,
        offset_s: float = 0.0,
        skew: float = 0.0,
        scale: float = 1.0,
        noise: tuple[float, float] = (0.0, 0.0),
        seed: int = 0,
    ) -> Trajectory:
        """The eye, stamped by a clock with an offset (in the middle) and a skew.

        Args:
            scale: reference over estimate.
            noise: rms of the position error [m] and of the rotation error [rad], both with a
                correlation time of 2 s.
        """
        rng = np.random.default_rng(seed)
        s = np.arange(0.0, duration_s, 1.0 / rate_hz)
        t = np.rint(s * NS).astype(np.int64)
        eye = self.y.inverse() @ self.tcp(t / NS) @ self.x
        e_p = correlated(rng, len(t), rate_hz) * noise[0] / np.sqrt(3)
        e_r = correlated(rng, len(t), rate_hz) * noise[1] / np.sqrt(3)
        pose = Transform(eye.p / scale + e_p, quat_multiply(eye.q, rotvec_to_quat(e_r)))
        moved = np.rint((offset_s + skew * (s - duration_s / 2)) * NS).astype(np.int64)
        return Trajectory(EPOCH_NS + t + moved, pose)


def correlated(rng: np.random.Generator, n: int, rate_hz: float, time_s: float = 2.0) -> np.ndarray:
    """Three independent AR(1) series (n, 3) of unit variance."""
    from scipy.signal import lfilter

    a = np.exp(-1.0 / (rate_hz * time_s))
    white = rng.normal(0.0, 1.0, (n, 3))
    white[1:] *= np.sqrt(1.0 - a * a)
    return lfilter([1.0], [1.0, -a], white, axis=0)


@pytest.fixture(scope="session")
def truth() -> Callable[..., Truth]:
    return Truth.of


@dataclass(frozen=True)
class Recording:
    """One of the paper's: the robot's tcp and the headset's eye, each on its own clock."""

    tcp: Trajectory
    eye: Trajectory


@pytest.fixture(scope="session")
def recordings() -> dict[tuple[str, str], Recording]:
    """The paper's recordings by headset and run, from the folder VRBENCH_DATA."""
    folder = os.environ.get("VRBENCH_DATA")
    if not folder:
        pytest.skip("VRBENCH_DATA, the folder of banaszczyk2024/, is not set")
    root = Path(folder) / "banaszczyk2024" / "data" / "experiments"
    if not root.is_dir():
        pytest.skip(f"no recordings at {root}")
    return {
        (device, run): Recording(
            _read_bag(root / device / "tcp_bags" / f"{run}.bag"),
            _read_unity(root / device / "center_eye_data" / f"{run}.txt"),
        )
        for device in ("quest2", "quest_pro")
        for run in ("calib", "traj1")
    }


def _read_bag(path: Path) -> Trajectory:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    rows = []
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS1_NOETIC)) as reader:
        topics = [c for c in reader.connections if c.topic == "/my_ur5e/endeffpos"]
        for connection, _, raw in reader.messages(topics):
            m = reader.deserialize(raw, connection.msgtype)
            p, q = m.pose.position, m.pose.orientation
            stamp = m.header.stamp.sec * NS + m.header.stamp.nanosec
            rows.append((stamp, (p.x, p.y, p.z), (q.x, q.y, q.z, q.w)))
    return _trajectory(*(np.array(column) for column in zip(*rows, strict=True)))


def _read_unity(path: Path) -> Trajectory:
    lines = path.read_text(encoding="utf-8").split("\n")[:-1]
    fields = [line.split(",") for line in lines]
    t = np.array([(int(row[1]) - UNIX_EPOCH_TICKS) * 100 for row in fields])
    values = np.array([[float(value) for value in row[9:16]] for row in fields])
    eye = unity_to_openxr(Transform.of(values[:, :3], values[:, 3:]))
    return _trajectory(t, eye.p, eye.q)


def _trajectory(t: np.ndarray, p: np.ndarray, q: np.ndarray) -> Trajectory:
    t, first = np.unique(t, return_index=True)
    pose = Transform.of(p[first], q[first])
    return Trajectory(t, Transform(pose.p, continuous_signs(pose.q)))
