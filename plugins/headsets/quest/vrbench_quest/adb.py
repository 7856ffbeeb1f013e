"""What a Quest tells and does by cable: `adb`, Android's debug bridge."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

from vrbench.devices.ports import Finding
from vrbench.errors import DeviceError

LONG_S = 20.0
GET_ADB = "install Android's platform tools (Debian: apt install adb), and put adb on the PATH"
LEAST_BATTERY = 30
# Android's thermal states; from 2 on clocks are lowered.
THERMAL = ("none", "light", "moderate", "severe", "critical", "emergency", "shutdown")
WARM = 2


class Adb:
    """Commands to one device.

    Args:
        serial: which device; None where only one is attached.
    """

    def __init__(self, serial: str | None = None) -> None:
        self._serial = serial

    def run(self, *words: str, seconds: float = LONG_S) -> str:
        """What a command prints.

        Raises:
            DeviceError: there is no adb, it fails, or it takes too long.
        """
        program = shutil.which("adb")
        if program is None:
            raise DeviceError("adb is not here", fix=GET_ADB)
        which = ("-s", self._serial) if self._serial else ()
        try:
            done = subprocess.run(
                [program, *which, *words],
                capture_output=True,
                text=True,
                errors="replace",
                timeout=seconds,
                stdin=subprocess.DEVNULL,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise DeviceError(
                f"adb {words[0]} took more than {seconds:g} s", fix="plug the cable in again"
            ) from None
        except OSError as error:
            raise DeviceError(f"adb can't be run: {error}", fix=GET_ADB) from error
        if done.returncode:
            said = (done.stderr.strip() or done.stdout.strip() or "no reason").splitlines()[-1]
            raise DeviceError(f"adb {' '.join(words[:2])}: {said}", fix="`adb devices` shows why")
        return done.stdout

    def shell(self, *words: str) -> str:
        """What a command on the device prints."""
        return self.run("shell", *words)

    def device(self) -> str:
        """The serial of the device that is meant, once it is ready.

        Raises:
            DeviceError: no adb, no device, one that isn't ready, or several.
        """
        rows = [line.split() for line in self.run("devices").splitlines()[1:] if line.strip()]
        states = {row[0]: row[1] for row in rows if len(row) >= 2}
        if self._serial is not None:
            states = {self._serial: states[self._serial]} if self._serial in states else {}
        if not states:
            what = f"no device {self._serial}" if self._serial else "no device"
            raise DeviceError(
                f"{what} is attached by adb",
                fix="plug the headset in, switch on developer mode, allow USB debugging in it",
            )
        if len(states) > 1:
            raise DeviceError(
                f"{len(states)} devices are attached: {', '.join(states)}",
                field="headset.options.serial",
                fix="say which is meant",
            )
        ((serial, state),) = states.items()
        if state != "device":
            raise DeviceError(
                f"{serial} is {state}", fix="put the headset on and allow USB debugging"
            )
        return serial

    def pull(self, package: str, take: str, folder: Path) -> list[Path]:
        """Copies the logs of a take from the device.

        Raises:
            DeviceError: as `run`, and where there is no log of the take.
        """
        where = f"/sdcard/Android/data/{package}/files"
        names = [
            name.strip()
            for name in self.shell("ls", where).splitlines()
            if name.strip().endswith(".csv") and name.strip().startswith(f"{take}.")
        ]
        if not names:
            raise DeviceError(f"no log of take {take} is in {where}", fix="was the take started?")
        folder.mkdir(parents=True, exist_ok=True)
        for name in names:
            self.run("pull", f"{where}/{name}", str(folder / name), seconds=300.0)
        return [folder / name for name in names]


def findings(adb: Adb, *, mannequin: bool) -> Iterator[Finding]:
    """What `vrbench rig check` tells of a Quest by cable; with `mannequin`, keeps it awake."""
    try:
        serial = adb.device()
        yield Finding(True, f"{_property(adb, 'ro.product.model')} {serial} is attached by adb")
        build = _property(adb, "ro.build.display.id") or _property(adb, "ro.build.version.release")
        yield Finding(True, f"firmware {build}: write it into the rig")
        if mannequin:
            adb.shell("am", "broadcast", "-a", "com.oculus.vrpowermanager.prox_close")
            yield Finding(True, "proximity sensor off until the next reboot: it stays awake")
        rate = _property(adb, "debug.oculus.refreshRate")
        yield Finding(True, f"refresh rate {rate} Hz" if rate else "refresh rate by the app")
        yield _battery(adb.shell("dumpsys", "battery"))
        yield _thermal(adb.shell("dumpsys", "thermalservice"))
    except DeviceError as error:
        yield Finding(False, error.what, error.fix or "")


def state_of(adb: Adb) -> dict[str, str | int]:
    """Battery and thermal state, for the take; empty where the device doesn't tell."""
    try:
        battery = _number(adb.shell("dumpsys", "battery"), "level")
        warm = _thermal_state(adb.shell("dumpsys", "thermalservice"))
    except DeviceError as error:
        return {"adb": error.what}
    state: dict[str, str | int] = {}
    if battery is not None:
        state["battery_percent"] = battery
    if warm is not None:
        state["thermal"] = THERMAL[warm]
    return state


def _property(adb: Adb, name: str) -> str:
    return adb.shell("getprop", name).strip()


def _number(text: str, name: str) -> int | None:
    found = re.search(rf"^\s*{name}:\s*(-?\d+)", text, re.MULTILINE | re.IGNORECASE)
    return int(found.group(1)) if found else None


def _thermal_state(text: str) -> int | None:
    state = _number(text, "Thermal Status")
    return state if state is not None and 0 <= state < len(THERMAL) else None


def _battery(text: str) -> Finding:
    level, heat = _number(text, "level"), _number(text, "temperature")
    if level is None:
        return Finding(False, "the battery's level isn't told", "look at it in the headset")
    told = f"battery {level} %" + ("" if heat is None else f", {heat / 10:.1f} C")
    return Finding(level >= LEAST_BATTERY, told, "charge it: a low battery lowers its clocks")


def _thermal(text: str) -> Finding:
    state = _thermal_state(text)
    if state is None:
        return Finding(True, "thermal state isn't told")
    return Finding(
        state < WARM, f"thermal state: {THERMAL[state]}", "let it cool, then warm it up for 10 min"
    )
