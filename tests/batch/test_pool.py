"""Many runs at once: the same bytes as one by one; what kills a process costs one run alone."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from tests.batch.processes import TABLES, evaluator, gone, start, tables, until
from vrbench.batch.unit import cores
from vrbench.results.bundle import LOCK, Bundle
from vrbench.results.lock import locked

TWO = pytest.mark.skipif(cores() < 2, reason="needs two cores")


@TWO
def test_a_pool_writes_what_one_process_writes(two: tuple[Path, Path]) -> None:
    one, other = two
    jobs = start("evaluate", "a", "none", "b", "./a", "--jobs", "2", cwd=one.parent)
    shown, told = jobs.communicate()
    alone = start("evaluate", "a", cwd=one.parent)
    assert alone.communicate()[0] in shown
    assert alone.returncode == 0
    assert tables(one) == tables(other)
    record = Bundle.open(other).record
    assert record.files == Bundle.open(one).record.files
    assert jobs.returncode == 2
    assert "evaluated 2 of 3 runs" in told
    assert "error: none: is not a run" in told
    assert shown.index("run: a\n") < shown.index("run: b\n")
    assert shown.count("run: a\n") == 1
    assert not list(one.parent.rglob("*.part")) + list(one.parent.rglob(LOCK))


@TWO
def test_a_process_that_is_killed_costs_its_own_run_alone(two: tuple[Path, Path]) -> None:
    one, other = two
    jobs = start("evaluate", "a", "b", "--jobs", "2", cwd=one.parent)
    os.kill(evaluator(other), signal.SIGKILL)
    _, told = jobs.communicate()
    assert jobs.returncode == 1
    assert "evaluated 1 of 2 runs" in told
    assert "error: b: the process that evaluated it ended by signal 9 (SIGKILL)" in told
    assert not (other / TABLES[0]).exists()
    again = start("evaluate", "b", cwd=one.parent)
    again.communicate()
    assert again.returncode == 0
    assert tables(one) == tables(other)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_nothing_is_left_of_a_pool_that_is_stopped(two: tuple[Path, Path], number: int) -> None:
    one, other = two
    before = tables(one)
    jobs = start("evaluate", "b", "a", "--jobs", "1", cwd=one.parent)
    worker = evaluator(other)
    jobs.send_signal(number)
    jobs.communicate()
    assert jobs.returncode == (1 if number == signal.SIGINT else -number)
    until(lambda: gone(worker))
    assert not (other / TABLES[0]).exists()
    assert not list(one.parent.rglob("*.part"))
    assert tables(one) == before


def test_a_run_that_is_worked_on_is_refused(two: tuple[Path, Path]) -> None:
    one, _ = two
    with locked(one):
        alone = start("evaluate", "a", cwd=one.parent)
        _, told = alone.communicate()
    assert alone.returncode == 2
    assert f"error: a: process {os.getpid()} is at work in this folder" in told


@pytest.mark.parametrize(
    ("jobs", "says"),
    [
        ("0", "0 is not in the range x>=1"),
        ("-1", "-1 is not in the range x>=1"),
        (str(cores() + 1), f"{cores() + 1} processes on {cores()} cores"),
    ],
)
def test_numbers_of_jobs_that_make_no_sense_are_refused(
    tmp_path: Path, jobs: str, says: str
) -> None:
    asked = start("evaluate", "a", "--jobs", jobs, cwd=tmp_path)
    _, told = asked.communicate()
    assert asked.returncode == 2
    assert says in told
