import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from vrbench.config.quantity import Angle, Duration, Fraction, Length

KINDS = {kind: TypeAdapter(kind) for kind in (Duration, Length, Angle, Fraction)}


def parse(kind, value):
    return KINDS[kind].validate_python(value)


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        (Duration, "10 s", 10.0),
        (Duration, "10s", 10.0),
        (Duration, " 2.5 ms ", 0.0025),
        (Duration, "60 min", 3600.0),
        (Duration, "1 h", 3600.0),
        (Duration, "1e-3 s", 0.001),
        (Length, "15 mm", 0.015),
        (Length, "1.5 cm", 0.015),
        (Length, ".5 m", 0.5),
        (Length, "-3 mm", -0.003),
        (Angle, "180 deg", math.pi),
        (Angle, "0.5 rad", 0.5),
        (Fraction, "95 %", 0.95),
        (Fraction, "95%", 0.95),
        (Duration, 10, 10.0),
        (Fraction, 0.95, 0.95),
    ],
)
def test_a_quantity_is_its_number_in_si(kind, text, value):
    found = parse(kind, text)
    assert type(found) is float
    assert found == value


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (Duration, "10"),
        (Duration, "10 mm"),
        (Duration, "10 S"),
        (Duration, "ten s"),
        (Duration, "12:30"),
        (Duration, "1 0 s"),
        (Duration, ""),
        (Duration, True),
        (Duration, None),
        (Duration, [1]),
        (Length, "3 s"),
        (Angle, "3 °"),
        (Fraction, "0.95"),
        (Fraction, math.nan),
        (Duration, math.inf),
        (Duration, "1e999 s"),
        (Duration, "1e308 h"),
    ],
)
def test_anything_else_is_refused_with_an_example(kind, value):
    with pytest.raises(ValidationError, match=r"a finite number with a unit, one of .*: 10 "):
        parse(kind, value)


def test_numbers_past_all_exponents_do_no_harm():
    assert parse(Length, "1e-99999999999999999999 mm") == 0.0
    with pytest.raises(ValidationError, match="finite"):
        parse(Length, "1e99999999999999999999 mm")


@given(st.integers(-(10**9), 10**9))
def test_the_unit_makes_no_difference_to_the_last_bit(n):
    assert parse(Duration, f"{n} ms") == n / 1000 == parse(Duration, n / 1000)
    assert parse(Duration, f"{n} min") == parse(Duration, f"{n * 60} s") == n * 60
    assert parse(Length, f"{n} mm") == n / 1000
    assert parse(Length, f"{n} cm") == n / 100
    assert parse(Fraction, f"{n} %") == n / 100
