"""Options of the route, as rigs write them."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from vrbench.devices.listening import Listening, Place


class Options(Listening):
    """How the headset's browser reaches the recorder."""

    listen: Place = Field(
        "127.0.0.1:8765",
        description="where the page is served; with the loopback address, the headset comes by"
        " `adb reverse`; port 0 takes a free one",
    )
    tls: bool | None = Field(
        None, description="HTTPS; where not said: yes, unless `listen` is the loopback address"
    )
    certificate: Path | None = Field(
        None, description="PEM file of a certificate; one is made and kept where not given"
    )
    key: Path | None = Field(None, description="PEM file of its key")
    token: str | None = Field(
        None,
        pattern=r"^[a-z0-9]{8,40}$",
        description="secret part of the address; drawn anew where not given. A fixed one lets a"
        " session on the headset outlive the recorder",
    )
    rate_hz: float | None = Field(
        None, gt=0, le=1000, description="frame rate to ask the headset for [Hz]"
    )
    wait_s: float = Field(
        300.0, ge=0, description="how long the first take waits for a session [s]"
    )
    quiet: bool = Field(False, description="print no address")

    @property
    def https(self) -> bool:
        """Whether the page is served by HTTPS: browsers give WebXR to nothing else from afar."""
        return not self.loopback if self.tls is None else self.tls
