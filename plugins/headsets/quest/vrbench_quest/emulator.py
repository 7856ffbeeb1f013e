"""The Unity logger without a headset: the same datagrams and the same log, from its own process.

    python -m vrbench_quest.emulator --host 127.0.0.1 --port 9750 --token 0123456789abcdef

With `--stage` it rides on an emulated robot. With `--hands` besides, what is done to it by hand
comes on standard input, a line each: `cover 0.5` (a share of its cameras), `uncover`, `remount`.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import secrets
import socket
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from vrbench.config.rig import Mounting
from vrbench.devices.emulated import EmulatedHead, StageReader
from vrbench.geometry import UNITY, Floats, rotvec_to_quat
from vrbench.streams import GOOD, Flag
from vrbench_quest import wire
from vrbench_quest.vrbench_log import COLUMNS, FIRST

GREET_S = 1.0
# How often it looks where the robot has carried it meanwhile [s].
RIDE_S = 0.03


class Logger:
    """What VrbenchLogger.cs does, at a rate, along a path; one call of `step` is one frame.

    Attributes:
        shift_ns: added to its clock [ns]; setting it makes the clock jump.
        epoch: of its samples.
        flags: of its samples.
        lose: how many of the next datagrams of poses are lost on the way.
    """

    def __init__(self, host: str, port: int, token: str, *, folder: Path | None = None) -> None:
        self.shift_ns = 0
        self.epoch, self.flags, self.lose = 0, 15, 0
        self.sent: list[tuple[int, Floats, Floats]] = []
        self._recorder = (host, port)
        self._token, self._take_token = bytes.fromhex(token), b""
        self._folder = folder
        self._log: list[str] = []
        self._take = ""
        self._number = self._event = self._frame = 0
        self._greeted = -np.inf
        self._run = secrets.token_hex(16)
        self._done: set[int] = set()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((host if host.startswith("127.") else "", 0))
        self._socket.setblocking(False)

    def close(self) -> None:
        """Ends it; a take that is open keeps what was logged."""
        self._end()
        self._socket.close()

    def now_ns(self) -> int:
        """The time on its clock [ns]."""
        return time.perf_counter_ns() + self.shift_ns

    def tell(self, kind: str, detail: str = "") -> None:
        """An event."""
        body = wire.EVENT_BODY.pack(self._event, self.now_ns()) + f"{kind} {detail}".encode()
        self._event += 1
        self._send(wire.EVENT, self._token, body)
        self._log.append(f"# event {self.now_ns()} {kind} {detail}")

    def step(
        self, p: Floats, q: Floats, *, at_ns: int | None = None, flags: int | None = None
    ) -> None:
        """Answers what has come, and samples one frame: Unity's position and rotation.

        One that was made a moment ago says `at_ns`, when by its clock; `flags` are its own then.
        """
        self.listen()
        if time.monotonic() - self._greeted > GREET_S:
            self._greeted = time.monotonic()
            self._send(wire.HELLO, self._token, json.dumps(self._facts()).encode())
        if not self._take_token:
            return
        self._frame += 1
        samples = np.zeros(2, wire.POSE)
        for moment, sample in enumerate(samples):
            sample["time_ns"] = self.now_ns() if at_ns is None else at_ns
            sample["moment"], sample["present"], sample["epoch"] = moment, 1, self.epoch
            sample["flags"] = self.flags if flags is None else flags
            sample["p"], sample["q"] = p, q
            sample["v"], sample["w"] = np.nan, np.nan
            self._log.append(_line(self._frame, sample))
        self.sent.append((int(samples["time_ns"][1]), samples["p"][1], samples["q"][1]))
        if self.lose:
            self.lose -= 1
        else:
            body = wire.BATCH.pack(self._number, len(samples)) + samples.tobytes()
            self._send(wire.POSES, self._take_token, body)
        self._number += len(samples)

    def answer(self, until_ns: int) -> None:
        """Listens until then [ns]: between frames too, as the app's own thread does."""
        while (left := until_ns - time.perf_counter_ns()) > 0:
            self.listen()
            time.sleep(min(left / 1e9, 0.002))

    def listen(self) -> None:
        """Answers pings and obeys commands that have come."""
        while True:
            try:
                data, sender = self._socket.recvfrom(2048)
            except (BlockingIOError, ConnectionError):
                return
            received = self.now_ns()
            datagram = wire.unpack(data)
            if datagram.token != self._token or sender[1] != self._recorder[1]:
                continue
            (number,) = wire.COMMAND.unpack_from(datagram.body)
            rest = datagram.body[wire.COMMAND.size :]
            if datagram.kind == wire.PING:
                answer = wire.PONG_BODY.pack(number, received, self.now_ns())
                self._send(wire.PONG, self._token, answer)
                continue
            if number not in self._done:
                self._done.add(number)
                self._obey(datagram.kind, rest)
            self._send(wire.DONE, self._token, wire.COMMAND.pack(number))

    def send_raw(self, data: bytes) -> None:
        """Sends anything to the recorder."""
        self._socket.sendto(data, self._recorder)

    def _obey(self, kind: int, rest: bytes) -> None:
        if kind == wire.START:
            self._end()
            self._take_token, self._take = rest[:8], rest[8:].decode()
            self._number = 0
            self._log = [
                FIRST,
                *(f"# {key}: {value}" for key, value in self._facts().items()),
                f"# take: {self._take}",
                ",".join(COLUMNS),
            ]
        elif kind == wire.STOP:
            self._end()

    def _end(self) -> None:
        if self._take and self._folder is not None:
            path = self._folder / f"{self._take}.20260101T000000000Z.csv"
            path.write_text("\n".join(self._log) + "\n", encoding="utf-8")
        self._take, self._take_token = "", b""

    def _facts(self) -> dict[str, str | int]:
        return {
            "utc_origin_ns": 1_700_000_000_000_000_000,
            "run": self._run,
            "model": "emulated Quest",
            "axes": "unity",
            "prediction": "none",
        }

    def _send(self, kind: int, token: bytes, body: bytes) -> None:
        self.send_raw(wire.pack(kind, token, body))


