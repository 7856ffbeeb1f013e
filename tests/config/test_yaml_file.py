from typing import Any, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, ConfigDict, Field

from vrbench.config.yaml_file import load_model, load_yaml
from vrbench.errors import ConfigError


class Leg(BaseModel):
    model_config = ConfigDict(extra="forbid")

    length: int = Field(gt=0)
    knee: Literal["left", "right"] = "left"
    kind_of: str = Field("plain", alias="kind.of")


class Table(BaseModel):
    model_config = ConfigDict(extra="forbid")

    name: str
    legs: tuple[Leg, ...] = ()
    main: Leg | None = None


@pytest.fixture
def load(tmp_path):
    def load(text: str, model: Any = Table) -> Any:
        path = tmp_path / "table.yaml"
        path.write_text(text, encoding="utf-8")
        return load_yaml(path)[0] if model is None else load_model(path, model)

    return load


def test_a_good_file_is_its_model(load):
    table = load("name: oak\nlegs:\n  - {length: 3, knee: right, kind.of: carved}\n")
    assert (table.name, table.legs[0].knee, table.legs[0].kind_of) == ("oak", "right", "carved")


@pytest.mark.parametrize(
    ("text", "place", "field", "says"),
    [
        ("name: oak\nlegs: 3\n", "2:1", "legs", "found 3 .*valid tuple"),
        ("name: oak\ncolour: red\n", "2:1", "colour", "no such field .*name, legs, main"),
        (
            "name: oak\nmain: {length: 1, size: 2}\n",
            "2:19",
            "main.size",
            "no such field .*length, ",
        ),
        (
            "name: oak\nlegs:\n  - {length: 1}\n  - {length: 0}\n",
            "4:6",
            "legs.1.length",
            "found 0 .*greater than 0",
        ),
        (
            "name: oak\nlegs:\n- length: 1\n  knee: both\n",
            "4:3",
            "legs.0.knee",
            "found 'both' .*'left' or 'right'",
        ),
        ("name: oak\nmain:\n  knee: left\n", "2:1", "main.length", "missing .*length: ..."),
        ("legs: []\n", "1:1", "name", "missing .*name: ..."),
        ("name: 60.0\n", "1:1", "name", 'found 60.0 .*quotes: "60.0"'),
        ("name:\n", "1:1", "name", "found nothing"),
        ("name: oak\nlegs: 3\nmain: 4\n", "2:1", "legs", "1 more besides"),
    ],
)
def test_an_error_says_where_what_and_what_would_be_right(load, text, place, field, says):
    with pytest.raises(ConfigError, match=rf"table\.yaml:{place}: {field}: .*{says}") as error:
        load(text)
    assert error.value.fix


def test_the_fields_there_are_go_by_the_names_one_writes(load):
    with pytest.raises(ConfigError, match=r"fields are length, knee, kind\.of\)"):
        load("name: oak\nmain: {length: 1, kind_of: carved}\n")


@pytest.mark.parametrize(
    ("text", "place", "says"),
    [
        ("name: oak\nname: elm\n", "2:1", "'name' stands twice"),
        ("name: oak\nmain: {length: 1, length: 2}\n", "2:19", "'length' stands twice"),
        ("name: [oak\n", "2:1", "not YAML"),
        ("name: oak\n\tlegs: 3\n", "2:1", "not YAML"),
        ("name: a: b\n", "1:8", "not YAML"),
        ("name: *gone\n", "1:7", "not YAML"),
        ("name: !!python/object:os.system x\n", "1:7", "not YAML"),
        ("? [a, b]\n: 1\n", "1:3", "a key that is no text"),
        ("{{a}: 1}\n", "1:2", "a key that is no text"),
    ],
)
def test_what_is_not_yaml_is_named_by_line_and_column(load, text, place, says):
    with pytest.raises(ConfigError, match=rf"table\.yaml:{place}: .*{says}") as error:
        load(text)
    assert error.value.fix


@pytest.mark.parametrize("text", ["", "# nothing\n", "- a\n- b\n", "oak\n"])
def test_a_file_is_a_mapping(load, text):
    with pytest.raises(ConfigError, match=r"table\.yaml: holds no fields .*mapping"):
        load(text)


def test_a_missing_file_a_folder_and_what_is_not_text_are_named(tmp_path):
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(ConfigError, match=r"none\.yaml: no such file"):
        load_model(tmp_path / "none.yaml", Table)
    for path in (tmp_path, binary):
        with pytest.raises(ConfigError, match="can't be read as text"):
            load_model(path, Table)


@pytest.mark.parametrize(
    "text",
    [
        "12:30", "12:30.5", "1:20:30", "2024-01-31", "2024-01-31T10:00:00Z", "on", "off", "yes",
        "no", "y", "N", "0x10", "0o17", "010", "1_000", "60.0.0", "192.168.1.5", ".inf", ".nan",
        "-5-", "1e", "10 s",
    ],
)  # fmt: skip
def test_what_people_mean_as_text_stays_text(load, text):
    assert load(f"value: {text}\n", None) == {"value": text}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0", 0), ("-7", -7), ("+7", 7), ("1.5", 1.5), ("-.5", -0.5), ("1.", 1.0), ("1e3", 1000.0),
        ("1.5e-3", 0.0015), ("true", True), ("False", False), ("null", None), ("~", None),
        ("", None),
    ],
)  # fmt: skip
def test_numbers_truth_and_nothing_are_themselves(load, text, value):
    found = load(f"value: {text}\n", None)["value"]
    assert found == value
    assert type(found) is type(value)


def test_anchors_may_be_used(load):
    text = "name: oak\nmain: &leg {length: 3}\nlegs: [*leg, {<<: *leg, knee: right}]\n"
    table = load(text)
    assert [leg.length for leg in table.legs] == [3, 3]
    assert table.legs[1].knee == "right"


@given(st.text(max_size=80))
def test_any_text_is_a_mapping_or_one_error(tmp_path_factory, text):
    path = tmp_path_factory.mktemp("any") / "any.yaml"
    path.write_text(text, encoding="utf-8")
    try:
        content, _ = load_yaml(path)
    except ConfigError as error:
        assert str(path) in str(error)
    else:
        assert isinstance(content, dict)
