"""`vrbench motion extract`: a captured take -> a motion file."""

from __future__ import annotations

from pathlib import Path

import click

from vrbench.cli._numbers import FiniteRange

SECONDS, RATE = FiniteRange(0.0), FiniteRange(1.0, 2000.0)


@click.command(
    "extract", epilog="Example: vrbench motion extract my-capture --name seated-shooter -o head.tum"
)
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--name", required=True, help="The motion's name.")
@click.option("--version", default=1, show_default=True, help="The motion's version.")
@click.option("--take", help="Which take [the run's only scored one].")
@click.option("--start", type=SECONDS, default=0.0, help="Begin so many seconds into the take.")
@click.option("--end", type=SECONDS, help="End so many seconds into the take.")
@click.option(
    "--at",
    type=click.Choice(["eye", "body"]),
    default="eye",
    show_default=True,
    help="Whose motion: the body's where no headset was recorded.",
)
@click.option("--rate", type=RATE, default=120.0, show_default=True, help="Poses a second.")
@click.option("--game", help="What was played.")
@click.option("--posture", help="Seated, standing.")
@click.option("--licence", help="Under which the motion may be used [the run's].")
@click.option("--consent", help="How the person agreed [the run's].")
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path))
def extract(
    run: Path,
    name: str,
    version: int,
    take: str | None,
    start: float,
    end: float | None,
    at: str,
    rate: float,
    game: str | None,
    posture: str | None,
    licence: str | None,
    consent: str | None,
    output: Path,
) -> None:
    """Write the eye's motion in a captured take of RUN as a motion file, to be replayed.

    A person's motion needs a licence and the person's consent.
    """
    from pydantic import ValidationError

    from vrbench.errors import ConfigError
    from vrbench.extraction import eye_motion, find_take
    from vrbench.motion.files import Header, write_motion
    from vrbench.protocols.vrbench_1 import PROTOCOL
    from vrbench.results.bundle import Bundle

    bundle = Bundle.open(run)
    found = find_take(bundle, take)
    try:
        header = Header(
            motion=name,
            version=version,
            up="y",
            rate_hz=rate,
            source="captured",
            game=game,
            posture=posture,
            licence=licence or bundle.record.licence,
            consent=consent or bundle.record.consent,
        )
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(map(str, first["loc"]))
        raise ConfigError(
            first["msg"].removeprefix("Value error, "), field=f"--{field}" if field else None
        ) from None
    protocol = PROTOCOL if at == "eye" else None
    path = eye_motion(bundle, found, protocol, rate_hz=rate, start_s=start, end_s=end)
    motion = write_motion(output, header, path)
    click.echo(f"{motion.name}: {motion.trajectory.duration_s:.1f} s, digest {motion.digest[:12]}")
    click.echo(f"wrote {output}")
