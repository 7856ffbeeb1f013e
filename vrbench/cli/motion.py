"""`vrbench motion`: what can be replayed, and whether a robot can do it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from vrbench.cli._motion_extract import extract
from vrbench.cli._numbers import FiniteRange

if TYPE_CHECKING:
    from vrbench.devices.ports import MotionPlanner
    from vrbench.motion.motion import Motion


@click.group()
def command() -> None:
    """Motions: list and show them, extract them from captures, and plan them for a robot."""


command.add_command(extract)


def _load(name: str) -> Motion:
    """A generated motion by name, a motion file, or a plain TUM file of `T_world_eye`."""
    from vrbench.motion.files import has_header, read_motion
    from vrbench.motion.generators import generate
    from vrbench.motion.motion import Motion, relative_to_first
    from vrbench.trajectory import read_tum

    path = Path(name)
    if path.is_file() and has_header(path):
        return read_motion(path)
    if path.suffix or path.exists():
        return Motion(path.stem, str(path), relative_to_first(read_tum(path)), str(path))
    return generate(name)


@command.command("list")
def list_() -> None:
    """List the generated motions."""
    from vrbench.cli._tables import show_table
    from vrbench.motion.generators import GENERATORS, generate

    rows = []
    for name in GENERATORS:
        motion = generate(name)
        seconds = f"{motion.trajectory.duration_s:g}"
        rows.append([name, motion.title, seconds, motion.digest[:12]])
    show_table("Motions", ["motion", "title", "s ", "digest"], rows)


@command.command("show")
@click.argument("motion")
def show(motion: str) -> None:
    """Show how long, how fast and how wide MOTION is: a name, a motion file, or TUM rows."""
    import numpy as np

    from vrbench.cli._tables import show_table

    found = _load(motion)
    path = found.trajectory
    speed, turn = path.speed(), np.degrees(path.angular_speed())
    box = path.pose.p.max(axis=0) - path.pose.p.min(axis=0)
    rows = [
        ["title", found.title],
        ["digest", found.digest],
        ["duration", f"{path.duration_s:.3f} s, {len(path)} samples at {1 / path.period_s:.4g} Hz"],
        ["box", " x ".join(f"{x:.3f}" for x in box) + " m"],
        ["speed", f"rms {np.sqrt(np.mean(speed**2)):.3f}, max {speed.max():.3f} m/s"],
        ["turning", f"rms {np.sqrt(np.mean(turn**2)):.1f}, max {turn.max():.1f} deg/s"],
    ]
    show_table(found.name, ["", ""], rows)


@command.command("plan", epilog="Example: vrbench motion plan shooter-1 --robot ur5e -o plan.json")
@click.argument("motion")
@click.option("--rig", help="Plan for this rig's robot, tool and surroundings.")
@click.option("--robot", help="Or for a robot in nominal surroundings, by name.")
@click.option("--stretch", type=FiniteRange(1.0, 10.0), help="Slow the motion down by this.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Write the plan file here.")
def plan(
    motion: str, rig: str | None, robot: str | None, stretch: float | None, output: Path | None
) -> None:
    """Plan MOTION, a name or a file, for a robot; nothing is connected, nothing moves.

    With -o the plan file is written, and a picture of it beside it.
    """
    from vrbench.cli._tables import bar, show_table

    planner = _planner(rig, robot, stretch)
    found = _load(motion)
    with bar(f"plan {found.name}") as tell:
        made = planner.plan(found.trajectory, tell)
    show_table(
        f"Plan of {found.name}", ["", ""], [[name, value] for name, value in planner.describe(made)]
    )
    for path in planner.write(made, output) if output else ():
        click.echo(f"wrote {path}")
    sys.exit(0 if made.fraction == 1.0 else 1)


def _planner(rig: str | None, robot: str | None, stretch: float | None) -> MotionPlanner:
    """The planner of a rig's robot, or of a robot by name with the plugin's own defaults."""
    from vrbench.config.rig import DeviceChoice, Mounting, load_rig
    from vrbench.errors import ConfigError
    from vrbench.plugin.manager import Plugins, check_options, pick

    if (rig is None) == (robot is None):
        raise ConfigError("name a rig or a robot", field="--rig", fix="--rig RIG or --robot ur5e")
    mounting = Mounting()
    choice = DeviceChoice(plugin=robot or "")
    if rig is not None:
        loaded = load_rig(rig)
        if loaded.robot is None:
            raise ConfigError("the rig has no robot", file=rig, field="robot")
        choice, mounting = loaded.robot, loaded.mounting
    spec = pick(Plugins().robots, choice.plugin, "robot", field="robot.plugin", file=rig)
    if spec.planner is None:
        raise ConfigError(
            f"{spec.name} needs no plan file: it does every motion", file=rig, field="robot.plugin"
        )
    given = dict(choice.options)
    if stretch is not None:
        given["stretch"] = stretch
    options = check_options(given, spec.options, field="robot.options", file=rig)
    return spec.planner(options, mounting.tcp_eye.transform())
