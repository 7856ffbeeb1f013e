"""Options of the route, as rigs write them."""

from __future__ import annotations

import ipaddress
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field


def _place(text: str) -> str:
    host, _, port = text.rpartition(":")
    try:
        ipaddress.ip_address(host.strip("[]"))
    except ValueError:
        if host != "localhost":
            raise ValueError("an address of this PC and a port, as 192.168.1.5:8765") from None
    if not port.isdigit() or int(port) > 65535:
        raise ValueError("an address of this PC and a port, as 192.168.1.5:8765")
    return text


class Options(BaseModel):
    """How the headset's browser reaches the recorder."""

    model_config = ConfigDict(extra="forbid")

    listen: Annotated[str, AfterValidator(_place)] = Field(
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
        300.0, ge=0, description="how long to wait for a session on the headset [s]"
    )
    quiet: bool = Field(False, description="print no address")

    @property
    def host(self) -> str:
        """The address to listen at."""
        return self.listen.rpartition(":")[0].strip("[]")

    @property
    def port(self) -> int:
        """The port to listen at; 0 is any free one."""
        return int(self.listen.rpartition(":")[2])

    @property
    def loopback(self) -> bool:
        """Whether only this PC reaches it."""
        return self.host == "localhost" or ipaddress.ip_address(self.host).is_loopback

    @property
    def https(self) -> bool:
        """Whether the page is served by HTTPS: browsers give WebXR to nothing else from afar."""
        return not self.loopback if self.tls is None else self.tls
