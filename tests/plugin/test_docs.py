"""docs/plugins.md says what the code does: hooks, fields, classes, and its code blocks run."""

import dataclasses
import inspect
import re
from pathlib import Path

import pytest

from vrbench.devices import specs
from vrbench.metrics.registry import Family
from vrbench.plugin import PLUGIN_API, hookspecs, testing
from vrbench.plugin.manager import KINDS
from vrbench.plugin.scaffold import steps
from vrbench.recording.importer import Importer

TEXT = (Path(__file__).parents[2] / "docs" / "plugins.md").read_text(encoding="utf-8")
HOOKS = [name for name in vars(hookspecs) if name.startswith("vrbench_")]
SPECS = (specs.HeadsetSpec, specs.MocapSpec, specs.RobotSpec, Importer, Family)
BLOCKS = re.findall(r"^```python\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("hook", HOOKS)
def test_every_hook_stands_there_with_its_exact_signature_and_what_it_is(hook):
    function = getattr(hookspecs, hook)
    signature = str(inspect.signature(function)).replace("'", "")
    assert f"### `{hook}{signature}`" in TEXT
    assert inspect.getdoc(function).rstrip(".") in TEXT


def test_no_other_hook_stands_there():
    assert re.findall(r"^### `(vrbench_\w+)\(", TEXT, re.MULTILINE) == HOOKS


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.__name__)
def test_every_field_of_what_hooks_return_stands_there_in_order(spec):
    fields = ", ".join(f"`{field.name}`" for field in dataclasses.fields(spec))
    assert f"| `{spec.__name__}` | {fields} |" in TEXT


def test_every_conformance_class_stands_there():
    classes = [name for name in testing.__all__ if name.endswith("Conformance")]
    told = re.findall(r"^\| `(\w+Conformance)` \|", TEXT, re.MULTILINE)
    assert sorted(told) == sorted(classes)


def test_the_api_s_version_and_all_kinds_stand_there():
    assert f"PLUGIN_API = {PLUGIN_API}`" in TEXT
    assert "plugin new headset" in TEXT
    assert f"plugin new {'|'.join(kind for kind in KINDS if kind != 'headset')} NAME" in TEXT


def test_the_five_commands_are_those_that_plugin_new_prints():
    block = re.search(r"```console setup\n(.*?)```", TEXT, re.DOTALL)[1]
    written = [line.removeprefix("$ ") for line in block.strip().splitlines()]
    printed = steps(Path("vrbench-pico4"), "pico4")
    assert written[0] == "vrbench plugin new headset pico4"
    assert written[2:] == printed[1:]
    assert written[1].split()[-1].removeprefix("./") == printed[0].split()[-1]


@pytest.mark.parametrize("block", BLOCKS, ids=range(len(BLOCKS)))
def test_every_block_of_python_runs(block):
    exec(compile(block, "docs/plugins.md", "exec"), {"__file__": __file__, "__name__": "docs"})
