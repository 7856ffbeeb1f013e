"""The Unity logger without a headset: the same datagrams and the same log, from its own process.

python -m vrbench_quest.emulator --host 127.0.0.1 --port 9750 --token 0123456789abcdef
"""

from __future__ import annotations

import argparse
import json
import secrets
import socket
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from vrbench.geometry import Floats, rotvec_to_quat
from vrbench_quest import wire
from vrbench_quest.vrbench_log import COLUMNS, FIRST

GREET_S = 1.0


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

    def step(self, p: Floats, q: Floats) -> None:
        """Answers what has come, and samples one frame: Unity's position and rotation."""
        self.listen()
        if time.monotonic() - self._greeted > GREET_S:
            self._greeted = time.monotonic()
            self._send(wire.HELLO, self._token, json.dumps(self._facts()).encode())
        if not self._take_token:
            return
        self._frame += 1
        samples = np.zeros(2, wire.POSE)
        for moment, sample in enumerate(samples):
            sample["time_ns"], sample["moment"] = self.now_ns(), moment
            sample["flags"], sample["present"], sample["epoch"] = self.flags, 1, self.epoch
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
        while (left := due - time.perf_counter()) > 0:
            logger.listen()  # pings are answered between frames, as the app's own thread does
            time.sleep(min(left, 0.002))


def main(arguments: Sequence[str] | None = None) -> None:
    """Plays a headset with the logger to a recorder, for so long."""
    parser = argparse.ArgumentParser(prog="vrbench_quest.emulator", description=main.__doc__)
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=9750)
    parser.add_argument("--token", required=True, help="of the session, as the recorder prints it")
    parser.add_argument("--rate", type=float, default=72.0, help="frames a second")
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--folder", type=Path, help="where logs are written")
    options = parser.parse_args(arguments)
    logger = Logger(options.host, options.port, options.token, folder=options.folder)
    end = time.monotonic() + options.seconds
    try:
        play(logger, options.rate, lambda: time.monotonic() < end)
    except KeyboardInterrupt:
        pass
    finally:
        logger.close()


if __name__ == "__main__":
    main()
