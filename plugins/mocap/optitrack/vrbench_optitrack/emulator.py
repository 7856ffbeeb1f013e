"""The command line of the Motive to test with.

    python -m vrbench_optitrack.emulator --version 4.1 --rate 240

Its first line on stdout is JSON: ports, and the truth of its clock, so that a test can tell how
well a client maps it.
"""

from __future__ import annotations

import ipaddress
import json
import sys
import time
from pathlib import Path
from typing import Any

import click

from vrbench.motion.generators import GENERATORS
from vrbench_optitrack.behaviour import Faults, ServerClock
from vrbench_optitrack.scene import Scene
from vrbench_optitrack.server import Server, parse_version
from vrbench_optitrack.wire import COMMAND_PORT, DATA_PORT, GROUP, NEWEST, OLDEST, Version

PORT = click.IntRange(0, 65535)
NOT_NEGATIVE, POSITIVE = click.FloatRange(0.0), click.FloatRange(0.0, min_open=True)


def version(text: str) -> Version:
    """The version that an option names."""
    found = parse_version(text)
    if found is None or not OLDEST <= found <= NEWEST:
        raise click.BadParameter(f"{text!r} isn't a version of NatNet from 2.5 to 4.2")
    return found


def loopback(text: str) -> str:
    """The loopback address that an option gives."""
    try:
        good = ipaddress.IPv4Address(text).is_loopback
    except ValueError:
        good = False
    if not good:
        raise click.BadParameter(f"{text!r} isn't a loopback address, as 127.0.0.1")
    return text


def group(text: str) -> str:
    """The multicast address that an option gives."""
    try:
        good = ipaddress.IPv4Address(text).is_multicast
    except ValueError:
        good = False
    if not good:
        raise click.BadParameter(f"{text!r} isn't a multicast address, as {GROUP}")
    return text


@click.command(context_settings={"show_default": True})
@click.option("--version", type=version, default="4.1", help="Of NatNet, 2.5 to 4.2.")
@click.option("--rate", default=240.0, type=click.FloatRange(1, 2000), help="Frames a second.")
@click.option("--multicast/--unicast", default=False, help="To a group, or to each client.")
@click.option("--host", type=loopback, default="127.0.0.1", help="Loopback address to bind.")
@click.option("--command-port", type=PORT, default=COMMAND_PORT, help="0 takes a free one.")
@click.option(
    "--data-port", type=PORT, default=DATA_PORT, help="0 takes the command port's successor."
)
@click.option("--group", type=group, default=GROUP, help="Multicast address.")
@click.option(
    "--motion", type=click.Choice(sorted(GENERATORS)), default="shooter-1", help="Of the head."
)
@click.option(
    "--stage", type=click.Path(path_type=Path), help="An emulated robot's file: it moves the head."
)
@click.option("--begin", type=NOT_NEGATIVE, default=0.0, help="Where in the motion to begin [s].")
@click.option("--body", default="headset", help="Name of the head's rigid body.")
@click.option("--markers", type=click.IntRange(0, 1000), default=3, help="Further labeled markers.")
@click.option("--up", type=click.Choice(["y", "z"]), default="y", help="Axis that is up.")
@click.option(
    "--unit-mm", type=POSITIVE, default=1000.0, help="Unit of lengths in the stream [mm]."
)
@click.option(
    "--frequency",
    type=click.IntRange(1),
    default=10_000_000,
    help="Ticks a second of the server's clock.",
)
@click.option("--skew-ppm", default=0.0, help="How much that clock gains.")
@click.option(
    "--clock-offset-s", type=NOT_NEGATIVE, default=1234.5, help="What it shows at the start [s]."
)
@click.option("--latency-ms", type=NOT_NEGATIVE, default=6.25, help="From mid-exposure to sending.")
@click.option("--jitter-ms", type=NOT_NEGATIVE, default=0.0, help="On top of that, rms.")
@click.option("--drop", default=0.0, type=click.FloatRange(0, 1), help="Part of frames dropped.")
@click.option(
    "--lose-every", type=NOT_NEGATIVE, default=0.0, help="Tracking is lost once in so many s."
)
@click.option("--lose-for", type=NOT_NEGATIVE, default=0.5, help="For so many seconds.")
@click.option("--lost-as", type=click.Choice(["flag", "absent"]), default="flag")
@click.option("--mute", is_flag=True, help="Answers, but sends no frames.")
@click.option(
    "--stamps",
    type=click.Choice(["mid", "received", "transmit", "none"]),
    default="mid",
    help="The first stamp that frames carry.",
)
@click.option("--claim", type=version, help="Version that SERVERINFO says, if another.")
@click.option("--new-id-after", type=float, help="Seconds until the body's id changes.")
@click.option("--switch-after", type=float, help="Seconds until the bitstream changes.")
@click.option("--switch-to", type=version, help="The version it changes to.")
@click.option("--step-after", type=float, help="Seconds until the server's clock steps.")
@click.option("--step-by", default=0.005, help="By so many seconds.")
@click.option(
    "--timeout", type=POSITIVE, default=5.0, help="Seconds until a silent client is forgotten."
)
@click.option("--seed", default=1, help="Of all chance.")
@click.option("--duration", type=POSITIVE, help="Ends after so many seconds.")
def main(**given: Any) -> None:
    """Stream a simulated head on loopback as Motive does, until interrupted."""
    server = Server(
        scene=Scene(
            motion=given["motion"],
            begin_s=given["begin"],
            body=given["body"],
            markers=given["markers"],
            rate_hz=given["rate"],
            up=given["up"],
            unit_mm=given["unit_mm"],
            lose_every_s=given["lose_every"],
            lose_s=given["lose_for"],
            lost_as=given["lost_as"],
        ),
        version=given["version"],
        multicast=given["multicast"],
        host=given["host"],
        command_port=given["command_port"],
        data_port=given["data_port"],
        group=given["group"],
        clock=ServerClock(
            given["frequency"],
            given["skew_ppm"],
            time.monotonic_ns(),
            round(given["clock_offset_s"] * given["frequency"]),
        ),
        latency_s=given["latency_ms"] * 1e-3,
        jitter_s=given["jitter_ms"] * 1e-3,
        timeout_s=given["timeout"],
        faults=Faults(
            drop=given["drop"],
            mute=given["mute"],
            stamps=given["stamps"],
            claim=given["claim"],
            new_id_after_s=given["new_id_after"],
            switch_after_s=given["switch_after"],
            switch_to=given["switch_to"],
            step_after_s=given["step_after"],
            step_s=given["step_by"],
        ),
        seed=given["seed"],
    )
    if given["stage"] is not None:
        server.ride_on(given["stage"])
    try:
        server.open()
        server.run(
            given["duration"],
            lambda: print(json.dumps(server.describe()), flush=True),  # noqa: T201
        )
    except KeyboardInterrupt:
        pass
    except OSError as error:
        sys.exit(f"port {server.command_port} of {server.host}: {error.strerror}")
    finally:
        server.close()


if __name__ == "__main__":
    main()
