import inspect
import re
import subprocess
import sys
import textwrap
from types import SimpleNamespace

import pytest
from pydantic import BaseModel, ConfigDict

from vrbench.errors import ConfigError
from vrbench.plugin import PLUGIN_API, builtin, hookspecs
from vrbench.plugin.manager import BUILTIN, NARROW, Plugins, check_options, families_of, pick
from vrbench.plugin.testing import HeadsetModelConformance, NonconformityError

HOOKS = [name for name in vars(hookspecs) if name.startswith("vrbench_")]
SOUND = """
    from vrbench.devices.specs import HeadsetSpec
    from vrbench.plugin import hookimpl

    @hookimpl
    def vrbench_headsets():
        return [HeadsetSpec(name="{name}", title="A headset")]
"""
GOOD = SOUND.format(name="good-1")


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Puts a distribution with one plugin on sys.path; only what is put there is found."""
    wanted: list[str] = []

    def install(name: str, code: str, *, entry: str | None = None, version: str = "1.2") -> None:
        folder = tmp_path / name
        module = f"plugin_{name.replace('-', '_')}"
        info = folder / f"{name.replace('-', '_')}-{version}.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n", encoding="utf-8"
        )
        (info / "entry_points.txt").write_text(
            f"[vrbench]\n{entry or name} = {module}\n", encoding="utf-8"
        )
        (folder / f"{module}.py").write_text(textwrap.dedent(code), encoding="utf-8")
        monkeypatch.syspath_prepend(folder)
        monkeypatch.delitem(sys.modules, module, raising=False)
        wanted.append(entry or name)
        monkeypatch.setenv(NARROW, ",".join(wanted))

    monkeypatch.setenv(NARROW, "")
    yield install
    for name in [name for name in sys.modules if name.startswith("plugin_")]:
        del sys.modules[name]


def broken(plugins: Plugins) -> dict[str, str]:
    return {info.name: info.broken for info in plugins.infos if info.broken}


# what is built in


def test_what_is_built_in_comes_through_the_same_hooks():
    for name in ("headsets", "robots", "importers", "metrics", "suites"):
        function = getattr(builtin, f"vrbench_{name}")
        assert function.vrbench_impl, f"{name} is not marked with @hookimpl"


def test_alone_the_built_in_plugin_offers_a_simulated_lab(install):
    plugins = Plugins()
    assert [info.name for info in plugins.infos] == [BUILTIN]
    assert broken(plugins) == {}
    assert set(plugins.headsets) == set(plugins.robots) == set(plugins.mocap) == {"sim"}
    assert "tum" in plugins.importers
    assert "ape" in plugins.metrics
    assert "gameplay-replay" in plugins.suites


def test_each_hook_has_an_attribute_that_asks_it_and_a_line_that_tells_of_it(install):
    plugins = Plugins()
    for hook in HOOKS:
        assert isinstance(getattr(plugins, hook.removeprefix("vrbench_")), dict)
        assert inspect.getdoc(getattr(hookspecs, hook))


def test_a_fault_of_what_is_built_in_is_no_plugins_and_comes_out(install, monkeypatch):
    import vrbench.metrics.registry as registry

    def fail():
        raise RuntimeError("a bug of ours")

    monkeypatch.setattr(registry, "builtin_families", fail)
    with pytest.raises(RuntimeError, match="a bug of ours"):
        Plugins().metrics  # noqa: B018


# sound plugins


def test_a_plugin_is_found_with_its_distribution_and_version(install):
    install("vrbench-good", GOOD, entry="good")
    plugins = Plugins()
    info = plugins.infos[-1]
    assert (info.name, info.distribution, info.version, info.broken) == (
        "good",
        "vrbench-good",
        "1.2",
        None,
    )
    assert list(plugins.headsets) == ["sim", "good-1"]
    assert plugins.versions()["vrbench-good"] == "1.2"


def test_an_environment_variable_narrows_plugins(install, monkeypatch):
    install("one", SOUND.format(name="one-1"))
    install("two", SOUND.format(name="two-1"))
    monkeypatch.setenv(NARROW, "two")
    assert [info.name for info in Plugins().infos] == [BUILTIN, "two"]
    monkeypatch.setenv(NARROW, "")
    assert [info.name for info in Plugins().infos] == [BUILTIN]
    monkeypatch.delenv(NARROW)
    assert {"one", "two"} <= {info.name for info in Plugins().infos}


def test_a_hook_is_called_when_what_it_returns_is_asked_for_and_once(install, capsys):
    install("loud", "print('imported')\n" + hook("print('called'); return []"))
    plugins = Plugins()
    assert capsys.readouterr().out == "imported\n"
    for _ in range(2):
        assert list(plugins.headsets) == ["sim"]
    assert capsys.readouterr().out == "called\n"


def test_a_plugin_may_return_any_iterable_of_the_right_things(install):
    install("lazy", GOOD.replace("return [", "yield (").replace('headset")]', 'headset"))'))
    assert "good-1" in Plugins().headsets


def test_a_plugin_may_offer_suites(install, tmp_path):
    path = tmp_path / "swing.yaml"
    path.write_text("")
    install(
        "suites",
        f"""
        from pathlib import Path
        from vrbench.plugin import hookimpl

        @hookimpl
        def vrbench_suites():
            return [Path({str(path)!r})]
        """,
    )
    assert Plugins().suites["swing"] == path


# broken plugins, each beside a good one


def hook(body: str, name: str = "vrbench_headsets", mark: str = "@hookimpl") -> str:
    return (
        "from vrbench.devices.specs import HeadsetSpec\n"
        "from vrbench.plugin import hookimpl\n"
        f"{mark}\ndef {name}():\n    {body}\n"
    )


BAD = {
    "raises at import": (
        "raise RuntimeError('no sdk')",
        "RuntimeError: no sdk, at .*bad.py:1 .*pip install",
    ),
    "lacks a library": ("import vendor_sdk", "ModuleNotFoundError: .*vendor_sdk"),
    "is no Python": ("def", "SyntaxError"),
    "hangs up": ("raise SystemExit(3)", "SystemExit: 3"),
    "of another API": (f"PLUGIN_API = {PLUGIN_API + 1}", "is made for plugin API 2, .*has 1"),
    "misspells a hook": (hook("return []", "vrbench_headset"), "vrbench_headset"),
    "wants arguments": (
        hook("return []").replace("vrbench_headsets()", "vrbench_headsets(rig)"),
        "rig",
    ),
    "raises in a hook": (hook("raise OSError('gone')"), "vrbench_headsets raises OSError: gone"),
    "hangs up in a hook": (hook("raise SystemExit"), "vrbench_headsets raises SystemExit"),
    "returns nothing": (hook("return None"), "vrbench_headsets returns None.*list of HeadsetSpec"),
    "returns a name": (hook("return 'bad'"), "returns a str.*list of HeadsetSpec"),
    "returns names": (hook("return ['bad']"), "offers a str.*list of HeadsetSpec"),
    "returns one": (hook("return HeadsetSpec('bad', 'Bad')"), "returns a HeadsetSpec.*list of"),
    "returns robots": (
        hook("return [HeadsetSpec('bad', 'Bad')]", "vrbench_robots"),
        "vrbench_robots offers a HeadsetSpec.*list of RobotSpec",
    ),
    "of another API, as text": (f"PLUGIN_API = '{PLUGIN_API}'", "plugin API '1', .*has 1"),
    "raises in a line": (
        hook("return\n") + "\nraise RuntimeError('boom')",
        r"RuntimeError: boom, at .*plugin_bad\.py:8 \(",
    ),
    "raises in a line of a hook": (hook("1 / 0"), r"division by zero, at .*plugin_bad\.py:5$"),
    "forgets the mark": (hook("return []", mark=""), "vrbench_headsets lacks @hookimpl"),
    "takes a built-in name": (
        hook("return [HeadsetSpec('sim', 'B')]"),
        "offers 'sim', and that name is taken by builtin",
    ),
    "takes a name twice": (
        hook("return [HeadsetSpec('bad', 'B'), HeadsetSpec('bad', 'B')]"),
        "offers 'bad' twice",
    ),
    "takes a neighbour's name": (
        hook("return [HeadsetSpec('good-1', 'B')]"),
        "offers 'good-1', and that name is taken by a-good",
    ),
}


@pytest.mark.parametrize("how", BAD)
def test_a_plugin_that(how, install):
    code, reason = BAD[how]
    install("a-good", GOOD)
    install("bad", code)
    install("c-good", SOUND.format(name="good-2"))
    plugins = Plugins()
    found = broken(plugins)
    assert list(found) == ["bad"]
    assert re.search(reason, found["bad"])
    assert list(plugins.headsets) == ["sim", "good-1", "good-2"]
    assert list(plugins.robots) == ["sim"]


def test_a_name_that_is_taken_leaves_its_plugins_other_names_alone(install):
    install("a-lab", hook("return [HeadsetSpec('good-1', 'A')]"))
    install("b-lab", hook("return [HeadsetSpec('good-1', 'B'), HeadsetSpec('good-2', 'B')]"))
    plugins = Plugins()
    assert {name: spec.title for name, spec in plugins.headsets.items() if name != "sim"} == {
        "good-1": "A",
        "good-2": "B",
    }
    assert "taken by a-lab" in broken(plugins)["b-lab"]
    assert plugins.passed_by("headset", "good-1") == ("b-lab",)
    assert plugins.passed_by("headset", "good-2") == ()


def test_conformance_tells_of_its_plugins_other_hooks_and_of_rivals(install):
    class Lab(HeadsetModelConformance):
        name = "lab-1"

    lab = hook("return [HeadsetSpec('lab-1', 'Lab')]")
    install("a-lab", lab + hook("return None", "vrbench_mocap"))
    with pytest.raises(NonconformityError, match="plugin a-lab: vrbench_mocap returns None"):
        Lab().test_its_plugin_is_whole()

    class Rival(HeadsetModelConformance):
        name = "lab-2"

    lab = hook("return [HeadsetSpec('lab-2', 'Lab')]")
    install("b-lab", lab)
    install("c-lab", lab)
    with pytest.raises(NonconformityError, match="c-lab offers a headset called 'lab-2' too"):
        Rival().test_its_plugin_is_whole()


def test_a_broken_hook_leaves_its_plugins_other_hooks_alone(install):
    code = hook("return [HeadsetSpec('lab-1', 'Lab')]") + hook("return None", "vrbench_importers")
    install("lab", code + hook("return None", "vrbench_mocap"))
    plugins = Plugins()
    assert "lab-1" in plugins.headsets
    assert "tum" in plugins.importers
    reason = broken(plugins)["lab"]
    assert "vrbench_importers returns None" in reason
    assert "vrbench_mocap returns None" in reason
    # what a run used of it is on record
    assert plugins.versions()["lab"] == "1.2"


def test_of_two_plugins_with_one_name_the_second_is_broken(install):
    install("lab-a", SOUND.format(name="a-1"), entry="lab")
    install("lab-b", SOUND.format(name="b-1"), entry="lab")
    plugins = Plugins()
    assert [info.broken is None for info in plugins.infos] == [True, True, False]
    assert "another plugin is called 'lab' too" in plugins.infos[2].broken
    assert len(plugins.headsets) == 2
    assert set(plugins.versions()) == {"vrbench", plugins.infos[1].distribution}


def test_a_plugin_may_not_pass_for_what_is_built_in(install):
    install("lab", GOOD, entry=BUILTIN)
    plugins = Plugins()
    assert list(plugins.headsets) == ["sim"]
    assert "another plugin is called 'builtin' too" in plugins.infos[1].broken


def test_who_interrupts_is_obeyed(install):
    install("slow", "raise KeyboardInterrupt")
    with pytest.raises(KeyboardInterrupt):
        Plugins()


# picking and options


def test_what_is_not_there_lists_what_is(install):
    install("good", GOOD)
    with pytest.raises(
        ConfigError,
        match=r"lab\.yaml: headset\.plugin: no headset is called 'x' .*good-1, sim.*plugin list",
    ):
        pick(Plugins().headsets, "x", "headset", field="headset.plugin", file="lab.yaml")


def test_where_there_is_nothing_it_says_none():
    with pytest.raises(ConfigError, match="there are none"):
        pick({}, "x", "robot", field="robot", file=None)


class Options(BaseModel):
    model_config = ConfigDict(extra="forbid")
    host: str


def test_options_are_checked_by_the_plugins_own_model():
    assert check_options({"host": "h"}, Options, field="robot", file=None).host == "h"
    with pytest.raises(
        ConfigError, match=r"lab\.yaml: robot\.options: hots: .*no such field.*fields are host"
    ):
        check_options({"host": "h", "hots": 1}, Options, field="robot.options", file="lab.yaml")


def test_a_wrong_option_is_shown_by_its_line_and_column(tmp_path):
    rig = tmp_path / "lab.yaml"
    rig.write_text("lab: x\nrobot:\n  plugin: ur5e\n  options: {host: h, hots: 1}\n")
    with pytest.raises(
        ConfigError, match=r"lab\.yaml:4:22: robot\.options\.hots: there is no such"
    ):
        check_options({"host": "h", "hots": 1}, Options, field="robot.options", file=str(rig))
    rig.write_text("takes:\n  - case: a\n    robot: {format: x,\n      hots: 1}\n")
    with pytest.raises(ConfigError, match=r"lab\.yaml:4:7: takes\.0\.robot\.hots: "):
        check_options({"host": "h", "hots": 1}, Options, field="takes.0.robot", file=str(rig))


def test_what_is_not_there_is_shown_by_its_line_and_column(tmp_path):
    rig = tmp_path / "lab.yaml"
    rig.write_text("lab: x\nrobot: {plugin: ur9, options: {}}\n")
    with pytest.raises(
        ConfigError, match=r"lab\.yaml:2:9: robot\.plugin: no robot is called 'ur9'"
    ):
        pick({}, "ur9", "robot", field="robot.plugin", file=str(rig))


def test_a_suites_unknown_metric_is_shown_by_its_line_and_column(tmp_path, monkeypatch):
    monkeypatch.setenv(NARROW, "")
    file = tmp_path / "s.yaml"
    file.write_text("suite: s\nmetrics:\n  - ape\n  - clok\nrank: {metric: ape.none}\n")
    suite = SimpleNamespace(metrics=["ape", "clok"], rank=SimpleNamespace(metric="ape.none"))
    with pytest.raises(ConfigError, match=r"s\.yaml:4:5: metrics\.1: no metric is called 'clok'"):
        families_of(suite, Plugins(), str(file))
    suite.metrics = ["ape"]
    with pytest.raises(ConfigError, match=r"s\.yaml:5:8: rank\.metric: the suite ranks by"):
        families_of(suite, Plugins(), str(file))


def test_listing_imports_no_vendors_sdk_and_no_scipy():
    code = (
        "import sys; from vrbench.plugin.manager import Plugins; Plugins().infos; "
        "print(sorted({'cv2', 'rosbags', 'scipy', 'mcap', 'rtde_control'} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
