"""Options of devices whose data comes to this computer: where it listens.

Public to authors of plugins.
"""

from __future__ import annotations

import ipaddress
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict

WANTED = "an address of this computer and a port, as 192.168.1.5:8765"


def _place(text: str) -> str:
    host, _, port = text.rpartition(":")
    try:
        ipaddress.ip_address(host.strip("[]"))
    except ValueError:
        if host != "localhost":
            raise ValueError(WANTED) from None
    if not port.isdecimal() or int(port) > 65535:
        raise ValueError(WANTED)
    return text


Place = Annotated[str, AfterValidator(_place)]


class Listening(BaseModel):
    """Options of a device that is listened for; each names its own default of `listen`."""

    model_config = ConfigDict(extra="forbid")

    listen: Place

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
        """Whether only this computer reaches it."""
        return self.host == "localhost" or ipaddress.ip_address(self.host).is_loopback
