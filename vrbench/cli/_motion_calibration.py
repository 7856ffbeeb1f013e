"""`vrbench motion calibration`: a calibration motion that a rig's robot can do -> a motion file."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(
    "calibration",
    epilog="Example: vrbench motion calibration --rig lab.yaml --for shooter-1 -o motions/ours.tum",
)
@click.option("--rig", help="For this rig's robot, tool and surroundings.")
@click.option("--robot", help="Or for a robot in nominal surroundings, by name.")
@click.option(
    "--for",
    "contained",
    multiple=True,
    metavar="MOTION",
    help="A motion that is to lie within it; may be given again [shooter-1].",
)
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path))
def calibration(
    rig: str | None, robot: str | None, contained: tuple[str, ...], output: Path
) -> None:
    """Write the widest calibration motion that the robot can do, to be named in a suite.

    It turns about and moves along all axes, slowly, beyond the motions given as far as the arm
    can, and says which of them leave it: their takes would be scored as `extrapolated`.
    """
    from vrbench.calibration_motion import fit
    from vrbench.cli._planner import load_motion, planner_of
    from vrbench.cli._tables import bar, show_table
    from vrbench.errors import ConfigError
    from vrbench.motion.files import Header, write_motion
    from vrbench.motion.generators import RATE_HZ

    if output.exists():
        raise ConfigError("is there already", file=output, fix="name a file that is not")
    chosen = planner_of(rig, robot)
    motions = {name: load_motion(name).trajectory for name in contained or ("shooter-1",)}
    name = f"calibration-{chosen.robot}"
    with bar("calibration motion") as tell:
        found = fit(f"{name}-1", chosen.planner, chosen.mounting, motions, tell)
    header = Header(motion=name, version=1, up="y", rate_hz=RATE_HZ, source="generated")
    written = write_motion(output, header, found.motion.trajectory)
    box = written.trajectory.pose.p.max(axis=0) - written.trajectory.pose.p.min(axis=0)
    rows = [
        ["size", f"{100 * found.size:.0f} % of what contains them all"],
        ["box", " x ".join(f"{x:.3f}" for x in box) + " m"],
        *([of, str(e) if e.any_outside else "lies within it"] for of, e in found.beyond.items()),
        *([what, value] for what, value in chosen.planner.describe(found.plan)),
    ]
    show_table(written.name, ["", ""], rows)
    if any(e.any_outside for e in found.beyond.values()):
        click.echo(
            "what leaves the calibration is scored as extrapolated, and not ranked", err=True
        )
    click.echo(f"wrote {output}: name it in a suite, and its start in the rig")
