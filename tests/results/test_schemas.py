"""The JSON Schemas take every file that comes with vrbench, and refuse what is misspelt."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import fastjsonschema
import pytest

from vrbench.config.shipped import shipped_files
from vrbench.config.yaml_file import load_yaml
from vrbench.errors import DataError
from vrbench.results.schemas import MODELS, json_schema
from vrbench.results.tables import Row, read_rows, write_rows


def takes(name: str, content: Any) -> bool:
    try:
        fastjsonschema.validate(json_schema(name), content)
    except fastjsonschema.JsonSchemaException:
        return False
    return True


@pytest.mark.parametrize("name", MODELS)
def test_each_is_a_schema(name: str) -> None:
    fastjsonschema.compile(json_schema(name))
    assert not takes(name, {"suit": "misspelt"})


@pytest.mark.parametrize(
    ("name", "path"),
    [
        (name, path)
        for name, kind in (("suite", "suites"), ("recordings", "recordings"))
        for path in shipped_files(kind).values()
    ],
    ids=lambda value: getattr(value, "stem", value),
)
def test_shipped_files_fit(name: str, path: Path) -> None:
    content, _ = load_yaml(path)
    assert takes(name, content)
    assert not takes(name, {**content, "misspelt": 1})


def test_a_rig_fits() -> None:
    rig = {
        "lab": "example",
        "headset": {"plugin": "webxr", "device": "quest-pro", "firmware": "60.0.0"},
        "robot": {"plugin": "ur5e", "options": {"host": "192.168.1.20"}},
    }
    assert takes("rig", rig)
    assert not takes("rig", {**rig, "headset": {"plugin": 1}})


def test_a_suite_that_extends_gives_only_what_differs() -> None:
    suite = {"extends": "gameplay-replay@1", "suite": "mine", "version": 1}
    assert takes("suite", suite)
    assert not takes("suite", {**suite, "extends": "gameplay-replay"})
    assert not takes("suite", {"suite": "mine", "version": 1})


@pytest.mark.parametrize(
    ("bracket", "fits"), [("1 mm", True), (0.001, True), ("1 mile", False), ("mm", False)]
)
def test_quantities_are_numbers_or_have_a_unit(bracket: Any, fits: bool) -> None:
    content, _ = load_yaml(shipped_files("suites")["gameplay-replay"])
    content["gate"]["bracket"] = bracket
    assert takes("suite", content) is fits


def test_a_run_s_record_fits(run: Path) -> None:
    record = json.loads((run / "run.json").read_text())
    assert takes("results", record)
    assert not takes("results", {**record, "schema_version": 2})
    assert "Row" in json_schema("results")["$defs"]


@pytest.mark.parametrize("name", ["suite", "rig", "recordings"])
def test_editors_are_told_of_every_field_and_of_every_misspelt_one(name: str) -> None:
    schema = json_schema(name)
    parts = {name: schema, **schema.get("$defs", {})}
    for title, part in parts.items():
        if "properties" not in part:
            continue
        bare = [k for k, v in part["properties"].items() if not v.get("description")]
        assert bare == [], title
        assert "Attributes:" not in part["description"]
        # a source's further keys are its importer's
        assert part["additionalProperties"] is (title == "Source"), title


def test_units_are_said_in_words() -> None:
    defs = json_schema("suite")["$defs"]
    gate = defs["Gate"]["properties"]
    assert gate["handeye.translation"]["description"] == "most that it may leave: 15 mm."
    assert (
        defs["Condition"]["properties"]["hold"]["description"]
        == (defs["Case"]["properties"]["hold"]["description"])
    )
    pose = json_schema("rig")["$defs"]["Pose"]["properties"]
    assert pose["p_m"]["description"] == "position x, y, z [m]."


KEY = "protocol device suite case condition sitting mount repeat segment reference variant metric"
ROW = {
    **dict.fromkeys(KEY.split(), ""),
    "metric": "ape.translation.aligned",
    "point": "eye",
    "band": "all",
    "statistic": "rmse",
    "value": 2.0,
    "unit": "mm",
}


@pytest.mark.parametrize(
    ("change", "possible"),
    [
        ({}, True),
        ({"value": None, "status": "failed"}, True),
        ({"value": -5.0}, False),
        ({"value": -5.0, "variant": "vs-baseline"}, True),
        ({"value": -5.0, "statistic": "slope"}, True),
        ({"value": -5.0, "statistic": "median"}, False),
        ({"value": -5.0, "statistic": "median", "metric": "clock.offset"}, True),
        ({"value": 101.0, "unit": "%", "statistic": "value"}, False),
        ({"status": "great"}, False),
        ({"samples": -1}, False),
        ({"ci_low": 1.0, "ci_high": 3.0, "ci_scope": "house"}, False),
    ],
)
def test_the_schema_of_rows_refuses_what_the_reader_refuses(
    tmp_path: Path, change: dict[str, Any], possible: bool
) -> None:
    row = Row(**{**ROW, **change})
    write_rows([row], tmp_path / "rows.csv")
    if possible:
        assert read_rows(tmp_path / "rows.csv") == [row]
    else:
        with pytest.raises(DataError, match="a row can't be read"):
            read_rows(tmp_path / "rows.csv")
    valid = fastjsonschema.compile(json_schema("results")["$defs"]["Row"])
    if possible:
        valid({**ROW, **change})
    else:
        with pytest.raises(fastjsonschema.JsonSchemaException):
            valid({**ROW, **change})
