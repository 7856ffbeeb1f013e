"""What the maker publishes of each arm, and the capsules vrbench guesses around its links.

Kinematics and dynamics: Universal Robots, "DH parameters for calculations of kinematics and
dynamics"; inertia tensors and offsets as in the maker's own robot description. Torques: by joint
size, "Max. joint torques". Radii are guesses from photographs, some 10 mm generous.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vrbench.errors import ConfigError
from vrbench.geometry import Floats

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
HALF = np.pi / 2


@dataclass(frozen=True, slots=True, eq=False)
class Dh:
    """Denavit-Hartenberg parameters: `T_i = Rz(q_i + theta_i) Tz(d_i) Tx(a_i) Rx(alpha_i)`.

    Attributes:
        d: along the joint axes (6,) [m].
        a: along the common normals (6,) [m].
        alpha: twists (6,) [rad].
        theta: offsets of the joint angles (6,) [rad]; zero but for a calibrated arm.
    """

    d: Floats
    a: Floats
    alpha: Floats
    theta: Floats

    @classmethod
    def of(cls, d: tuple[float, ...], a: tuple[float, ...]) -> Dh:
        """The nominal arm with these lengths."""
        alpha = np.array([HALF, 0.0, 0.0, HALF, -HALF, 0.0])
        return cls(np.array(d), np.array(a), alpha, np.zeros(6))


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """A link's mass properties, in its own DH frame.

    Attributes:
        mass: [kg].
        centre: of mass (3,) [m].
        inertia: about the centre: xx, xy, xz, yy, yz, zz [kg m2].
    """

    mass: float
    centre: tuple[float, float, float]
    inertia: tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Arm:
    """An arm.

    Attributes:
        name: what rigs call it.
        title: what people call it.
        model: what its dashboard calls it.
        dh: nominal parameters.
        links: mass properties, base to flange (6).
        speed: limits of the joint speeds (6,) [rad/s].
        torque: limits of the joint torques (6,) [Nm].
        payload_kg: the most it may carry.
        shoulder_offset, elbow_offset: of upper arm and forearm along their axes [m].
        radii: of base, shoulder, upper arm, forearm and wrists [m].
    """

    name: str
    title: str
    model: str
    dh: Dh
    links: tuple[Link, ...]
    speed: Floats
    torque: Floats
    payload_kg: float
    shoulder_offset: float
    elbow_offset: float
    radii: tuple[float, float, float, float, float]

    @property
    def reach(self) -> float:
        """How far the wrist centre can be from the shoulder [m]."""
        return float(-self.dh.a[1] - self.dh.a[2])


# What planning allows: the elbow folds either way, the others turn twice.
POSITION = np.array([2.0, 2.0, 1.0, 2.0, 2.0, 2.0]) * np.pi

UR3E = Arm(
    name="ur3e",
    title="Universal Robots UR3e",
    model="UR3",
    dh=Dh.of((0.15185, 0, 0, 0.13105, 0.08535, 0.0921), (0, -0.24355, -0.2132, 0, 0, 0)),
    links=(
        Link(1.98, (0, -0.02, 0), (27657e-7, 96e-7, -149e-7, 21501e-7, 1873e-7, 25626e-7)),
        Link(
            3.4445, (0.13, 0, 0.1157), (42623e-7, -409e-7, -1496e-6, 460284e-7, -129e-7, 0.0448947)
        ),
        Link(1.437, (0.05, 0, 0.0238), (10511e-7, 0, -331e-7, 113396e-7, 22e-7, 110895e-7)),
        Link(0.871, (0, 0, 0.01), (8174e-7, -5e-7, 21e-7, 6844e-7, 617e-7, 5497e-7)),
        Link(0.805, (0, 0, 0.01), (6059e-7, -6e-7, -6e-7, 5837e-7, -271e-7, 3831e-7)),
        Link(0.261, (0, 0, -0.02), (1080e-7, -1e-7, -1e-7, 1086e-7, -2e-7, 1371e-7)),
    ),
    speed=np.radians([180.0, 180, 180, 360, 360, 360]),
    torque=np.array([56.0, 56, 28, 12, 12, 12]),
    payload_kg=3.0,
    shoulder_offset=0.120,
    elbow_offset=0.027,
    radii=(0.066, 0.060, 0.048, 0.042, 0.036),
)
UR5E = Arm(
    name="ur5e",
    title="Universal Robots UR5e",
    model="UR5",
    dh=Dh.of((0.1625, 0, 0, 0.1333, 0.0997, 0.0996), (0, -0.425, -0.3922, 0, 0, 0)),
    links=(
        Link(
            3.761,
            (0, -0.02561, 0.00193),
            (0.00700210, 7.3e-7, -1.053e-5, 0.00648091, 4.9994e-4, 0.00657286),
        ),
        Link(
            8.058,
            (0.2125, 0, 0.11336),
            (0.01505885, -5.4e-5, 5.63e-6, 0.33388086, -1.81e-6, 0.33247207),
        ),
        Link(
            2.846,
            (0.15, 0, 0.0265),
            (0.00399632, -1.365e-5, 1.37272e-3, 0.07879254, -6.6e-6, 0.07848510),
        ),
        Link(
            1.37,
            (0, -0.0018, 0.01634),
            (0.00165491, -2.82e-6, -4.38e-6, 0.00135962, 1.0157e-4, 0.00126279),
        ),
        Link(
            1.3,
            (0, 0.0018, 0.01634),
            (0.00135617, -2.74e-6, 4.44e-6, 0.00127827, -5.048e-5, 0.00096614),
        ),
        Link(
            0.365,
            (0, 0, -0.001159),
            (0.00018694, 6e-8, -1.7e-7, 0.00018908, -9.2e-7, 0.00025756),
        ),
    ),
    speed=np.radians([180.0] * 6),
    torque=np.array([150.0, 150, 150, 28, 28, 28]),
    payload_kg=5.0,
    shoulder_offset=0.138,
    elbow_offset=0.007,
    radii=(0.078, 0.072, 0.060, 0.052, 0.044),
)
UR10E = Arm(
    name="ur10e",
    title="Universal Robots UR10e",
    model="UR10",
    dh=Dh.of((0.1807, 0, 0, 0.17415, 0.11985, 0.11655), (0, -0.6127, -0.57155, 0, 0, 0)),
    links=(
        Link(7.369, (0.021, 0, 0.027), (0.03408, 2e-5, -0.00425, 0.03529, 8e-5, 0.02156)),
        Link(13.051, (0.38, 0, 0.158), (0.02814, 5e-5, -0.01561, 0.77068, 2e-5, 0.76943)),
        Link(3.989, (0.24, 0, 0.068), (0.01014, 8e-5, 0.00916, 0.30928, 0, 0.30646)),
        Link(2.1, (0, 0.007, 0.018), (0.00296, -1e-5, 0, 0.00222, -0.00024, 0.00258)),
        Link(1.98, (0, 0.007, 0.018), (0.00296, -1e-5, 0, 0.00222, -0.00024, 0.00258)),
        Link(0.615, (0, 0, -0.026), (0.0004, 0, 0, 0.00041, 0, 0.00034)),
    ),
    speed=np.radians([120.0, 120, 180, 180, 180, 180]),
    torque=np.array([330.0, 330, 150, 56, 56, 56]),
    payload_kg=12.5,
    shoulder_offset=0.1762,
    elbow_offset=0.0393,
    radii=(0.100, 0.095, 0.078, 0.064, 0.056),
)
ARMS: Mapping[str, Arm] = {arm.name: arm for arm in (UR3E, UR5E, UR10E)}


def arm(name: str) -> Arm:
    """The arm of this name.

    Raises:
        ConfigError: there is none.
    """
    if name not in ARMS:
        raise ConfigError(f"no arm is called {name!r}", fix=f"there are {', '.join(ARMS)}")
    return ARMS[name]
