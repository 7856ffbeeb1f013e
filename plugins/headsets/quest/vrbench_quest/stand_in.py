"""The Unity logger on a head whose movements are known: for `vrbench plugin check quest`."""

from __future__ import annotations

import secrets
import socket
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from vrbench.devices.rehearsal import Moment, Rehearsal
from vrbench.geometry import UNITY, Transform
from vrbench.streams import GOOD
from vrbench_quest.emulator import Logger
from vrbench_quest.wire import TOKEN_BYTES

WAIT_S = 5.0


@contextmanager
def stand_in(rehearsal: Rehearsal) -> Iterator[Mapping[str, Any]]:
    """Sends what the headset's app would send while it moves so."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    token = secrets.token_hex(TOKEN_BYTES)
    logger = Logger("127.0.0.1", port, token)

    def show(m: Moment) -> None:
        logger.epoch, logger.flags = m.epoch, GOOD if m.tracked else 0
        pose = UNITY.from_openxr(Transform(m.p, m.q))
        logger.step(pose.p, pose.q)

    try:
        with rehearsal.playing(show):
            yield {
                "listen": f"127.0.0.1:{port}",
                "token": token,
                "adb": False,
                "quiet": True,
                "wait_s": WAIT_S,
            }
    finally:
        logger.close()
