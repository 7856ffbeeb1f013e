"""Looks at a rig's devices before anything is recorded: what `vrbench rig check` tells."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from vrbench.config.rig import SIMULATED, Rig
from vrbench.devices.host import RealClock
from vrbench.devices.ports import Finding, Session
from vrbench.errors import ConfigError, VrbenchError
from vrbench.plugin.manager import Plugins
from vrbench.running.opening import chosen_devices, is_simulated


class Checked(NamedTuple):
    """A finding, and the device it is about: `mocap optitrack`."""

    device: str
    finding: Finding


def check_rig(rig: Rig, rig_name: str, plugins: Plugins) -> Iterator[Checked]:
    """What each of a rig's devices says of itself, headset first; nothing moves.

    All that `run` refuses at once is told, and before the first device is looked at.

    Raises:
        ConfigError: as `vrbench.running.opening.chosen_devices`.
    """
    chosen = chosen_devices(rig, rig_name, plugins)
    try:
        is_simulated(rig, rig_name)
    except ConfigError as error:
        yield Checked(error.field or "rig", Finding(False, error.what, error.fix or ""))
    session = Session(RealClock(), rig.mounting.tcp_eye.transform(), 0)
    for found in chosen:
        spec, device = found.spec, f"{found.kind} {found.spec.name}"
        if spec.name == SIMULATED:
            yield Checked(device, Finding(True, "simulated: nothing to look at"))
        elif spec.check is None:
            yield Checked(device, Finding(True, "its plugin has no check"))
        else:
            try:
                for finding in spec.check(found.options, session):
                    yield Checked(device, finding)
            except VrbenchError as error:
                yield Checked(device, Finding(False, error.what, error.fix or ""))
