"""What `vrbench rig check` finds about a Motive, from the network up to the body's pose."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np

from vrbench.devices.ports import Finding, Session
from vrbench.errors import DeviceError, VrbenchError
from vrbench.geometry import Floats
from vrbench.trajectory import NS
from vrbench_optitrack.axes import Up, to_y_up
from vrbench_optitrack.conversation import Conversation
from vrbench_optitrack.frames import decode_frame
from vrbench_optitrack.link import discover
from vrbench_optitrack.listener import Listener
from vrbench_optitrack.models import CameraModel, bodies_of
from vrbench_optitrack.options import Options
from vrbench_optitrack.rows import Row
from vrbench_optitrack.wire import NEWEST, OLDEST, NatNetError, version_text

ANSWER_S, MODELS_S, FRAMES_S, WATCH_S = 2.0, 2.0, 2.0, 1.5
LOW_M, HIGH_M = 0.2, 2.5
"""How high above the floor a head or the flange of a robot is."""
CAMERA_LOW_M = 0.5
RATE_OFF = 0.15
"""By so much may the rate of a while differ from what the server says."""


def check(options: Options, session: Session) -> Iterator[Finding]:
    """Looks, step by step, until something is missing without which no more can be seen."""
    listener = Listener(options, session.host)
    try:
        listener.__enter__()
    except VrbenchError as error:
        yield Finding(False, error.what, error.fix or "")
        return
    try:
        yield from _look(listener, options, session)
    finally:
        listener.__exit__(None, None, None)


def _look(listener: Listener, options: Options, session: Session) -> Iterator[Finding]:
    talk = listener.talk
    if not _wait(listener, lambda: talk.server is not None, ANSWER_S):
        error = listener.failure or no_answer(talk)
        yield Finding(False, error.what, (error.fix or "") + _elsewhere(options, session))
        return
    yield Finding(True, _greeting(talk))
    if talk.server is not None and talk.server.version < OLDEST:
        said = f"it speaks NatNet {version_text(talk.server.version)}"
        yield Finding(False, said, "2.5 or later can be read: Motive 1.5 and on")
        return
    named = _wait(listener, lambda: talk.settled, MODELS_S)
    came = _wait(listener, lambda: talk.packets > 0, FRAMES_S)
    if not came:
        error = no_frames(talk, listener.interface)
        yield Finding(False, error.what, error.fix or "")
    elif not _wait(listener, lambda: bool(talk.newest), 1.0):
        yield _wrong_version(talk)
        return
    if not named:
        yield Finding(False, "no model definitions come", "restart Motive's streaming")
        return
    if talk.body is None:
        error = no_body(talk, options)
        yield Finding(False, error.what, error.fix or "")
        return
    yield Finding(
        True,
        f"body {talk.body.name!r}: streaming id {talk.body.id}, {len(talk.body.markers)} markers, "
        f"unit {talk.unit_mm:g} mm",
    )
    if came:
        yield from _watch(listener, options)


def _watch(listener: Listener, options: Options) -> Iterator[Finding]:
    """What a while of frames tells."""
    talk = listener.talk
    with listener.lock:
        talk.rows.clear()
        talk.rows.lost = 0
    time.sleep(WATCH_S)
    with listener.lock:
        rows, lost, newest = list(talk.rows), talk.rows.lost, talk.newest
    if not rows:
        yield Finding(False, "frames have stopped", "is Motive in Live mode?")
        return
    yield _rate(rows, lost, talk.rate_hz)
    yield _tracking(rows, options)
    yield from _clock(talk, rows)
    yield _up(talk, rows, newest, options)


def _rate(rows: list[Row], lost: int, said_hz: float | None) -> Finding:
    """Whether frames come as often as Motive says, and all of them."""
    clock, first, last = rows[-1].clock, rows[0].stamps[0], rows[-1].stamps[0]
    # by the cameras' own time: arrivals of so short a while, on a busy computer, say little
    exposed_s = (last - first) / clock.frequency if clock is not None and 0 < first < last else None
    seconds = exposed_s or (rows[-1].arrival - rows[0].arrival) / NS
    rate = (len(rows) - 1) / max(1e-9, seconds)
    part = 100.0 * lost / (lost + len(rows))
    what = f"{rate:.0f} frames a second, {part:.1f} % lost"
    if part >= 1.0:
        return Finding(False, what, "a cable instead of Wi-Fi, a lower rate, or unicast")
    if exposed_s and said_hz is not None and abs(rate / said_hz - 1.0) > RATE_OFF:
        return Finding(
            False,
            f"{what}, though Motive says {said_hz:g}",
            "do all cameras keep up (Motive's status bar)? Is the rate of streaming another one?",
        )
    return Finding(True, what)


def _tracking(rows: list[Row], options: Options) -> Finding:
    part = 100.0 * sum(row.valid for row in rows) / len(rows)
    if part == 0.0:
        gone = all(row.body is None for row in rows)
        why = "it isn't in the frames" if gone else "Motive says so in every frame"
        return Finding(
            False,
            f"{options.body!r} is not tracked: {why}",
            "is it in view, and are its markers seen? Is it enabled in Motive's asset pane?",
        )
    fix = "" if part > 90.0 else "more of its markers must be in view of more cameras"
    return Finding(part > 90.0, f"{options.body!r} is tracked in {part:.0f} % of frames", fix)


def _clock(talk: Conversation, rows: list[Row]) -> Iterator[Finding]:
    """How pose times come about."""
    if talk.clock is None:
        yield Finding(
            True,
            "NatNet before 3.0 has no clock: a pose's time is its arrival, late by some ms",
        )
        return
    if not talk.clock:
        yield Finding(
            False,
            "echo requests aren't answered: a pose's time is its arrival, late by some ms",
            "is UDP open in both directions?",
        )
        return
    fit = talk.clock.fit()
    yield Finding(True, f"clock known within {fit.bound_s * 1e3:.2f} ms, by echo requests")
    if any(row.stamps[0] == 0 for row in rows):
        known = rows[-1].stamps
        instead = "data-received" if known[1] else "transmit" if known[2] else "arrival"
        yield Finding(
            True, f"frames carry no mid-exposure time: {instead} stands in, late by some ms"
        )


def _up(talk: Conversation, rows: list[Row], newest: bytes, options: Options) -> Finding:
    """Whether what is tracked, and the cameras, are where they can be."""
    scale = talk.unit_mm * 1e-3
    bodies = [r.body[1:4] for r in rows if r.valid and r.body is not None]
    cameras = [m.position for m in talk.models or [] if isinstance(m, CameraModel)]
    markers: list[tuple[float, float, float]] = []
    try:
        if talk.version is not None:
            frame = decode_frame(newest, talk.version)
            markers = [m.position for m in frame.labeled_markers]
    except NatNetError:
        pass
    seen = _finite(bodies) * scale
    up = judge_up(seen, _finite(cameras) * scale, _finite(markers) * scale)
    place = ""
    if len(seen):
        middle = np.median(seen, axis=0)
        place = f"; the body is at y {middle[1]:.2f} m, z {middle[2]:.2f} m of the stream"
    if up is None:
        return Finding(
            True,
            f"up axis: can't be told from here{place}; it must be {options.up}: lift the body and "
            "see which of them grows",
        )
    if up != options.up:
        return Finding(
            False,
            f"up axis: {up} is up in the stream, the rig says {options.up}{place}",
            f"`up: {up}` in the rig, or Up Axis {options.up.upper()} in Motive's streaming "
            "settings",
        )
    return Finding(True, f"up axis: {up}, as the rig says{place}")


def judge_up(bodies: Floats, cameras: Floats, markers: Floats) -> Up | None:
    """Which axis of a stream is up; None where that can't be told.

    The floor is at zero, and cameras hang above it on all sides: their heights are all positive,
    and no other coordinate of theirs is. Without cameras, the axis along which the body is as high
    as a head, and nothing lies below the floor, where that is so of one axis only.

    Args:
        bodies: positions (n, 3) of the tracked body [m].
        cameras: positions (n, 3) of the cameras [m].
        markers: positions (n, 3) of markers [m].
    """
    ups: tuple[Up, Up] = ("y", "z")
    if len(cameras) >= 3:
        hung = [up for up in ups if np.all(to_y_up(cameras, up)[:, 1] > CAMERA_LOW_M)]
        if len(hung) == 1:
            return hung[0]
    possible = [up for up in ups if _plausible(to_y_up(bodies, up), to_y_up(markers, up))]
    return possible[0] if len(possible) == 1 else None


def _plausible(bodies: Floats, markers: Floats) -> bool:
    """Whether the body is as high as a head, and no marker below the floor; y up."""
    if not len(bodies) or markers[:, 1].min(initial=0.0) < -0.05:
        return False
    return bool(LOW_M < float(np.median(bodies[:, 1])) < HIGH_M)


def _finite(points: object) -> Floats:
    rows = np.array(points, dtype=np.float64).reshape(-1, 3)
    return rows[np.isfinite(rows).all(axis=1)]


def _greeting(talk: Conversation) -> str:
    server = talk.server
    if server is None:
        return ""
    way = f"multicast to {server.group}" if talk.multicast and server.group else talk.way
    clock = f", clock {server.frequency / 1e6:g} MHz" if server.frequency else ""
    later = "; later than 4.2, read by the sizes it gives" if server.version > NEWEST else ""
    application = version_text(server.application_version)
    return (
        f"{server.application} {application} answers at {talk.address[0]}: "
        f"NatNet {version_text(server.version)}, {way}{clock}{later}"
    )


def _wrong_version(talk: Conversation) -> Finding:
    return Finding(
        False,
        f"wrong version: Motive says NatNet "
        f"{version_text(talk.server.version) if talk.server else '?'}, its frames are another: "
        f"{talk.unreadable}",
        "Motive's streaming settings: set the bitstream version to the one it says, or `bitstream`"
        " in the rig (unicast)",
    )


def _elsewhere(options: Options, session: Session) -> str:
    """Servers that answer a broadcast, where the named one doesn't."""
    try:
        found = discover(options.interface, options.command_port, session.host, 0.5)
    except VrbenchError:
        return ""
    others = [address for address, _ in found if address != options.server]
    return f"; Motive answers at {', '.join(others)}" if others else ""


