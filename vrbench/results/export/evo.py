"""Results as evo keeps them: `evo_res *.zip` opens them beside evo's own."""

from __future__ import annotations

import json
from io import BytesIO
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np

from vrbench.geometry import Floats
from vrbench.metrics.compared import Compared, aligned
from vrbench.metrics.pose_errors import ape_translation
from vrbench.results.export.part import Part, plain
from vrbench.trajectory import NS, Trajectory, tum_text

TITLE = "APE w.r.t. translation part (m)\n(with SE(3) Umeyama alignment)"


def write_part(part: Part, folder: Path) -> list[Path]:
    """One zip a point, of the translation's APE [m].

    Raises:
        EstimationError: X is unknown, or positions that do not determine an alignment.
    """
    return [_write(part, at, folder) for at in aligned(part.scored)]


def _write(part: Part, at: Compared, folder: Path) -> Path:
    t = part.scored.estimate.t
    error = ape_translation(at.truth, at.estimate)
    names = {
        "ref_name": plain(f"{part.reference} {at.point}"),
        "est_name": plain(f"{part.device} {part.take} {at.point}"),
    }
    arrays = {
        "error_array": error,
        "seconds_from_start": (t - t[0]) / NS,
        # not t / NS, which rounds otherwise
        "timestamps": t // NS + (t % NS) * 1e-9,
        "distances_from_start": _travelled(at.truth.p),
        "distances": _travelled(at.estimate.p),
    }
    path = folder / f"{part.stem}.{at.point}.zip"
    with ZipFile(path, "w", ZIP_DEFLATED) as archive:
        archive.writestr("info.json", json.dumps({"title": TITLE, "label": "APE (m)", **names}))
        archive.writestr("stats.json", json.dumps(statistics(error)))
        for name, array in arrays.items():
            buffer = BytesIO()
            np.save(buffer, array)
            archive.writestr(f"{name}.npy", buffer.getvalue())
        for name, pose in zip(names.values(), (at.truth, at.estimate), strict=True):
            archive.writestr(f"{name}.tum", tum_text(Trajectory(t, pose)))
    return path


def statistics(error: Floats) -> dict[str, float]:
    """Evo's statistics of errors (n,) [m]."""
    return {
        "rmse": float(np.sqrt(np.mean(error**2))),
        "mean": float(np.mean(error)),
        "median": float(np.median(error)),
        "std": float(np.std(error)),
        "min": float(np.min(error)),
        "max": float(np.max(error)),
        "sse": float(np.sum(error**2)),
    }


def _travelled(p: Floats) -> Floats:
    """Lengths of the path (n,) [m] up to each position (n, 3)."""
    steps = np.linalg.norm(np.diff(p, axis=0), axis=1)
    return np.concatenate(([0.0], np.cumsum(steps)))
