"""Runs the emulator: `python -m vrbench_ur.emulator --host 127.0.0.1 --model ur5e`.

Commands come on standard input, a line each: `protective`, `estop`, `safeguard`, `clear`, `local`,
`remote`, `slider 0.5`, `drop`, `freeze 1.0`, `mute`, `skip 20`, `in-use 0`, `place q1 .. q6`,
`stick`, `mark NAME`, `report`, `quit`.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from random import Random

from vrbench.devices.emulated import StageWriter
from vrbench_ur.arms import ARMS, Arm, Dh
from vrbench_ur.emulator.controller import Controller
from vrbench_ur.emulator.mount import Mount
from vrbench_ur.emulator.server import Server


def main(arguments: Sequence[str] | None = None) -> int:
    """Serves until it is told to end; 2 where a port is taken."""
    parser = argparse.ArgumentParser(prog="vrbench_ur.emulator", description=(__doc__ or ""))
    parser.add_argument("--host", default="127.0.0.1", help="a loopback address")
    parser.add_argument("--model", default="ur5e", choices=list(ARMS))
    parser.add_argument(
        "--version", type=version, default="5.12.2", help="of the controller's software"
    )
    parser.add_argument("--seed", type=int, default=1, help="of the arm's noise")
    parser.add_argument(
        "--calibrated", type=float, default=0.0, help="deviations of its arm from nominal, mm rms"
    )
    parser.add_argument(
        "--stage", type=Path, help="file that tells other emulators where the head is"
    )
    parser.add_argument("--local", action="store_true", help="remote control is off")
    parser.add_argument("--mute", action="store_true", help="accept, and say nothing")
    parser.add_argument("--until-eof", action="store_true", help="end when standard input does")
    parser.add_argument("--quiet", action="store_true", help="print no events")
    given = parser.parse_args(arguments)
    log = None if given.quiet else _say
    arm = deviating(ARMS[given.model], given.calibrated, given.seed)
    controller = Controller(arm, given.seed, log)
    controller.remote = not given.local
    try:
        server = Server(controller, given.host, (*given.version, 0))
    except OSError as error:
        _say(f"can't listen on {given.host}, ports 29999, 30001, 30003, 30004: {error}")
        return 2
    if given.stage is not None:
        server.after_tick = Mount(controller.twin, StageWriter(given.stage)).tick
    server.mute, server.until_eof = given.mute, given.until_eof
    server.listen_to(lambda line: command(line, controller, server))
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: setattr(server, "running", False))
    # late ticks are for those who ask for them
    with contextlib.suppress(OSError):
        os.nice(-10)
    _say(f"ready: {given.model} at {given.host}")
    server.run()
    return 0


def version(text: str) -> tuple[int, int, int]:
    """Three numbers of a version.

    Raises:
        ArgumentTypeError: they are no three numbers.
    """
    try:
        major, minor, bugfix = (int(part) for part in text.split("."))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} (three numbers, 5.12.2)") from None
    return major, minor, bugfix


def deviating(arm: Arm, mm: float, seed: int) -> Arm:
    """An arm as it comes from the factory: lengths off by `mm`, angles by `mm` a metre."""
    if not mm:
        return arm
    rng, dh = Random(seed), arm.dh
    own = (x + [rng.gauss(0.0, 1e-3 * mm) for _ in range(6)] for x in (dh.d, dh.a, dh.alpha))
    d, a, alpha = own
    return replace(arm, dh=Dh(d, a, alpha, dh.theta))


def command(line: str, controller: Controller, server: Server) -> str | None:
    """Does what a line says; the answer, where it has one."""
    word, *rest = line.split() or [""]
    simple = {
        "protective": controller.protective_stop,
        "estop": controller.emergency_stop,
        "safeguard": controller.safeguard_stop,
        "clear": controller.clear,
        "drop": server.drop,
    }
    if word in simple:
        simple[word]()
    elif word in ("local", "remote"):
        controller.remote = word == "remote"
    elif word == "stick":
        controller.twin.stuck = True
    elif word == "mark":
        controller.note("mark " + " ".join(rest))
    elif word == "report":
        return report(controller, server)
    elif word == "quit":
        server.running = False
    else:
        with contextlib.suppress(ValueError, IndexError):
            _with_number(word, [float(x) for x in rest], controller, server)
    return None


def _with_number(word: str, values: list[float], controller: Controller, server: Server) -> None:
    if word == "slider":
        controller.set_slider(values[0])
    elif word == "freeze":
        server.freeze(values[0])
    elif word == "skip":
        server.skip_packets = int(values[0])
    elif word == "mute":
        server.mute = not values or bool(values[0])
    elif word == "in-use":
        server.taken.add(f"input_int_register_{int(values[0])}")
    elif word == "place" and len(values) == 6:
        controller.twin.q, controller.twin.actual = list(values), list(values)


def report(controller: Controller, server: Server) -> str:
    """The state of things as one line of JSON."""
    return json.dumps(
        {
            "tick": controller.tick_count,
            "q": controller.twin.q,
            "moving": controller.twin.moving,
            "runtime": controller.runtime,
            "safety": sorted(controller.safety),
            "payload": controller.payload,
            "tcp": controller.tcp_offset,
            "clients": len(server.clients),
            "events": controller.events,
        }
    )


def _say(text: str) -> None:
    print(text, file=sys.stdout, flush=True)  # noqa: T201


if __name__ == "__main__":
    sys.exit(main())
