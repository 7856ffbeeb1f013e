"""Runs behind URLs: fetched, evaluated, and their results put back."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.batch.processes import tables
from vrbench.batch.unit import Outcome, Unit, perform
from vrbench.results.bundle import Bundle

fsspec = pytest.importorskip("fsspec")


def done(run: str) -> Outcome:
    return perform(Unit(run, run, "vrbench-1"), lambda *_: None)


def test_a_run_in_a_store_gets_its_results(two: tuple[Path, Path], tmp_path: Path) -> None:
    one, other = two
    store = fsspec.filesystem("memory")
    store.put(str(other), "/lab/a run", recursive=True)
    outcome = done("memory://lab/a run")
    assert outcome.error is None
    store.get("/lab/a run", str(tmp_path / "back"), recursive=True)
    assert tables(tmp_path / "back") == tables(one)
    assert Bundle.open(tmp_path / "back").record.files == Bundle.open(one).record.files


def test_a_file_url_is_its_folder(two: tuple[Path, Path]) -> None:
    one, other = two
    assert done(other.as_uri().replace("%20", " ")).error is None
    assert tables(one) == tables(other)


def test_a_run_that_changes_meanwhile_keeps_its_change(two: tuple[Path, Path]) -> None:
    store = fsspec.filesystem("memory")
    store.put(str(two[1]), "/changing", recursive=True)

    def change(*_: object) -> None:
        store.pipe_file("/changing/run.json", b"{}")

    unit = Unit("memory://changing", "memory://changing", "vrbench-1")
    outcome = perform(unit, change)
    assert "was changed in the meantime" in str(outcome.error)
    assert not store.exists("/changing/metrics/vrbench-1.csv")


@pytest.mark.parametrize(
    ("url", "says"),
    [
        ("memory://nowhere", "is not a run, or not whole"),
        ("https://example.org/run", "results can't be put there"),
        ("nonsense://run", "no such kind of URL"),
    ],
)
def test_urls_that_give_no_run(url: str, says: str) -> None:
    assert f"{url}: {says}" in str(done(url).error)
