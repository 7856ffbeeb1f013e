"""What a rig names is found, and its options validated, before anything is touched."""

from dataclasses import replace
from pathlib import Path

import pytest
from pydantic import BaseModel, ConfigDict, Field

from vrbench.cli._rig_check import check_rig
from vrbench.config.rig import load_rig
from vrbench.devices.simulated.headset import HEADSET
from vrbench.devices.simulated.robot import ROBOT
from vrbench.errors import ConfigError
from vrbench.plugin.manager import Plugins
from vrbench.running.opening import chosen_device, chosen_devices


class Payload(BaseModel):
    model_config = ConfigDict(extra="forbid")
    kg: float = Field(ge=0.0)


class ArmOptions(BaseModel):
    model_config = ConfigDict(extra="forbid")
    payload: Payload = Payload(kg=0.0)
    kinematics: Path | None = None


@pytest.fixture
def plugins():
    """An arm, a route to headsets, and a headset whose recordings can only be imported."""
    found = Plugins()
    found.robots = {**found.robots, "arm": replace(ROBOT, name="arm", options=ArmOptions)}
    found.headsets = {
        **found.headsets,
        "route": replace(HEADSET, name="route", profile=None),
        "model": replace(HEADSET, name="model", open=None),
    }
    return found


@pytest.fixture
def lab(tmp_path):
    def write(headset, robot="plugin: arm"):
        path = tmp_path / "lab.yaml"
        path.write_text(f"lab: mine\nheadset: {{{headset}}}\nrobot:\n  {robot}\n", encoding="utf-8")
        return str(path)

    return write


ROUTE = "plugin: route, device: model"


@pytest.mark.parametrize(
    ("headset", "robot", "says"),
    [
        ("plugin: route, device: gone", "plugin: arm", r"headset\.device: no headset is called"),
        ("plugin: route", "plugin: arm", r"headset\.device: route is a route to headsets"),
        ("plugin: model", "plugin: arm", r"headset\.plugin: model has no live connection"),
        (ROUTE, "plugin: leg", r"robot\.plugin: no robot is called 'leg'"),
        (
            ROUTE,
            "plugin: arm\n  options: {payload: {kg: -1}}",
            r":5:23: robot\.options\.payload\.kg",
        ),
        # beside the options it is told of where it stands
        (ROUTE, "plugin: arm\n  payload: {kg: -1}", r":5:13: robot\.payload\.kg: found -1"),
        (ROUTE, "plugin: arm\n  tcp: [0]", r":5:3: robot\.tcp: there is no such field"),
    ],
)
def test_rig_check_refuses_what_a_run_refuses(lab, plugins, headset, robot, says):
    rig = lab(headset, robot)
    for opened in (chosen_devices, lambda *given: list(check_rig(*given))):
        with pytest.raises(ConfigError, match=rf"lab\.yaml.*{says}"):
            opened(load_rig(rig), rig, plugins)


def test_rig_check_tells_of_a_rig_that_is_simulated_in_part(lab, plugins):
    rig = lab(ROUTE, "plugin: sim")
    wrong = [found for found in check_rig(load_rig(rig), rig, plugins) if not found.finding.ok]
    assert [found.device for found in wrong] == ["robot"]
    assert "is simulated, and other devices" in wrong[0].finding.what


def test_files_among_options_lie_beside_the_rig(lab, plugins, tmp_path):
    rig = lab(ROUTE, "plugin: arm\n  options: {kinematics: mine.conf}")
    found = chosen_device("robot", load_rig(rig).robot, rig, plugins)
    assert found.options.kinematics == tmp_path / "mine.conf"
    # where no rig names the device, as the path was given
    found = chosen_device("robot", load_rig(rig).robot, None, plugins)
    assert found.options.kinematics == Path("mine.conf")
