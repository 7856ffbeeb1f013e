"""Looks at a rig's devices before anything is recorded: what `vrbench rig check` tells."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from vrbench.config.rig import SIMULATED, DeviceChoice, Rig
from vrbench.devices.host import RealClock
from vrbench.devices.ports import Finding, Session
from vrbench.errors import VrbenchError
from vrbench.plugin.manager import Plugins, check_options, pick


class Checked(NamedTuple):
    """A finding, and the device it is about: `mocap optitrack`."""

    device: str
    finding: Finding


def check_rig(rig: Rig, rig_name: str, plugins: Plugins) -> Iterator[Checked]:
    """What each of a rig's devices says of itself, headset first; nothing moves.

    All options are validated before the first device is looked at.

    Raises:
        ConfigError: a plugin isn't there, or an option is wrong.
    """
    chosen: list[tuple[str, DeviceChoice, Any, Any]] = []
    kinds: list[tuple[str, DeviceChoice | None, Any]] = [
        ("headset", rig.headset, plugins.headsets),
        ("mocap", rig.mocap, plugins.mocap),
        ("robot", rig.robot, plugins.robots),
    ]
    for kind, choice, things in kinds:
        if choice is None:
            continue
        spec: Any = pick(things, choice.plugin, kind, field=f"{kind}.plugin", file=rig_name)
        options = check_options(
            choice.options, spec.options, field=f"{kind}.options", file=rig_name
        )
        chosen.append((kind, choice, spec, options))
    session = Session(RealClock(), rig.mounting.tcp_eye.transform(), 0)
    for kind, choice, spec, options in chosen:
        device = f"{kind} {choice.plugin}"
        if choice.plugin == SIMULATED:
            yield Checked(device, Finding(True, "simulated: nothing to look at"))
        elif spec.check is None:
            yield Checked(device, Finding(True, "its plugin has no check"))
        else:
            try:
                for finding in spec.check(options, session):
                    yield Checked(device, finding)
            except VrbenchError as error:
                yield Checked(device, Finding(False, error.what, error.fix or ""))
