"""Memory that isn't there is told before anything begins."""

from __future__ import annotations

from pathlib import Path

import pytest

from vrbench.batch import memory
from vrbench.batch.memory import available_bytes, check_memory_of_all, needed_bytes
from vrbench.batch.unit import Unit, perform
from vrbench.errors import ConfigError
from vrbench.recording.summary import PACKED_BYTES, poses_in
from vrbench.recording.take import read_take
from vrbench.results.bundle import Bundle


def free(monkeypatch: pytest.MonkeyPatch, amount: float) -> None:
    monkeypatch.setattr(memory, "available_bytes", lambda: amount)


def test_a_take_says_how_large_it_is(run: Path) -> None:
    path = next((run / "takes").glob("replay*"))
    columns = read_take(path)
    held = sum(len(samples) for samples in columns.poses.values())
    assert poses_in(path) == held
    path.write_bytes(path.read_bytes()[:-100])
    assert held < poses_in(path) == path.stat().st_size // PACKED_BYTES


def test_a_run_larger_than_memory_is_told_before_it_begins(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    need = needed_bytes(Bundle.open(run))
    assert 2e8 < need < 1e9
    told: list[str] = []
    unit = Unit("mine", str(run), "vrbench-1", cached=False)
    free(monkeypatch, need - 1)
    outcome = perform(unit, lambda what, part: told.append(what))
    assert f"of memory, {(need - 1) / 1e6:.0f} MB are free" in str(outcome.error)
    assert told == []
    free(monkeypatch, need)
    assert perform(unit, lambda what, part: told.append(what)).error is None
    assert told


def test_so_are_several_that_together_are(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    need = needed_bytes(Bundle.open(run))
    free(monkeypatch, 2.5 * need)
    check_memory_of_all([str(run)] * 5, 2)
    check_memory_of_all([str(run)] * 2 + ["none"], 3)
    with pytest.raises(ConfigError, match=r"3 of these runs at a time .* MB are free .2 at most"):
        check_memory_of_all([str(run)] * 5, 3)
    free(monkeypatch, 0.5 * need)
    check_memory_of_all([str(run)] * 5, 3)  # each is told by itself


def test_the_system_says_what_it_has() -> None:
    found = available_bytes()
    assert found is None or found > 1e6
