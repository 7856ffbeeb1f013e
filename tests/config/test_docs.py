"""docs/suites.md: what it shows loads, and it names every field and knob there is."""

import re
from pathlib import Path

import pytest
import yaml

from vrbench.config.case import Case, Condition, Cue
from vrbench.config.suite import Suite, load_suite
from vrbench.metrics.registry import builtin_families
from vrbench.motion.files import Header, write_motion
from vrbench.motion.generators import GENERATORS, generate
from vrbench.plugin.manager import Plugins, families_of

TEXT = (Path(__file__).parents[2] / "docs" / "suites.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```yaml\n(.*?)```", TEXT, re.DOTALL)
SUITES = [block for block in BLOCKS if re.search(r"^suite:", block, re.MULTILINE)]


@pytest.mark.parametrize("text", SUITES)
def test_every_suite_that_is_shown_can_be_run(text, tmp_path):
    (tmp_path / "motions").mkdir()
    header = Header(motion="seated", version=1, up="y", rate_hz=120.0, source="generated")
    motion = generate("saturate-30s-1").trajectory
    write_motion(tmp_path / "motions" / "seated.tum", header, motion)
    path = tmp_path / "suite.yaml"
    path.write_text(text)
    suite = load_suite(str(path))
    families_of(suite, Plugins(), str(path))
    assert all(suite.motion(name) for name in suite.motions)
    assert len(list(suite.schedule())) > 5


def test_the_events_that_are_shown_are_events():
    (block,) = (block for block in BLOCKS if block.startswith("events:"))
    cues = [Cue.model_validate(cue) for cue in yaml.safe_load(block)["events"]]
    assert {cue.do for cue in cues} == {"occlude", "uncover", "recentre"}


def rows(heading: str) -> set[str]:
    """What stands in the first column below a heading, in backquotes."""
    part = TEXT.split(f"\n### {heading}\n")[1].split("\n### ")[0].split("\n## ")[0]
    first = re.findall(r"^\| (.*?) \|", part, re.MULTILINE)
    return {name for cell in first for name in re.findall(r"`(\w+)`", cell)}


def test_every_field_and_knob_stands_in_its_table():
    assert rows("Fields") == set(Suite.model_fields) | {"extends"}
    assert rows("Knobs") == set(Condition.model_fields) - {"id", "baseline"}
    assert rows("Cases") == {"scored", "calibration", "check"}
    assert rows("Conditions") == {"given", "abba", "shuffled"}
    assert set(Case.model_fields) - rows("Knobs") == {"id", "motion", "role"}


def test_every_motion_and_metric_family_is_named():
    named = set(re.findall(r"`([a-z0-9-]+)`", TEXT))
    assert set(GENERATORS) <= named
    families = next(line for line in TEXT.splitlines() if line.startswith("| `metrics`"))
    assert {family.name for family in builtin_families()} <= set(re.findall(r"\w+", families))


def test_every_suite_that_comes_along_is_described_with_its_number_of_takes():
    from vrbench.config.shipped import shipped_files

    for name in shipped_files("suites"):
        line = next(line for line in TEXT.splitlines() if line.startswith(f"| `{name}`"))
        takes = sum(1 for _ in load_suite(name).schedule())
        assert re.search(rf"\| {takes}(,|\s*\|)", line), line
