"""The emulator's dashboard port: a line in, a line out."""

from __future__ import annotations

from vrbench_ur import rtde
from vrbench_ur.emulator.controller import Controller

GREETING = "Connected: Universal Robots Dashboard Server\n"
SAFETY = {
    1: "NORMAL",
    2: "REDUCED",
    3: "PROTECTIVE_STOP",
    5: "SAFEGUARD_STOP",
    7: "ROBOT_EMERGENCY_STOP",
}


def answer(
    line: str, controller: Controller, version: tuple[int, int, int, int]
) -> tuple[str, bool]:
    """What the dashboard says to a line, and whether it hangs up then."""
    playing = controller.runtime == rtde.RUNTIME_PLAYING
    safety = SAFETY[controller.safety_mode]
    told = {
        "polyscopeversion": "URSoftware {}.{}.{}.{} (Jan 01 2024)".format(*version),
        "get serial number": "20240000000",
        "get robot model": controller.arm.model,
        "is in remote control": str(controller.remote).lower(),
        "robotmode": "Robotmode: POWER_OFF"
        if rtde.EMERGENCY in controller.safety
        else "Robotmode: RUNNING",
        "safetystatus": f"Safetystatus: {safety}",
        "safetymode": f"Safetymode: {safety}",
        "programstate": "PLAYING rtde_control" if playing else "STOPPED rtde_control",
        "running": f"Program running: {str(playing).lower()}",
        "get loaded program": "No program loaded",
        "isprogramsaved": "true",
        "close popup": "closing popup",
        "close safety popup": "closing safety popup",
        "power on": "Powering on",
        "power off": "Powering off",
        "brake release": "Brake releasing",
        "play": "Failed to execute: play",
        "quit": "Disconnected",
        "shutdown": "Shutting down",
    }
    word = line.lower()
    if word in ("stop", "pause"):
        controller.stop_program("dashboard")
        return ("Stopped" if word == "stop" else "Pausing program"), False
    if word == "unlock protective stop":
        if controller.unlock():
            return "Protective stop releasing", False
        return (
            "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of "
            "protective stop before unlocking",
            False,
        )
    if word.startswith(("popup", "addtolog")):
        return ("showing popup" if word.startswith("popup") else "Added log message"), False
    return told.get(word, f"could not understand: '{line}'"), word in ("quit", "shutdown")
