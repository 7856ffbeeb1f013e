"""What only a process of its own can show: SDKs that are loaded too soon, devices that hang."""

import os
import textwrap

import pytest

from vrbench.plugin.testing import child
from vrbench.plugin.testing.child import check_registration, check_without_device
from vrbench.plugin.testing.verdicts import NonconformityError

DEVICE = """
import time
{top}
from vrbench.devices.specs import HeadsetProfile, HeadsetSpec
from vrbench.errors import DeviceError
from vrbench.plugin import hookimpl

class Device:
    def __init__(self, *_):
        pass
    def __enter__(self):
        {enter}
        return self
    def __exit__(self, *_):
        pass
    def start(self, take):
        {start}
    def stop(self):
        pass

@hookimpl
def vrbench_headsets():
    return [HeadsetSpec("pico4", "Pico 4", HeadsetProfile(72.0), open=Device)]
"""


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Installs a plugin `pico4` and a vendor's SDK, where children find them."""

    def distribution(name, module, code, entry=""):
        info = tmp_path / f"{module}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        (info / "RECORD").write_text(f"{module}.py,,\n")
        if entry:
            (info / "entry_points.txt").write_text(f"[vrbench]\n{entry} = {module}\n")
        (tmp_path / f"{module}.py").write_text(textwrap.dedent(code))

    def install(*, top="", enter="pass", start="pass"):
        distribution("vendor-sdk", "vendor_sdk", "")
        code = DEVICE.format(top=top, enter=enter, start=start)
        distribution("vrbench-pico4", "vrbench_pico4", code, "pico4")
        monkeypatch.setenv("PYTHONPATH", str(tmp_path))
        monkeypatch.setenv("VRBENCH_PLUGINS", "pico4")
        check_registration.cache_clear()

    yield install
    check_registration.cache_clear()


def test_an_sdk_that_registering_imports_is_named(installed):
    installed(top="import vendor_sdk")
    with pytest.raises(NonconformityError, match=r"imports vendor-sdk.*inside the function"):
        check_registration("pico4")


@pytest.mark.parametrize("bare", ["a module", "a package"])
def test_so_is_one_without_metadata(installed, tmp_path, monkeypatch, bare):
    installed(top="import bare_sdk")
    folder = tmp_path / "copied"
    (folder / "bare_sdk").mkdir(parents=True)
    (folder / ("bare_sdk.py" if bare == "a module" else "bare_sdk/__init__.py")).touch()
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{folder}")
    with pytest.raises(NonconformityError, match="imports bare_sdk"):
        check_registration("pico4")


def test_a_second_module_of_its_own_is_not(installed, tmp_path):
    installed(top="import pico4_poses")
    (tmp_path / "pico4_poses.py").touch()
    check_registration("pico4")


def test_one_that_is_imported_where_the_device_is_opened_is_no_trouble(installed):
    installed(top="import numpy, pydantic, json", enter="import vendor_sdk")
    check_registration("pico4")


NO_DEVICE = {
    "hangs": ({"enter": "time.sleep(60)"}, "hangs: nothing came of it in 4 s.*a timeout"),
    "hangs when it starts": ({"start": "time.sleep(60)"}, "hangs"),
    "raises what it likes": ({"enter": "raise OSError('gone')"}, "raises OSError: gone.*a sent"),
    "says not what to do": ({"start": "raise DeviceError('no device')"}, "not what to do.*fix"),
    "says nothing": ({}, "opens and starts all the same.*DeviceError"),
    "kills its process": ({"enter": "import os; os._exit(3)"}, "ended with code 3"),
}


@pytest.mark.parametrize("how", NO_DEVICE)
def test_with_no_device_a_plugin_that(how, installed, monkeypatch):
    code, says = NO_DEVICE[how]
    installed(**code)
    if "hangs" in how:
        monkeypatch.setattr(child, "PATIENCE_S", 4.0)
    with pytest.raises(NonconformityError, match=f"(?s){says}"):
        check_without_device("headset", "pico4", {})


def test_one_that_says_what_to_do_passes(installed):
    installed(start="raise DeviceError('no pose came', fix='switch it on')")
    check_without_device("headset", "pico4", {})
