"""What a rig says of its Motive."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from vrbench_optitrack.axes import Up
from vrbench_optitrack.wire import COMMAND_PORT, Version


class Options(BaseModel):
    """Options of `mocap: {plugin: optitrack, options: ...}`."""

    model_config = ConfigDict(extra="forbid")

    body: str = Field(min_length=1, description="the rigid body's name in Motive")
    server: str | None = Field(None, description="Motive's address; searched for where not given")
    interface: str | None = Field(
        None, description="address of the network card here that leads to Motive"
    )
    connection: Literal["auto", "unicast", "multicast"] = Field(
        "auto", description="as Motive's streaming settings have it; auto asks Motive"
    )
    up: Up = Field("y", description="Up Axis of Motive's streaming settings")
    command_port: int = Field(
        COMMAND_PORT, ge=1, le=65535, description="UDP port of Motive's commands"
    )
    data_port: int | None = Field(None, ge=1, le=65535, description="where Motive doesn't say it")
    group: str | None = Field(None, description="multicast address, where Motive doesn't say it")
    bitstream: str | None = Field(
        None, pattern=r"^[34]\.\d$", description="version of NatNet to ask for (Motive 3, unicast)"
    )
    echo_hz: float = Field(8.0, ge=2.0, le=10.0, description="clock requests a second")
    silence_s: float = Field(5.0, gt=0.0, description="a server silent for so long has failed [s]")

    @property
    def wanted(self) -> Version | None:
        """`bitstream` as a version."""
        if self.bitstream is None:
            return None
        major, minor = self.bitstream.split(".")
        return int(major), int(minor)
