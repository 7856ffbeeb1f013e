"""What an importer of recorded files must offer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from vrbench.geometry import Floats
from vrbench.streams import Samples


class NoOptions(BaseModel):
    """An importer whose format needs no telling."""

    model_config = ConfigDict(extra="forbid")


@dataclass(frozen=True, slots=True, eq=False)
class Imported:
    """What a file gave.

    Attributes:
        samples: its poses, in vrbench's conventions.
        repairs: what was mended or left out, a sentence each; kept in the take and shown.
        markers: where the body's markers sit, from its pivot (k, 3) [m], y up; None where the file
            doesn't say. A calibration made with others isn't used for the take.
    """

    samples: Samples
    repairs: tuple[str, ...] = ()
    markers: Floats | None = None


@dataclass(frozen=True, slots=True)
class Importer:
    """A file format that holds poses.

    Attributes:
        name: what recordings files call it in `format`.
        title: what it is, for people.
        read: the file's poses, given the path and validated options; raises DataError.
        options: a pydantic model of the format's further keys, `extra="forbid"`.
    """

    name: str
    title: str
    read: Callable[[Path, Any], Imported]
    options: type[BaseModel] = NoOptions