def _line(frame: int, sample: np.void) -> str:
    """A sample as the log has it; float32 as short as they are exact."""
    moment = next(name for name, number in wire.MOMENTS.items() if number == sample["moment"])
    numbers = np.concatenate([sample[name] for name in ("p", "q", "v", "w")])
    written = ",".join(str(np.float32(x)) for x in numbers)
    ends = ",".join(str(int(sample[name])) for name in ("flags", "present", "epoch"))
    return f"{int(sample['time_ns'])},{frame},{moment},{written},{ends}"


def sway(t_s: float) -> tuple[Floats, Floats]:
    """Where a head that looks about is after t seconds: position [m], quaternion (Unity's axes)."""
    p = np.array([0.2 * np.sin(1.1 * t_s), 1.5 + 0.05 * np.sin(1.7 * t_s), 0.1 * np.sin(0.9 * t_s)])
    return p, rotvec_to_quat(
        np.array([0.3 * np.sin(1.3 * t_s), 0.6 * np.sin(0.7 * t_s), 0.1 * np.sin(2.1 * t_s)])
    )


def play(logger: Logger, rate_hz: float, going_on: Callable[[], bool]) -> None:
    """Makes frames at a rate while `going_on()`."""
    begin = due = time.perf_counter()
    while going_on():
        logger.step(*sway(due - begin))
        due += 1.0 / rate_hz
        logger.answer(round(1e9 * due))


def ride(logger: Logger, head: EmulatedHead, rate_hz: float, going_on: Callable[[], bool]) -> None:
    """Makes frames at a rate of a head that an emulated robot carries, while `going_on()`."""
    period = round(1e9 / rate_hz)
    due = time.perf_counter_ns()
    while going_on():
        now = time.perf_counter_ns()
        # where the robot was a second ago is forgotten soon: frames are left out instead
        frames = np.arange(max(due, now - round(1e9)), now, period)
        if len(frames):
            pose, known = head.eye(frames)
            shown = UNITY.from_openxr(pose)
            flags = np.where(known, GOOD, GOOD & ~Flag.POSITION_TRACKED).tolist()
            for t, p, q, flag in zip(frames.tolist(), shown.p, shown.q, flags, strict=True):
                logger.step(p, q, at_ns=t + logger.shift_ns, flags=flag)
            due = int(frames[-1]) + period
        logger.answer(now + round(1e9 * RIDE_S))


def main(arguments: Sequence[str] | None = None) -> None:
    """Plays a headset with the logger to a recorder, for so long."""
    parser = argparse.ArgumentParser(prog="vrbench_quest.emulator", description=main.__doc__)
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=9750)
    parser.add_argument("--token", required=True, help="of the session, as the recorder prints it")
    parser.add_argument("--rate", type=float, default=72.0, help="frames a second")
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--folder", type=Path, help="where logs are written")
    parser.add_argument(
        "--stage", type=Path, help="an emulated robot's file: the headset rides on it"
    )
    parser.add_argument("--seed", type=int, default=1, help="of how it rides there, and errs")
    parser.add_argument("--hands", action="store_true", help="obey lines of standard input")
    options = parser.parse_args(arguments)
    if options.hands and options.stage is None:
        parser.error("--hands: hands are laid on a headset that a robot carries; add --stage")
    logger = Logger(options.host, options.port, options.token, folder=options.folder)
    end = time.monotonic() + options.seconds

    def going_on() -> bool:
        return time.monotonic() < end

    try:
        if options.stage is None:
            play(logger, options.rate, going_on)
        else:
            stage = StageReader(options.stage)
            # late frames are for those who ask for them
            with contextlib.suppress(OSError):
                os.nice(-10)
            head = EmulatedHead(stage, Mounting().tcp_eye.transform(), options.seed)
            if options.hands:
                head.listen(sys.stdin)
            ride(logger, head, options.rate, going_on)
    except KeyboardInterrupt:
        pass
    finally:
        logger.close()


if __name__ == "__main__":
    main()
