"""JSON Schemas of the files: for editors, and for what checks files before vrbench sees them."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Any, get_args

from pydantic import BaseModel, TypeAdapter

from vrbench.config.case import Case, Condition
from vrbench.config.recordings import OTHER_ROBOT, Recordings
from vrbench.config.rig import Rig
from vrbench.config.suite import Suite
from vrbench.results.record import RunRecord
from vrbench.results.tables import DIFFERENCE, LENGTHS, SCOPES, STATUSES, UNSIGNED, WHOLE, Row

# A field and its text, in the section of a docstring.
ATTRIBUTE = re.compile(r"^ {4}(\w+): (.*(?:\n {8}.*)*)", re.MULTILINE)
DIALECT = "https://json-schema.org/draft/2020-12/schema"
MODELS: dict[str, type[BaseModel]] = {
    "suite": Suite,
    "rig": Rig,
    "recordings": Recordings,
    "results": RunRecord,
}


def json_schema(name: str) -> dict[str, Any]:
    """The schema of a file.

    Args:
        name: `suite`, `rig`, `recordings`; `results` for `run.json`, with the rows of metric tables
            as its definition `Row`.
    """
    schema = MODELS[name].model_json_schema(by_alias=True)
    _describe(schema, MODELS[name])
    if name == "suite":
        schema = _extending(schema)
    elif name == "recordings":
        take = schema["$defs"]["RecordedTake"]
        source = take["properties"].pop("other_robots")["additionalProperties"]
        take["patternProperties"] = {f"^{OTHER_ROBOT.pattern}$": source}
    elif name == "results":
        schema["$defs"]["Row"] = _row()
    return {"$schema": DIALECT, **schema}


def _row() -> dict[str, Any]:
    """A row of a metric table, with what `vrbench.results.tables` refuses at reading."""
    schema = TypeAdapter(Row).json_schema()
    fields = schema["properties"]
    fields["status"]["enum"] = list(STATUSES)
    fields["ci_scope"]["enum"] = ["", *SCOPES]
    fields["samples"]["minimum"] = 0
    plain = {"properties": {"variant": {"not": {"const": DIFFERENCE}}}}
    unsigned = {
        "anyOf": [
            {"properties": {"statistic": {"enum": sorted(UNSIGNED)}}},
            {
                "properties": {
                    "statistic": {"enum": sorted(LENGTHS)},
                    "metric": {"pattern": "^(ape|rpe|floor)[.]"},
                }
            },
        ],
        **plain,
    }
    percent = {"allOf": [plain, {"properties": {"unit": {"const": "%"}}}]}
    schema["allOf"] = [
        {"if": unsigned, "then": {"properties": {"value": {"minimum": 0}}}},
        {"if": percent, "then": {"properties": {"value": {"minimum": 0, "maximum": WHOLE}}}},
    ]
    return schema


def _describe(schema: dict[str, Any], top: type[BaseModel]) -> None:
    """Writes into a schema what the docstrings of its models say of their fields."""
    for model in _models(top):
        part = schema if model is top else schema["$defs"].get(model.__name__)
        if part is None:
            continue
        part["description"] = (inspect.getdoc(model) or "").partition("\n\nAttributes:")[0]
        told = _told(model)
        for field, info in model.model_fields.items():
            place = part["properties"].get(info.alias or field)
            if place is not None and field in told:
                place.setdefault("description", told[field])


def _models(model: type[BaseModel], seen: frozenset[Any] = frozenset()) -> Iterator[Any]:
    """A model and all that its fields hold."""
    yield model
    waiting = [info.annotation for info in model.model_fields.values()]
    while waiting:
        kind = waiting.pop()
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            if kind not in seen | {model}:
                yield from _models(kind, seen | {model})
        else:
            waiting += get_args(kind)


def _told(model: type[BaseModel]) -> dict[str, str]:
    """What docstrings say of a model's fields, its bases' too; a condition's are a case's."""
    told = _told(Case) if model is Condition else {}
    for base in reversed(model.__mro__):
        _, _, section = inspect.cleandoc(base.__doc__ or "").partition("Attributes:\n")
        for field, text in ATTRIBUTE.findall(section):
            told[field] = " ".join(text.split())
    return told


def _extending(schema: dict[str, Any]) -> dict[str, Any]:
    """A suite that extends another one takes from it what it doesn't give."""
    extends = {"type": "string", "pattern": "^.+@[0-9]+$", "description": "NAME@VERSION"}
    required = schema.pop("required")
    return {
        **schema,
        "properties": {"extends": extends, **schema["properties"]},
        "anyOf": [{"required": required}, {"required": ["extends", "suite", "version"]}],
    }
