"""The house stands on its ground floor: imports run downwards only."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "vrbench"

# From the ground up, as DESIGN's "The house" lists it; the later may import the earlier.
ORDER = (
    *("sources", "errors", "digits", "geometry", "number_text", "text_file"),
    *("trajectory", "clocks", "streams"),
    "motion",
    *("estimation", "metrics"),
    "statistics",
    "protocols",
    "config",
    *("devices", "recording"),
    "plugin",
    "results",
    "cache",
    *("running", "runner", "calibration_motion", "importing"),
    *("scoring", "evaluation", "verification", "batch"),
    "exporting",
    "extraction",
    "cli",
    "__main__",
)
RECORD = {"motion", "devices", "recording"}
EVALUATE = {"estimation", "metrics", "statistics", "protocols"}
# Only these may import the library.
HOME = {
    "pluggy": "plugin",
    "mcap": "recording",
    "cv2": "nowhere: tests compare with it",
    "rosbags": "recording",
    "pooch": "recording",
    "requests": "recording",
    "distributed": "cli",
    "fsspec": "batch",
}
NETWORK = {"socket", "socketserver", "asyncio", "http", "urllib", "ssl", "requests", "websockets"}


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}


def imports(path: Path) -> Iterator[str]:
    """What a file imports, at its top, within functions, and for types alone."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                yield full if full in MODULES else str(node.module)


IMPORTS = {name: sorted(set(imports(path))) for name, path in MODULES.items()}


def floor(module: str) -> str | None:
    """`vrbench.metrics.ape` is on `metrics`; `vrbench` itself, its version, is under all."""
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else None


def inner(module: str) -> list[str]:
    return [name for name in IMPORTS[module] if name in MODULES]


def reached_from(*modules: str) -> set[str]:
    """These modules and all that they import, however far down."""
    found: set[str] = set()
    waiting = list(modules)
    while waiting:
        module = waiting.pop()
        if module not in found:
            found.add(module)
            waiting += inner(module)
    return found


def test_every_module_has_its_floor():
    assert {floor(name) for name in MODULES} - {None} <= set(ORDER)


@pytest.mark.parametrize("module", MODULES)
def test_imports_run_downwards_only(module):
    here = floor(module)
    if here is None:
        assert inner(module) == []
        return
    upwards = [
        name
        for name in inner(module)
        if floor(name) is not None and ORDER.index(floor(name)) > ORDER.index(here)
    ]
    assert upwards == []


def test_no_modules_import_each_other():
    graph = {name: [other for other in inner(name) if other != name] for name in MODULES}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"a circle of imports: {' -> '.join(error.args[1])}")


@pytest.mark.parametrize("module", MODULES)
def test_the_two_wings_never_import_each_other(module):
    floors = {floor(name) for name in inner(module)}
    if floor(module) in RECORD:
        assert floors & EVALUATE == set()
    if floor(module) in EVALUATE:
        assert floors & RECORD == set()


@pytest.mark.parametrize("module", MODULES)
def test_each_library_is_seen_in_its_home_only(module):
    outside = {
        library
        for library in {name.split(".")[0] for name in IMPORTS[module]} & set(HOME)
        if floor(module) != HOME[library]
    }
    assert outside == set()


def test_nothing_that_evaluates_opens_a_socket():
    wing = [name for name in MODULES if floor(name) in EVALUATE]
    for module in sorted(reached_from("vrbench.evaluation", *wing)):
        libraries = {name.split(".")[0] for name in IMPORTS[module]}
        assert libraries & NETWORK == set(), module


def loaded(code: str) -> set[str]:
    """The libraries that a fresh interpreter has loaded after the code."""
    code += "\nprint('\\n' + ' '.join({name.partition('.')[0] for name in sys.modules}))"
    run = subprocess.run(
        [sys.executable, "-c", f"import sys\n{code}"], capture_output=True, text=True, check=True
    )
    return set(run.stdout.splitlines()[-1].split())


HEAVY = {
    "requests",
    "pooch",
    "numpy",
    "scipy",
    "pydantic",
    "yaml",
    "pluggy",
    "mcap",
    "rosbags",
    "cv2",
    "rich",
}


@pytest.mark.parametrize(
    "code",
    [
        "import vrbench",
        "from vrbench.cli import cli\ncli(['--version'], standalone_mode=False)",
        "from vrbench.cli import cli\ncli(['--help'], standalone_mode=False)",
    ],
    ids=["import", "version", "help"],
)
def test_what_answers_at_once_loads_nothing_heavy(code):
    assert loaded(code) & HEAVY == set()


def test_what_plugins_import_for_their_hooks_is_light():
    assert loaded("from vrbench.plugin import PLUGIN_API, hookimpl") & HEAVY == {"pluggy"}


def test_the_imports_are_read_where_they_are_hidden():
    # the tests above rest on these being seen
    assert "vrbench.devices.specs" in IMPORTS["vrbench.plugin.hookspecs"]  # TYPE_CHECKING
    assert "vrbench.devices.simulated.headset" in IMPORTS["vrbench.plugin.builtin"]  # in a function
