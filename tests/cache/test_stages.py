"""What is computed again: what changed, and what rests on it; never less."""

from __future__ import annotations

import functools
import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from vrbench.cache.stages import EVALUATION, Stages, family_code
from vrbench.cache.store import Store
from vrbench.errors import DataError
from vrbench.metrics.registry import Family, builtin_families
from vrbench.metrics.scale import FAMILY as SCALE
from vrbench.protocols.registry import builtin_protocols
from vrbench.protocols.vrbench_1 import PROTOCOL
from vrbench.results.bundle import Bundle
from vrbench.sources import PACKAGE, code_of

TABLES = ("vrbench-1.csv", "vrbench-1.phase.csv", "vrbench-1.plots.json")
DEPTH = """
from vrbench.metrics.registry import Family, Value

def of_take(take):
    yield Value("depth", "max", 1.0 * len(take.samples), "mm", len(take.samples))

FAMILY = Family("depth", "How many samples there are", {"depth": "mm"}, of_take)
"""
EVALUATE = """
import json, sys
from pathlib import Path
from depth import FAMILY
from vrbench.cache.stages import Stages
from vrbench.cache.store import Store
from vrbench.evaluation import evaluate
from vrbench.plugin.manager import Plugins, families_of
from vrbench.protocols.vrbench_1 import PROTOCOL
from vrbench.results.bundle import Bundle

made, of = [], Stages.of
Stages.of = lambda *parts, **more: made.append(of(*parts, **more)) or made[0]
bundle = Bundle.open(Path(sys.argv[1]))
families = [*families_of(bundle.record.resolved_suite(), Plugins(), None), FAMILY]
store = Store(Path(sys.argv[2]), 10**9) if len(sys.argv) > 2 else None
evaluate(bundle, families, PROTOCOL, lambda *_: None, store)
print(json.dumps(made[0].computed))
"""


class Elsewhere:
    """vrbench's own code and a plugin's in another folder, where they can be changed."""

    def __init__(self, folder: Path, run: Path) -> None:
        self.folder, self.run = folder, run
        shutil.copytree(PACKAGE, folder / "vrbench", ignore=shutil.ignore_patterns("__pycache__"))
        (folder / "depth.py").write_text(DEPTH)

    def evaluate(self, *cache: str) -> tuple[Counter[str], list[bytes]]:
        """The stages that were computed, and the tables."""
        done = subprocess.run(
            [sys.executable, "-c", EVALUATE, self.run, *cache],
            cwd=self.folder,
            env={**os.environ, "PYTHONPATH": str(self.folder), "VRBENCH_PLUGINS": ""},
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stderr == ""
        tables = [(self.run / "metrics" / name).read_bytes() for name in TABLES]
        return Counter(json.loads(done.stdout)), tables

    def change(self, file: str, old: str, new: str) -> None:
        path = self.folder / file
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))


def test_only_what_changed_is_computed_again(tmp_path: Path, run: Path) -> None:
    there = Elsewhere(tmp_path, run)
    first, told = there.evaluate("cache")
    assert first["metric scale"] == first["metric depth"] == 4
    assert there.evaluate("cache") == (Counter(), told)

    there.change("vrbench/metrics/scale.py", 'title="', 'title="Its own ')
    there.change("depth.py", "1.0 *", "2.0 *")
    computed, other = there.evaluate("cache")
    assert computed == {"metric scale": 4, "metric depth": 4}
    assert other[0] != told[0]
    assert other[1:] == told[1:]

    there.change("vrbench/metrics/ape.py", "def of_take", "#\ndef of_take")
    computed, _ = there.evaluate("cache")
    assert computed == {"metric ape": 4, "variants": 4, "loops": 4}

    there.change("vrbench/estimation/clock.py", "def estimate_clock", "#\ndef estimate_clock")
    computed, last = there.evaluate("cache")
    assert computed["prepare"] == computed["calibrate"] + 2 == 4
    assert computed["columns"] == 0
    assert last == other

    without, plain = there.evaluate()
    assert plain == other
    assert (without["columns"], first["columns"]) == (6, 4)  # once for each content
    assert without - first == {"columns": 2}


def test_no_metric_is_a_part_of_what_all_of_them_rest_on() -> None:
    protocols = {PROTOCOL.prepare.__module__ for PROTOCOL in builtin_protocols()}
    base = code_of([EVALUATION, *protocols])
    assert PACKAGE / "scoring" / "cases.py" in base
    assert PACKAGE / "geometry.py" in base
    for family in builtin_families():
        (module,) = {f.__module__ for f in (family.of_take, family.of_repeats) if f is not None}
        own = code_of([module]) - base
        assert own, family.name
        assert family_code(family)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "cache", 10**6)


def test_a_result_rests_on_all_that_its_run_says(run: Path, store: Store) -> None:
    record = Bundle.open(run).record
    computed: list[str] = []

    def ask(what: str, protocol=PROTOCOL, **changed: object) -> int:
        stages = Stages.of(store, record.model_copy(update=changed), protocol)
        stages.kept("stage", lambda: computed.append(what), "take")
        return len(computed)

    takes = [record.takes[0].model_copy(update={"sha256": "0" * 64}), *record.takes[1:]]
    assert ask("first") == 1
    assert ask("the same") == 1
    assert ask("tables were written", files={}) == 1
    assert ask("a take's content", takes=takes) == 2
    assert ask("a take's order", takes=record.takes[::-1]) == 3
    assert ask("the suite", suite={**record.suite, "order": "abba"}) == 4
    assert ask("the accuracy", accuracy={}) == 4 + bool(record.accuracy)
    before = len(computed)
    assert ask("the protocol", replace(PROTOCOL, name="other")) == before + 1
    assert ask("and again", replace(PROTOCOL, name="other")) == before + 1


def test_two_results_of_one_name_are_a_mistake(run: Path) -> None:
    stages = Stages()
    stages.kept("stage", lambda: 1, "take")
    with pytest.raises(DataError, match="stage of take is asked for twice"):
        stages.kept("stage", lambda: 2, "take")


def captured(value: float):
    def of_take(take):
        yield value

    return of_take


@pytest.mark.parametrize(
    "function", [captured(1.0), lambda take: [], functools.partial(captured, 1.0), print]
)
def test_code_that_is_not_in_its_source_alone_is_never_known(function) -> None:
    assert family_code(replace(SCALE, of_take=function)) is None


def test_code_that_changed_since_the_process_began_is_never_known(monkeypatch) -> None:
    from vrbench.cache import stages

    stages._code_of.cache_clear()
    monkeypatch.setattr(stages, "STARTED", 0.0)
    assert family_code(SCALE) is None
    stages._code_of.cache_clear()


def test_a_family_is_known_by_what_it_states(run: Path) -> None:
    other: Family = replace(SCALE, units={**SCALE.units, "more": "mm"})
    assert family_code(other) != family_code(SCALE)
