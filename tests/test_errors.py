import pickle
from pathlib import Path

import pytest

from vrbench.errors import ConfigError, DataError, DeviceError, EstimationError, VrbenchError

KINDS = [ConfigError, DataError, EstimationError, DeviceError]


@pytest.mark.parametrize(
    ("place", "text"),
    [
        ({}, "is odd"),
        ({"file": "a.yaml"}, "a.yaml: is odd"),
        ({"field": "gate"}, "gate: is odd"),
        ({"file": Path("a.yaml"), "field": "gate"}, "a.yaml: gate: is odd"),
        ({"fix": "make it even"}, "is odd (make it even)"),
        (
            {"file": "a.yaml:3:1", "field": "gate", "fix": "make it even"},
            "a.yaml:3:1: gate: is odd (make it even)",
        ),
    ],
)
def test_an_error_prints_file_field_what_and_fix(place, text):
    assert str(VrbenchError("is odd", **place)) == text


@pytest.mark.parametrize("kind", KINDS)
def test_errors_cross_to_another_process_whole(kind):
    error = kind("is odd", file=Path("a.yaml"), field="gate", fix="make it even")
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is kind
    assert str(copy) == str(error)
    assert (copy.what, copy.file, copy.field, copy.fix) == (
        "is odd",
        "a.yaml",
        "gate",
        "make it even",
    )


def test_what_the_user_wrote_exits_with_2_and_what_went_wrong_with_1():
    assert {kind.__name__: kind.exit_code for kind in KINDS} == {
        "ConfigError": 2,
        "DataError": 1,
        "EstimationError": 1,
        "DeviceError": 1,
    }
