import subprocess
import sys
import tomllib
from pathlib import Path

import pluggy
import pytest
import vrbench_quest
from vrbench_quest.profiles import HEADSETS, RATE_HZ

HERE = Path(__file__).parents[1]


def test_the_entry_point_names_the_package():
    project = tomllib.loads((HERE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["entry-points"] == {"vrbench": {"quest": vrbench_quest.__name__}}
    assert project["name"] == "vrbench-quest"


def test_the_hooks_give_models_a_route_and_two_importers():
    manager = pluggy.PluginManager("vrbench")
    manager.register(vrbench_quest, "quest")
    (headsets,) = manager.hook.vrbench_headsets()
    (importers,) = manager.hook.vrbench_importers()
    assert [x.name for x in headsets] == ["quest-2", "quest-pro", "quest-3", "quest-3s", "quest"]
    assert [x.name for x in importers] == ["quest-unity-csv", "quest-vrbench-csv"]


def test_the_plugin_is_listed_without_loading_numpy():
    code = "import sys, vrbench_quest; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("spec", HEADSETS, ids=lambda spec: spec.name)
def test_every_level_covers_cameras_that_the_headset_has(spec):
    profile = spec.profile
    assert profile.occlusion["none"] == ()
    for ids in profile.occlusion.values():
        assert set(ids) <= set(profile.cameras)
        assert len(set(ids)) == len(ids)
    assert len(profile.occlusion["two"]) == 2
    assert len(profile.occlusion["three"]) == 3
    assert profile.clock == "utc"
    assert profile.rate_hz == RATE_HZ


@pytest.mark.parametrize("spec", HEADSETS, ids=lambda spec: spec.name)
def test_every_stand_in_says_where_its_numbers_come_from(spec):
    assert "made up" in spec.profile.tracking.source


def test_the_stand_ins_of_the_papers_two_headsets_differ_and_not_by_twice():
    q2, pro = (
        next(x.profile.tracking for x in HEADSETS if x.name == name)
        for name in ("quest-2", "quest-pro")
    )
    assert 1.2 < q2.position_noise_m / pro.position_noise_m < 2.0
