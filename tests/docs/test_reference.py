"""The reference pages say what the code has: metrics, verbs, file formats, error messages."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import click
import pytest
from pydantic import BaseModel

from tests.docs.blocks import REPO
from vrbench.cli import cli
from vrbench.metrics.registry import builtin_families
from vrbench.recording import cdr
from vrbench.results.calibrations import CalibrationRecord
from vrbench.results.phases import COLUMNS as PHASE_COLUMNS
from vrbench.results.record import DeviceRecord, RunRecord, TakeRecord
from vrbench.results.tables import COLUMNS, STATUSES
from vrbench.scoring.crosscheck import NAMES
from vrbench.statistics.floor import NoiseFloor

DOCS = REPO / "docs"


def cells(page: str, heading: str | None = None) -> Iterator[list[str]]:
    """The rows of a page's tables, or of those under one heading, cell by cell."""
    text = (DOCS / page).read_text(encoding="utf-8")
    if heading is not None:
        text = re.split(rf"^#+ {re.escape(heading)}$", text, flags=re.M)[1]
        text = re.split(r"^#+ ", text, flags=re.M)[0]
    for line in text.splitlines():
        if line.startswith("| `"):
            yield [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]


def first_names(page: str, heading: str) -> list[str]:
    return [row[0].strip("`") for row in cells(page, heading)]


def units() -> dict[str, str]:
    """The unit of every metric that a row can carry."""
    found: dict[str, str] = dict(NAMES)
    for family in builtin_families():
        found |= family.units
    terms = [field.name for field in fields(NoiseFloor)]
    return found | {f"floor.{name}": "mm" for name in [*terms, "total"]}


def test_every_metric_is_defined_with_its_unit_and_no_other_is() -> None:
    told = {row[0].strip("`"): row[1] for row in cells("metrics.md") if len(row) > 2}
    assert told == units()


def test_every_family_of_suites_has_its_place() -> None:
    page = (DOCS / "metrics.md").read_text(encoding="utf-8")
    headings = " ".join(re.findall(r"^## .*", page, re.M))
    for family in builtin_families():
        assert f"`{family.name}`" in headings


def test_a_run_has_no_metric_that_is_not_defined(run: Path) -> None:
    with (run / "metrics" / "vrbench-1.csv").open() as file:
        found = {row["metric"] for row in csv.DictReader(file)}
    assert found
    assert found <= set(units())


def verbs(command: click.Command, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    if not isinstance(command, click.Group):
        yield path
        return
    context = click.Context(command)
    for name in command.list_commands(context):
        found = command.get_command(context, name)
        assert found is not None
        yield from verbs(found, (*path, name))


def option_names(path: tuple[str, ...]) -> set[str]:
    command: click.Command | None = cli
    for name in path:
        assert isinstance(command, click.Group)
        command = command.get_command(click.Context(command), name)
    assert command is not None
    options = [p for p in command.params if isinstance(p, click.Option)]
    return {max(p.opts, key=len) for p in options}


def test_every_verb_is_documented_with_all_its_options() -> None:
    page = (DOCS / "commands.md").read_text(encoding="utf-8")
    sections = re.split(r"^### `vrbench ([^`]+)`$", page, flags=re.M)
    told = dict(zip(sections[1::2], sections[2::2], strict=True))
    assert sorted(told) == sorted(" ".join(path) for path in verbs(cli))
    for path in verbs(cli):
        text = told[" ".join(path)].split("\n## ")[0]
        rows = [line for line in text.splitlines() if line.startswith("| `-")]
        given = {re.findall(r"`(-[\w-]+)", row)[0] for row in rows}
        assert given == option_names(path), path


@pytest.mark.parametrize(
    ("heading", "model"),
    [
        ("run.json", RunRecord),
        ("run.json: device", DeviceRecord),
        ("run.json: takes", TakeRecord),
        ("calibration.json", CalibrationRecord),
    ],
)
def test_every_field_is_documented(heading: str, model: type[BaseModel]) -> None:
    assert first_names("formats.md", heading) == list(model.model_fields)


def test_every_column_is_documented() -> None:
    assert first_names("formats.md", "metrics/PROTOCOL.csv") == COLUMNS
    assert first_names("formats.md", "metrics/PROTOCOL.phase.csv") == PHASE_COLUMNS


def test_every_status_is_documented() -> None:
    assert sorted(first_names("formats.md", "Status")) == sorted(STATUSES)


def test_every_message_of_a_take_is_documented_with_its_fields() -> None:
    told = {row[0].strip("`"): row[2] for row in cells("formats.md", "Messages")}
    assert set(told) == set(cdr.SCHEMAS)
    for name, schema in cdr.SCHEMAS.items():
        if name.startswith("vrbench_msgs"):
            lines = schema.split("=" * 80)[0].splitlines()
            of = [line.split()[1] for line in lines]
            assert re.findall(r"`(\w+)`", told[name]) == of, name


def test_topics_of_a_take_are_documented(run: Path) -> None:
    from mcap.reader import make_reader

    told = [row[0].strip("`") for row in cells("formats.md", "Topics")]
    patterns = [re.sub(r"[A-Z]+", "[a-z0-9_-]+", topic) for topic in told]
    with next((run / "takes").glob("replay.*.mcap")).open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    for channel in summary.channels.values():
        assert any(re.fullmatch(p, channel.topic) for p in patterns), channel.topic


def test_metadata_of_a_take_is_documented(run: Path) -> None:
    from mcap.reader import make_reader

    told = set(first_names("formats.md", "Metadata"))
    with next((run / "takes").glob("replay.*.mcap")).open("rb") as file:
        records = [record.metadata for record in make_reader(file).iter_metadata()]
    assert records
    for record in records:
        assert set(record) <= told


def source_text() -> str:
    """All string literals of the product, joined where Python joins them."""
    import ast

    found = []
    for path in [*REPO.glob("vrbench/**/*.py"), *REPO.glob("plugins/*/*/vrbench_*/**/*.py")]:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.JoinedStr):
                parts = [
                    str(part.value) if isinstance(part, ast.Constant) else "\0"
                    for part in node.values
                ]
                found.append("".join(parts))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.append(node.value)
    return "\n".join(found)


def test_every_message_of_troubleshooting_exists_in_the_code() -> None:
    """What varies in a message stands as ... on the page."""
    literals = source_text()
    messages = [row[0].strip("`") for row in cells("troubleshooting.md")]
    assert len(messages) > 30
    for message in messages:
        parts = [re.escape(part) for part in re.split(r"\s*\.\.\.\s*", message) if part]
        pattern = r"[^\n]*\0[^\n]*".join(parts)
        assert re.search(pattern, literals), f"no such message: {message}"
