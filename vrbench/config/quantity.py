"""Numbers with units as people write them: `10 s`, `15 mm`, `0.5 deg`, `95 %`."""

from __future__ import annotations

import math
import re
from typing import Annotated

from pydantic import BeforeValidator

_NUMBER = re.compile(r"^\s*([-+]?[0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?)\s*(\S+)\s*$")


def _parser(units: dict[str, float]) -> BeforeValidator:
    """Text with one of the units, as a number in SI; numbers, already SI, pass."""

    def parse(value: object) -> object:
        if isinstance(value, int | float) and not isinstance(value, bool):
            return float(value)
        match = _NUMBER.match(value) if isinstance(value, str) else None
        if match is None or match[2] not in units:
            example = next(iter(units))
            raise ValueError(f"a number with a unit, one of {', '.join(units)}: 10 {example}")
        return float(match[1]) * units[match[2]]

    return BeforeValidator(parse)


Duration = Annotated[float, _parser({"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0})]
Length = Annotated[float, _parser({"mm": 1e-3, "cm": 1e-2, "m": 1.0})]
Angle = Annotated[float, _parser({"deg": math.pi / 180.0, "rad": 1.0})]
Fraction = Annotated[float, _parser({"%": 0.01})]
