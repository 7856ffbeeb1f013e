"""TUM text: truth and estimate on one clock, as `evo_ape tum TRUTH ESTIMATE -a` takes them."""

from __future__ import annotations

from pathlib import Path

from vrbench.results.export.part import Part
from vrbench.trajectory import Trajectory, write_tum


def write_part(part: Part, folder: Path) -> list[Path]:
    """Two files a point: where it truly was, and where the headset has it, in its own world.

    Where X is unknown there is no common point: the truth is the tcp's, the estimate the eye's.
    """
    scored = part.scored
    if scored.x is None:
        points = [("tcp", "truth", scored.truth), ("eye", "estimate", scored.estimate.pose)]
    else:
        points = [
            (point, kind, pose)
            for point, truth, estimate in scored.points()
            for kind, pose in (("truth", truth), ("estimate", estimate))
        ]
    written = []
    for point, kind, pose in points:
        path = folder / f"{part.stem}.{point}.{kind}.tum"
        write_tum(Trajectory(scored.estimate.t, pose), path)
        written.append(path)
    return written
