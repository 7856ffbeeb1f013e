"""JSON Schemas of the files: for editors, and for what checks files before vrbench sees them."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, TypeAdapter

from vrbench.config.recordings import OTHER_ROBOT, Recordings
from vrbench.config.rig import Rig
from vrbench.config.suite import Suite
from vrbench.results.bundle import RunRecord
from vrbench.results.tables import Row

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
    if name == "suite":
        schema = _extending(schema)
    elif name == "recordings":
        take = schema["$defs"]["RecordedTake"]
        source = take["properties"].pop("other_robots")["additionalProperties"]
        take["patternProperties"] = {f"^{OTHER_ROBOT.pattern}$": source}
    elif name == "results":
        schema["$defs"]["Row"] = TypeAdapter(Row).json_schema()
    return {"$schema": DIALECT, **schema}


def _extending(schema: dict[str, Any]) -> dict[str, Any]:
    """A suite that extends another one takes from it what it doesn't give."""
    extends = {"type": "string", "pattern": "^.+@[0-9]+$", "description": "NAME@VERSION"}
    required = schema.pop("required")
    return {
        **schema,
        "properties": {"extends": extends, **schema["properties"]},
        "anyOf": [{"required": required}, {"required": ["extends", "suite", "version"]}],
    }
