"""What emulators of a rig share, so that they show one and the same movement.

The emulated robot writes down where what it carries truly is; emulated headsets and cameras look it
up. It goes by a file of their own: vrbench itself never opens it, and is told poses by the devices'
protocols alone. Times are those of the computer's monotonic clock.
"""

from __future__ import annotations

import mmap
import struct
import time
from pathlib import Path

import numpy as np

from vrbench.devices.simulated.noise import correlated, rng_of
from vrbench.devices.simulated.worlds import Y_UP
from vrbench.devices.specs import Tracking
from vrbench.geometry import Ints, Transform, quat_multiply, rotvec_to_quat, slerp
from vrbench.trajectory import NS

# Rows the file holds, in a ring: sixteen seconds at 125 Hz.
ROWS, USUAL_STEP_NS = 2048, 8_000_000
# Rows before the newest that a look takes in, and before the oldest that it leaves alone.
SPARE = 128
_ROW = np.dtype([("t", "<i8"), ("p", "<f8", 3), ("q", "<f8", 4)])
_PACKED = struct.Struct("<q7d")
# The number of rows written so far comes first: one aligned word, which is never seen half written.
_HEAD = 8
SIZE = _HEAD + ROWS * _ROW.itemsize


# How long a robot that writes down where the head is is waited for.
WAIT_S = 20.0


class StageWriter:
    """Writes down where the carried head is; called often, so it is quick.

    Args:
        path: a file that is made, or overwritten.
    """

    def __init__(self, path: Path) -> None:
        path.write_bytes(bytes(SIZE))
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), SIZE)
        self._written = np.frombuffer(self._map, dtype=np.int64, count=1)
        self._count = 0

    def put(self, t_ns: int, p: tuple[float, ...], q: tuple[float, ...]) -> None:
        """It is at p [m], turned by q (xyzw), in base, at a monotonic time [ns]."""
        at = _HEAD + self._count % ROWS * _ROW.itemsize
        _PACKED.pack_into(self._map, at, t_ns, *p, *q)
        self._count += 1
        # a reader takes a row only when it is counted
        self._written[0] = self._count


def _begun(path: Path) -> bool:
    """Whether the file is whole, and holds a row."""
    if not path.is_file() or path.stat().st_size != SIZE:
        return False
    with path.open("rb") as file:
        return any(file.read(_HEAD))


class StageReader:
    """Looks up where the carried head is.

    Args:
        path: the file.

    Raises:
        TimeoutError: no robot writes to it.
    """

    def __init__(self, path: Path) -> None:
        end = time.monotonic() + WAIT_S
        while not _begun(path):
            if time.monotonic() > end:
                raise TimeoutError(f"no emulated robot writes to {path}")
            time.sleep(0.02)
        with path.open("rb") as file:
            self._map = mmap.mmap(file.fileno(), SIZE, access=mmap.ACCESS_READ)
        self._written = np.frombuffer(self._map, dtype=np.int64, count=1)
        self._rows = np.frombuffer(self._map, dtype=_ROW, offset=_HEAD)

    def at(self, t: Ints, patience_s: float = 0.5) -> Transform:
        """Where it is, `T_base_carried` (n,), at monotonic times (n,) [ns].

        Times that are still to come are waited for, in vain where the robot stands still for good:
        then it is where it was last.
        """
        end, last = time.monotonic() + patience_s, int(t.max())
        while self._newest_t() < last and time.monotonic() < end:
            time.sleep(0.001)
        rows = self._since(int(t.min()))
        known = np.clip(t, rows["t"][0], rows["t"][-1])
        after = np.clip(np.searchsorted(rows["t"], known), 1, max(len(rows) - 1, 1))
        a, b = rows[after - 1], rows[np.minimum(after, len(rows) - 1)]
        span = np.maximum(b["t"] - a["t"], 1)
        u = np.clip((known - a["t"]) / span, 0.0, 1.0)
        p = a["p"] + u[:, None] * (b["p"] - a["p"])
        return Transform(p, slerp(a["q"], b["q"], u))

    def _newest_t(self) -> int:
        return int(self._rows["t"][(int(self._written[0]) - 1) % ROWS])

    def _since(self, t: int) -> np.ndarray[tuple[int], np.dtype[np.void]]:
        """The rows from a time [ns] on, by time, and some before it, as far as they are kept."""
        count = int(self._written[0])
        needed = (self._newest_t() - t) // USUAL_STEP_NS + SPARE
        # the oldest of the ring are left out: they may be written over meanwhile
        first = max(0, count - min(max(needed, SPARE), ROWS - SPARE))
        return self._rows[np.arange(first, count) % ROWS].copy()


