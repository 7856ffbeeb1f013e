"""Numbers with units as people write them: `10 s`, `15 mm`, `0.5 deg`, `95 %`."""

from __future__ import annotations

import math
import re
from decimal import Decimal
from typing import Annotated

from pydantic import BeforeValidator, WithJsonSchema

_NUMBER = re.compile(r"^\s*([-+]?[0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?)\s*(\S+)\s*$")


def _parser(units: dict[str, str | float]) -> BeforeValidator:
    """Text with one of the units, as a finite number in SI; numbers, already SI, pass.

    Units given as decimal text are multiplied exactly, so that 1001 ms is 1.001 s to the last bit
    and a suite's digest doesn't depend on the unit.
    """

    def parse(value: object) -> object:
        number = _in_si(value, units)
        if number is None or not math.isfinite(number):
            example = next(iter(units))
            raise ValueError(
                f"a finite number with a unit, one of {', '.join(units)}: 10 {example}"
            )
        return number

    return BeforeValidator(parse)


def _in_si(value: object, units: dict[str, str | float]) -> float | None:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    match = _NUMBER.match(value) if isinstance(value, str) else None
    if match is None or match[2] not in units:
        return None
    number, unit = float(match[1]), units[match[2]]
    if isinstance(unit, float) or number == 0.0 or math.isinf(number):
        return number * float(unit)
    return float(Decimal(match[1]) * Decimal(unit))


def _schema(*units: str) -> WithJsonSchema:
    """What editors and validators of YAML are told: a number, or text with one of the units."""
    pattern = rf"^\s*[-+]?[0-9]*\.?[0-9]+([eE][-+]?[0-9]+)?\s*({'|'.join(units)})\s*$"
    return WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string", "pattern": pattern}]})


Duration = Annotated[
    float,
    _parser({"s": "1", "ms": "0.001", "min": "60", "h": "3600"}),
    _schema("s", "ms", "min", "h"),
]
Length = Annotated[
    float, _parser({"mm": "0.001", "cm": "0.01", "m": "1"}), _schema("mm", "cm", "m")
]
Angle = Annotated[float, _parser({"deg": math.pi / 180.0, "rad": "1"}), _schema("deg", "rad")]
Fraction = Annotated[float, _parser({"%": "0.01"}), _schema("%")]
