"""`vrbench motion`: what can be replayed, and whether a robot can do it."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from vrbench.cli._motion_calibration import calibration
from vrbench.cli._motion_extract import extract
from vrbench.cli._numbers import FiniteRange


@click.group()
def command() -> None:
    """Motions: list and show them, extract them from captures, and plan them for a robot."""


command.add_command(extract)
command.add_command(calibration)


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

    from vrbench.cli._planner import load_motion
    from vrbench.cli._tables import show_table

    found = load_motion(motion)
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
    from vrbench.cli._planner import load_motion, planner_of
    from vrbench.cli._tables import bar, show_table

    planner = planner_of(rig, robot, stretch).planner
    found = load_motion(motion)
    with bar(f"plan {found.name}") as tell:
        made = planner.plan(found.trajectory, tell)
    show_table(
        f"Plan of {found.name}", ["", ""], [[name, value] for name, value in planner.describe(made)]
    )
    for path in planner.write(made, output) if output else ():
        click.echo(f"wrote {path}")
    sys.exit(0 if made.fraction == 1.0 else 1)
