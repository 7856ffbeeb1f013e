"""`vrbench ape`: one trajectory against another, evo's numbers."""

from __future__ import annotations

import re
import sys
from typing import TYPE_CHECKING

import click

from vrbench.cli._numbers import FiniteRange

if TYPE_CHECKING:
    from vrbench.metrics.as_evo import Delta

UNITS = {
    **dict.fromkeys(("", "f", "frame", "frames"), "frames"),
    **dict.fromkeys(("d", "deg"), "deg"),
    **dict.fromkeys(("r", "rad"), "rad"),
    "m": "m",
}
HALF_TURN = {"deg": 180.0, "rad": 3.141592653589793}
NOT_BOTH = "--all is in m and in deg: it needs no --rotation"
NEEDS_RPE = "--all-pairs is of --rpe DELTA: pairs of poses that far apart"


@click.command(
    epilog="Examples: vrbench ape robot.tum headset.tum --align; "
    "vrbench ape take.mcap:/robot/tcp take.mcap:/headset/eye/pose --align --rpe '72 frames'"
)
@click.argument("reference", metavar="REF")
@click.argument("estimate", metavar="EST")
@click.option("--align", "-a", is_flag=True, help="Align EST by SE(3) on its positions (Umeyama).")
@click.option("--rotation", "-r", is_flag=True, help="Angles in deg, instead of distances in m.")
@click.option(
    "--rpe",
    metavar="DELTA",
    multiple=True,
    help="Relative error over a DELTA: '1 frame', '0.5 m', '10 deg'; as often as you like.",
)
@click.option(
    "--all", "everything", is_flag=True, help="In m and in deg, absolute and over each DELTA."
)
@click.option("--all-pairs", is_flag=True, help="With --rpe: a pair from each pose.")
@click.option(
    "--max-diff",
    metavar="S",
    type=FiniteRange(min=0.0),
    default=0.01,
    show_default=True,
    help="How far stamps of a pair may be apart [s].",
)
@click.option(
    "--cross-check",
    type=click.Choice(["evo"]),
    help="Run evo too; exit 1 where a number differs by more than 1e-9 of it.",
)
def command(
    reference: str,
    estimate: str,
    align: bool,
    rotation: bool,
    rpe: tuple[str, ...],
    everything: bool,
    all_pairs: bool,
    max_diff: float,
    cross_check: str | None,
) -> None:
    """Compare EST with REF as evo_ape and evo_rpe do: each FILE.tum, or TAKE.mcap:TOPIC.

    Poses are paired by nearest stamps, as they stand: clocks and frames must be the same, or with
    --align the frames may differ.
    """
    if all_pairs and not rpe:
        raise click.UsageError(NEEDS_RPE)
    if everything and rotation:
        raise click.UsageError(NOT_BOTH)
    deltas: list[Delta | None] = [parse_delta(text, all_pairs) for text in rpe]
    if everything or not deltas:
        deltas.insert(0, None)

    from vrbench.cli._evo import run_evo, show_check
    from vrbench.metrics.as_evo import Question, compare
    from vrbench.recording.poses import read_poses

    parts = (False, True) if everything else (rotation,)
    questions = [Question(part, align, delta, max_diff) for delta in deltas for part in parts]
    truth, found = read_poses(reference, estimate)
    differs = False
    for number, question in enumerate(questions):
        answer = compare(truth, found, question)
        if number == 0:
            click.echo(
                f"{len(truth)} poses of {reference}, {len(found)} of {estimate}: "
                f"{answer.associated} pairs within {max_diff:g} s"
            )
        click.echo(f"{question.title}\n" if number == 0 else f"\n{question.title}\n")
        numbers = answer.statistics
        for name, value in numbers.items():
            click.echo(f"{name:>10}\t{value:.6f}")
        if cross_check:
            click.echo()
            theirs = run_evo(reference, truth, estimate, found, question)
            differs |= show_check(numbers, theirs) != 0
    sys.exit(1 if differs else 0)


def parse_delta(text: str, all_pairs: bool) -> Delta:
    """A DELTA as users write it.

    Raises:
        ConfigError: no number, an unknown unit, frames that aren't whole, not positive, an angle
            beyond half a turn.
    """
    from vrbench.errors import ConfigError
    from vrbench.metrics.as_evo import Delta

    fix = "1 frame, 72 frames, 0.5 m, 10 deg, 0.1 rad"
    match = re.fullmatch(r"\s*([0-9.]+(?:[eE][-+]?[0-9]+)?)\s*([a-z]*)\s*", text)
    try:
        value = float(match[1]) if match else None
    except ValueError:
        value = None
    if match is None or value is None or match[2] not in UNITS:
        raise ConfigError(f"{text!r} is no distance of poses", field="--rpe", fix=fix)
    unit = UNITS[match[2]]
    if not 0.0 < value < float("inf"):
        raise ConfigError(f"{text!r} must be more than nought", field="--rpe", fix=fix)
    if unit == "frames" and value != int(value):
        raise ConfigError(f"{text!r}: frames are whole", field="--rpe", fix=fix)
    if value > HALF_TURN.get(unit, value):
        raise ConfigError(f"{text!r} is beyond half a turn", field="--rpe", fix=fix)
    return Delta(value, unit, all_pairs)
