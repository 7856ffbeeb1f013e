import subprocess
import sys
import tomllib
from pathlib import Path

import pluggy
import vrbench_qualisys

HERE = Path(__file__).parents[1]


def test_the_entry_point_names_the_package():
    project = tomllib.loads((HERE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["entry-points"] == {"vrbench": {"qualisys": vrbench_qualisys.__name__}}


def test_the_hooks_give_a_source_and_an_importer():
    manager = pluggy.PluginManager("vrbench")
    manager.register(vrbench_qualisys, "qualisys")
    ((spec,),) = manager.hook.vrbench_mocap()
    ((importer,),) = manager.hook.vrbench_importers()
    assert (spec.name, importer.name) == ("qualisys", "qtm-6d-tsv")


def test_the_plugin_is_offered_without_loading_the_vendors_sdk():
    code = "import sys, vrbench_qualisys as q; q.vrbench_mocap(); sys.exit('qtm_rt' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