# Where the headset's world and the cameras' space are, about the base; y up both.
CAMERAS_BASE = Transform.of((0.4, 0.0, -0.3), (0.0, np.sin(0.3), 0.0, np.cos(0.3))) @ Y_UP
CARRIED_BODY = Transform.of((-0.011, 0.134, 0.343), (0.0, 0.0, 0.0, 1.0))
SLIP_M, SLIP_RAD = 0.003, 0.008


class EmulatedHead:
    """What a headset on the emulated robot says of itself.

    Args:
        stage: where the robot carries it.
        mounting: nominal `T_tcp_eye`.
        seed: of its fixing, its world and its errors.
        tracking: how it errs; a second's white noise comes on top.

    Attributes:
        x: how it is truly fixed, `T_tcp_eye`.
    """

    def __init__(
        self,
        stage: StageReader,
        mounting: Transform,
        seed: int,
        tracking: Tracking | None = None,
    ) -> None:
        self._stage, self._tracking = stage, tracking or Tracking()
        rng = rng_of(seed, "fixing")
        slip = rng.normal(size=3) * SLIP_M, rotvec_to_quat(rng.normal(size=3) * SLIP_RAD)
        self.x = mounting @ Transform(*slip)
        rng = rng_of(seed, "world")
        turn = rotvec_to_quat(np.array([0.0, rng.uniform(-np.pi, np.pi), 0.0]))
        self._world = Transform(rng.normal(size=3) * 0.5, turn) @ Y_UP
        self._white = rng_of(seed, "white")
        self._slow = [
            correlated(rng_of(seed, name), rms, self._tracking.correlation_s, 3)
            for name, rms in (
                ("position", self._tracking.position_noise_m),
                ("rotation", self._tracking.rotation_noise_rad),
            )
        ]

    def eye(self, t: Ints) -> Transform:
        """What it takes for its pose, `T_world_eye` (n,), at monotonic times (n,) [ns]."""
        true = self._world[None] @ self._stage.at(t) @ self.x[None]
        seconds = t / NS
        slow_p, slow_r = (noise(seconds) for noise in self._slow)
        white = self._white.normal(size=(len(t), 6))
        p = true.p + slow_p + white[:, :3] * self._tracking.position_jitter_m
        turn = slow_r + white[:, 3:] * self._tracking.rotation_jitter_rad
        return Transform(p, quat_multiply(true.q, rotvec_to_quat(turn)))


class EmulatedBody:
    """What cameras about the emulated robot see of the body that it carries.

    Args:
        stage: where the robot carries it.
        seed: of the cameras' noise.
        noise_m: of positions, each axis [m]; of rotations what that makes over 0.1 m.
    """

    def __init__(self, stage: StageReader, seed: int, noise_m: float = 5e-5) -> None:
        self._stage, self._rng, self._noise_m = stage, rng_of(seed, "cameras"), noise_m

    def pose(self, t: Ints) -> Transform:
        """`T_mocap_body` (n,), y up, at monotonic times (n,) [ns]."""
        true = CAMERAS_BASE[None] @ self._stage.at(t) @ CARRIED_BODY[None]
        noise = self._rng.normal(size=(len(t), 6)) * self._noise_m
        return Transform(
            true.p + noise[:, :3], quat_multiply(true.q, rotvec_to_quat(noise[:, 3:] / 0.1))
        )
