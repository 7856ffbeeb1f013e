"""What the plots of a run are drawn from: small columns, thinned for display, in a file of JSON.

Evaluation writes it while takes are open, so that reports and sites need not open them again. Its
columns have 16 bits, enough for the eye: numbers are read from the metric table.
"""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationError

from vrbench.config.strict import Strict
from vrbench.config.yaml_file import validate
from vrbench.errors import DataError
from vrbench.geometry import Floats
from vrbench.text_file import replace_text

LARGEST_FILE = 32 << 20
MISSING = 0xFFFF
# All takes of a run together get this many bins, one take no more than the second number: a page
# of a run stays well under a megabyte however many takes it has.
BINS_OF_RUN, BINS_OF_TAKE, LEAST_BINS = 12_000, 4_000, 60


class Packed(Strict):
    """A column of numbers in 16 bits: `lo + code / 65534 (hi - lo)`; code 65535 is a gap.

    Attributes:
        data: the codes, little-endian, in base64.
    """

    lo: float
    hi: float
    data: Annotated[str, Field(max_length=4 * BINS_OF_TAKE, pattern=r"^[A-Za-z0-9+/]*={0,2}$")]

    @classmethod
    def of(cls, values: Floats) -> Packed:
        """A column (n,); what isn't finite is a gap."""
        known = np.isfinite(values)
        lo, hi = (float(values[known].min()), float(values[known].max())) if known.any() else (0, 0)
        span = hi - lo or 1.0
        codes = np.full(len(values), MISSING, dtype="<u2")
        codes[known] = np.rint((values[known] - lo) / span * (MISSING - 1))
        return cls(lo=lo, hi=hi, data=b64encode(codes.tobytes()).decode("ascii"))


Axes = Annotated[list[Packed], Field(min_length=3, max_length=3)]
Numbers = Annotated[list[float], Field(max_length=4096)]


class ErrorCurves(Strict):
    """An error over a take.

    Attributes:
        unit: `mm` or `deg`.
        rms: root mean square in each bin of time.
        max: largest in each bin.
        quantiles: of all samples, evenly from 0 to 1.
        axes: mean error vector in each bin, x y z of the reference's frame.
    """

    unit: Literal["mm", "deg"]
    rms: Packed
    max: Packed
    quantiles: Numbers
    axes: Axes | None = None


class BySpeed(Strict):
    """The eye's error [mm] against its true speed [m/s], in classes with equally many samples."""

    speed: Numbers
    quartiles: Annotated[list[Numbers], Field(min_length=3, max_length=3)]
    p95: Numbers


class Spectrum(Strict):
    """Amplitude spectral density of the eye's error vector [mm/sqrt(Hz)] by frequency [Hz]."""

    hz: Numbers
    density: Numbers


class Mark(Strict):
    """An event of the take, seconds from the window's start."""

    t: float
    kind: Annotated[str, Field(max_length=100)]


class LoopCurves(Strict):
    """The eye's error by axis [mm] over one loop of a looped motion, of `bins` equal bins."""

    name: Annotated[str, Field(max_length=100)]
    duration_s: float
    axes: Axes


class TakeCurves(Strict):
    """Everything that is drawn of one take.

    Attributes:
        duration_s: of the scored window.
        bin_s: length of a bin of time.
        samples: the headset's good samples in the window.
        point: whose truth and speed these are: the eye's, or the tcp's where X is unknown.
        truth: true positions [m] in the reference's frame, the first of each bin.
        travelled: length of the true path [m] up to each bin.
        speed: true speed [m/s], mean of each bin.
        errors: `eye` and `tcp` (translation), `rotation` (of the eye); none without X.
        missing: stretches [s] without a good sample.
        marks: events, and the starts of world frames after the first.
        clock: windows of the clock: their middles [s] and offsets from the clock used [ms].
    """

    take: str
    case: str
    condition: str
    mount: int
    repeat: int
    role: Literal["calibration", "check", "scored"]
    reference: str
    duration_s: float
    bin_s: float
    samples: int
    point: Literal["eye", "tcp"]
    truth: Axes
    travelled: Packed
    speed: Packed
    errors: dict[Literal["eye", "tcp", "rotation"], ErrorCurves]
    by_speed: BySpeed | None
    spectrum: Spectrum | None
    missing: Annotated[list[tuple[float, float]], Field(max_length=1000)]
    marks: Annotated[list[Mark], Field(max_length=1000)]
    clock: tuple[Numbers, Numbers] | None
    loops: Annotated[list[LoopCurves], Field(max_length=2, default_factory=list)]


class RunCurves(Strict):
    """The curves of a run by one protocol.

    Attributes:
        left_out: takes that were scored and have no curves, for lack of room.
    """

    version: Literal[1] = 1
    protocol: str
    takes: list[TakeCurves]
    left_out: int = 0


def few(values: Floats) -> list[float]:
    """Numbers with the digits that can be seen."""
    return [float(f"{value:.5g}") for value in values.tolist()]


def bins_for(takes: int) -> int:
    """How many bins of time each take of a run gets."""
    return max(LEAST_BINS, min(BINS_OF_TAKE, BINS_OF_RUN // max(takes, 1)))


def most_takes() -> int:
    """How many takes of a run get curves."""
    return BINS_OF_RUN // LEAST_BINS


def curves_file(protocol: str) -> str:
    """The file's place in a bundle."""
    return f"metrics/{protocol}.plots.json"


def write_curves(takes: Sequence[TakeCurves], protocol: str, path: Path) -> None:
    """Writes the curves of a run, of as many takes as there is room for."""
    kept = list(takes[: most_takes()])
    run = RunCurves(protocol=protocol, takes=kept, left_out=len(takes) - len(kept))
    replace_text(path, run.model_dump_json())


def parse_curves(content: bytes, path: Path) -> RunCurves:
    """The curves of a run from their file's content; `path` is for messages.

    Raises:
        DataError: not a file of curves, or one too large to be one.
        ConfigError: a field isn't what it should be.
    """
    if len(content) > LARGEST_FILE:
        raise DataError(
            f"has {len(content)} bytes", file=path, fix=f"curves have {LARGEST_FILE} at most"
        )
    try:
        return RunCurves.model_validate_json(content)
    except ValidationError:
        pass  # the slower way says what is wrong, and where
    try:
        return validate(json.loads(content), RunCurves, path)
    except (ValueError, RecursionError) as error:
        raise DataError("is not JSON", file=path, fix=str(error)) from None
