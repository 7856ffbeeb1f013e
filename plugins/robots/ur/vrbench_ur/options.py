"""What a rig says of its arm: address, payload, surroundings, limits, and where motions start."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, field_validator

from vrbench.geometry import Floats, Transform, rotvec_to_quat

Vector = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
Pose6 = tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat]
Length = Annotated[float, Field(gt=0.0, le=5.0)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Payload(_Strict):
    """What the flange carries: mount, head and headset together."""

    kg: float = Field(1.9, ge=0.0, le=20.0, description="mass [kg]")
    cog_m: Vector = Field((0.0, 0.05, 0.2), description="centre of mass from the flange [m]")


class Capsule(_Strict):
    """A cylinder with round ends, fixed to the TCP."""

    a_m: Vector = Field(description="one end of the axis, from the TCP [m]")
    b_m: Vector = Field(description="the other end [m]")
    radius_m: Length = Field(description="[m]")


class Box(_Strict):
    """Something that stands about: in base, turned about base z alone."""

    name: str
    centre_m: Vector
    size_m: tuple[Length, Length, Length]
    yaw_deg: FiniteFloat = 0.0


class Workspace(_Strict):
    """What the arm must not touch. The default sizes of rod, head and headset are guesses."""

    table_m: FiniteFloat | None = Field(
        -0.005, description="height of the table's top in base, None for no table [m]"
    )
    clearance_m: float = Field(0.02, ge=0.0, le=0.5, description="least distance kept [m]")
    rod: Capsule = Capsule(a_m=(0, 0, 0.02), b_m=(0, 0, 0.10), radius_m=0.03)
    head: Capsule = Capsule(a_m=(0, 0, 0.20), b_m=(0, 0.02, 0.28), radius_m=0.095)
    headset: Capsule = Capsule(a_m=(-0.05, 0.11, 0.276), b_m=(0.05, 0.11, 0.276), radius_m=0.065)
    boxes: tuple[Box, ...] = ()
    front_deg: FiniteFloat = Field(0.0, description="where motions start, about base z from +x")
    tcp_min_m: Vector | None = Field(None, description="lowest x, y, z the TCP may have [m]")
    tcp_max_m: Vector | None = Field(None, description="highest x, y, z the TCP may have [m]")


class Limits(_Strict):
    """How much of what the arm can do a plan may use."""

    speed_percent: float = Field(97.0, gt=0.0, le=100.0, description="of each joint's speed")
    torque_percent: float = Field(90.0, gt=0.0, le=100.0, description="of each joint's torque")
    # chosen here: the maker publishes none, and what the joints bear is checked as torque
    acceleration: float = Field(30.0, gt=0.0, le=40.0, description="of every joint [rad/s2]")
    margin_deg: float = Field(3.0, ge=0.0, le=90.0, description="kept from the ends of joints")
    wrist_deg: float = Field(5.0, ge=0.0, le=45.0, description="kept from the wrist singularity")
    elbow_deg: float = Field(8.0, ge=0.0, le=90.0, description="kept from a straight elbow")
    shoulder_m: float = Field(0.02, ge=0.0, le=0.5, description="kept from above the base [m]")
    step_mm: float = Field(1.0, gt=0.0, le=20.0, description="deviation smoothing may cause")


class Start(_Strict):
    """Where the eye is when a motion starts; it looks along +y of base turned by the yaw."""

    p_m: Vector = Field(description="in base [m]")
    yaw_deg: FiniteFloat = Field(description="about base z")


class Options(_Strict):
    """Options of ur3e, ur5e and ur10e."""

    host: str = Field("127.0.0.1", min_length=1, max_length=253, description="address")
    tcp: Pose6 = Field((0, 0, 0, 0, 0, 0), description="of the TCP from the flange: m, rotvec rad")
    payload: Payload = Field(Payload(), description="what the flange carries")
    workspace: Workspace = Field(Workspace(), description="what stands around the arm")
    limits: Limits = Field(Limits(), description="how fast it may move")
    start: Start | None = Field(None, description="fixed start; searched for where it is absent")
    stretch: float = Field(1.0, ge=1.0, le=10.0, description="duration over the motion's own")
    calibration: Path | None = Field(None, description="the controller's calibration.conf")
    rate_hz: float = Field(500.0, ge=10.0, le=500.0, description="of logged poses [Hz]")
    lookahead_s: float = Field(0.03, ge=0.03, le=0.2, description="of servoJ [s]")
    gain: float = Field(600.0, ge=100.0, le=2000.0, description="of servoJ")
    watchdog_hz: float = Field(
        10.0, ge=0.2, le=125.0, description="commands a second below which the controller stops"
    )
    stale_s: float = Field(
        0.25, gt=0.0, le=10.0, description="how long the controller's time may stand still [s]"
    )
    behind_s: float = Field(
        0.5, gt=0.0, le=60.0, description="how far a replay on a busy computer may fall behind [s]"
    )
    first_pass_percent: float = Field(
        25.0, gt=0.0, le=100.0, description="speed of a plan's first pass; 100 for none"
    )
    timeout_s: float = Field(2.0, gt=0.0, le=10.0, description="for a connection's answers [s]")
    max_error_deg: float = Field(
        4.0, gt=0.0, le=30.0, description="a joint's distance to its command that aborts"
    )
    tolerance_deg: float = Field(
        0.2, gt=0.0, le=5.0, description="measured joints against the plan's start"
    )

    @field_validator("host")
    @classmethod
    def _one_word(cls, host: str) -> str:
        if any(c.isspace() or not c.isprintable() for c in host):
            raise ValueError("a host name or address")
        return host

    @property
    def flange_tcp(self) -> Transform:
        """`T_flange_tcp`."""
        pose = np.array(self.tcp, dtype=np.float64)
        return Transform(pose[:3], rotvec_to_quat(pose[3:]))


def box_limits(workspace: Workspace) -> tuple[Floats, Floats]:
    """Lowest and highest position of the TCP (3,) [m]; infinite where none is set."""
    low = workspace.tcp_min_m or (-np.inf,) * 3
    high = workspace.tcp_max_m or (np.inf,) * 3
    return np.array(low), np.array(high)
