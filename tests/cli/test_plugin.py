"""`vrbench plugin` as a user meets it: broken plugins are listed, and harm nothing else."""

import json
import os
import subprocess
import sys

import pytest

SOUND = """
    from vrbench.devices.specs import HeadsetSpec
    from vrbench.plugin import hookimpl

    @hookimpl
    def vrbench_headsets():
        return [HeadsetSpec(name="{name}", title="A headset")]
"""
MARK = "a plugin was imported"
BAD = {
    "raises": "raise RuntimeError('no sdk here')",
    "old-api": "PLUGIN_API = 99",
    "wrong-type": SOUND.format(name="x").replace('[HeadsetSpec(name="x", title="A headset")]', "3"),
    "twin": SOUND.format(name="twin-1"),
    "twin-again": SOUND.format(name="twin-2"),
}
SAYS = ("no sdk here", "is made for plugin API 99", "it must return a list", "called 'twin' too")


@pytest.fixture(scope="module")
def crowd(tmp_path_factory):
    """An environment with 50 sound plugins that tell of their import, and with bad ones."""
    folder = tmp_path_factory.mktemp("crowd")
    loud = f"import sys; sys.stderr.write({MARK!r})\n"
    sound = {f"good-{n}": loud + _flat(SOUND.format(name=f"good-{n}")) for n in range(50)}
    for name, code in {**sound, **{name: _flat(code) for name, code in BAD.items()}}.items():
        module = f"crowd_{name.replace('-', '_')}"
        info = folder / f"{module}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
        entry = "twin" if name.startswith("twin") else name
        (info / "entry_points.txt").write_text(f"[vrbench]\n{entry} = {module}\n")
        (folder / f"{module}.py").write_text(code)
    return folder


def _flat(code):
    return "\n".join(line.removeprefix("    ") for line in code.splitlines())


def vrbench(crowd, *words, code=None):
    command = [sys.executable, "-c", code] if code else [sys.executable, "-m", "vrbench", *words]
    told = {k: v for k, v in os.environ.items() if k != "VRBENCH_PLUGINS"}
    return subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        cwd=crowd,
        env={**told, "PYTHONPATH": str(crowd), "COLUMNS": "400"},
    )


def test_help_imports_no_plugin_however_many_there_are(crowd):
    done = vrbench(crowd, "--help")
    assert done.returncode == 0
    assert done.stderr == ""
    # nor does it look which there are
    code = (
        "import sys; from vrbench.cli import cli\n"
        "cli(['--help'], standalone_mode=False); sys.exit('importlib.metadata' in sys.modules)"
    )
    assert vrbench(crowd, code=code).returncode == 0


def test_bad_plugins_are_listed_with_the_reason_and_harm_no_other(crowd):
    done = vrbench(crowd, "plugin", "list")
    assert done.returncode == 0, done.stderr
    for says in SAYS:
        assert says in done.stdout
    assert "Traceback" not in done.stdout + done.stderr
    for n in range(50):
        assert f"good-{n} " in done.stdout
    assert done.stderr.count(MARK) == 50


def test_checking_a_broken_plugin_says_why_it_is(crowd):
    done = vrbench(crowd, "plugin", "check", "raises")
    assert done.returncode == 2
    assert "plugin raises is broken: RuntimeError: no sdk here" in done.stderr


def test_a_check_that_fails_ends_with_1_and_keeps_what_it_found(crowd, tmp_path):
    name = crowd / "crowd_good_7.py"
    name.write_text(name.read_text().replace('"A headset"', '" "'))
    report = tmp_path / "report.json"
    done = vrbench(crowd, "plugin", "check", "good-7", "-o", str(report))
    assert done.returncode == 1
    assert "FAILED Its name is one" in done.stdout
    assert "Say in `title` what it is" in done.stdout
    (told,) = json.loads(report.read_text(encoding="utf-8"))
    assert told["passed"] is False
