"""A page on a head whose movements are known: for `vrbench plugin check webxr`."""

from __future__ import annotations

import secrets
import socket
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from vrbench.devices.rehearsal import Moment, Rehearsal
from vrbench_webxr.emulator import TRACKED, FakePage

WAIT_S = 5.0


@contextmanager
def stand_in(rehearsal: Rehearsal) -> Iterator[Mapping[str, Any]]:
    """Opens the page as soon as it is served, and sends what a browser would send."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    token = secrets.token_hex(8)
    page = FakePage(f"http://127.0.0.1:{port}/{token}/")
    connected = False

    def show(m: Moment) -> None:
        nonlocal connected
        if not connected:
            try:
                page.connect()
            except OSError:  # it isn't served yet
                return
            connected = True
            page.begin_session(rehearsal.rate_hz)
        page.frame(m.p, m.q, flags=TRACKED if m.tracked else 0.0, epoch=m.epoch)

    try:
        with rehearsal.playing(show):
            yield {
                "listen": f"127.0.0.1:{port}",
                "token": token,
                "quiet": True,
                "wait_s": WAIT_S,
            }
    finally:
        page.disconnect()