def _wait(listener: Listener, done: Callable[[], bool], seconds: float) -> bool:
    """Whether it is done in time."""
    end = time.monotonic() + seconds
    while True:
        with listener.lock:
            if done():
                return True
        if time.monotonic() > end or listener.failure is not None:
            return False
        time.sleep(0.01)


def no_answer(talk: Conversation) -> DeviceError:
    """Nothing came back at all."""
    address, port = talk.address
    return DeviceError(
        f"no answer from {address}:{port}",
        fix="is that Motive's address, and its streaming on? Is the firewall of its computer open "
        "for UDP 1510 and 1511?",
    )


def no_frames(talk: Conversation, interface: str) -> DeviceError:
    """It answers, and sends no frames here."""
    if talk.unreadable:
        error = _wrong_version(talk)
        return DeviceError(error.what, fix=error.fix)
    if talk.multicast:
        return DeviceError(
            f"Motive answers, but no frames come by multicast to {interface}",
            fix="is Broadcast Frame Data on? Is `interface` the card that leads to Motive? Do "
            "switch (IGMP) and firewall let multicast through? Else stream by unicast",
        )
    return DeviceError(
        f"Motive answers, but sends no frames to {interface}",
        fix="is Broadcast Frame Data on, and the transmission type unicast?",
    )


def no_body(talk: Conversation, options: Options) -> DeviceError:
    """Motive has no rigid body of that name."""
    names = ", ".join(repr(b.name) for b in bodies_of(talk.models or [])) or "none"
    return DeviceError(
        f"Motive has no rigid body {options.body!r}",
        field="mocap.options.body",
        fix=f"there are {names}",
    )
