"""An arm and what is around it: own URDF, pinocchio for dynamics, coal for distances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from vrbench.geometry import Bools, Floats, Ints, Transform, quat_to_matrix
from vrbench_ur.arms import JOINTS, POSITION, Arm, Dh
from vrbench_ur.options import Options

TABLE = "table"
# Parts this near along the chain always touch, or never can.
NEIGHBOURS = 1
# Nor can these meet: they turn about one another at a fixed distance.
NEVER = {
    ("base", "upper arm"),
    ("forearm", "wrist 2"),
    ("wrist 1", "wrist 3"),
    ("wrist 2", "rod"),
}


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A capsule on a link of the arm.

    Attributes:
        name: for messages.
        link: 0 for the base, 1..6 for the links, whose frame it is given in.
        a, b: the ends of its axis (3,) [m].
        radius: [m].
        part: place along the chain; shapes this near each other are not checked.
    """

    name: str
    link: int
    a: Floats
    b: Floats
    radius: float
    part: int


def step_matrix(dh: Dh, i: int) -> Floats:
    """The fixed part of a DH step: `Tz(d) Tx(a) Rx(alpha)`, (4, 4)."""
    c, s = np.cos(dh.alpha[i]), np.sin(dh.alpha[i])
    return np.array([[1, 0, 0, dh.a[i]], [0, c, -s, 0], [0, s, c, dh.d[i]], [0, 0, 0, 1.0]])


def arm_shapes(arm: Arm) -> list[Shape]:
    """The capsules guessed around the links, in the frames of their URDF links."""
    base, shoulder, upper, fore, wrist = arm.radii
    d, a = arm.dh.d, arm.dh.a

    def shape(
        name: str, link: int, ends: Sequence[Sequence[float]], radius: float, part: int
    ) -> Shape:
        return Shape(name, link, np.array(ends[0]), np.array(ends[1]), radius, part)

    lift, bend = arm.shoulder_offset, arm.elbow_offset
    return [
        shape("base", 0, ((0, 0, base), (0, 0, d[0] - 0.4 * base)), base, 0),
        shape("shoulder", 1, ((0, 0, d[0]), (0, -0.6 * lift, d[0])), shoulder, 1),
        shape("upper arm", 2, ((0, 0, lift), (a[1], 0, lift)), upper, 2),
        shape("forearm", 3, ((0, 0, bend), (a[2], 0, bend)), fore, 3),
        shape("wrist 1", 4, ((0, 0, 0.4 * d[3]), (0, 0, d[3])), wrist, 4),
        shape("wrist 2", 5, ((0, 0, 0), (0, 0, d[4])), wrist, 5),
        shape("wrist 3", 6, ((0, 0, 0.3 * d[5]), (0, 0, d[5] - 0.5 * wrist)), wrist, 6),
    ]


def carried_shapes(arm: Arm, options: Options) -> list[Shape]:
    """Rod, head and headset, fixed to the TCP, in the frame of the last URDF link."""
    workspace = options.workspace
    to_link = Transform.from_matrix(step_matrix(arm.dh, 5)) @ options.flange_tcp
    shapes = []
    for name, part in (("rod", 7), ("head", 8), ("headset", 8)):
        capsule = getattr(workspace, name)
        a, b = (to_link.apply(np.array(end)) for end in (capsule.a_m, capsule.b_m))
        shapes.append(Shape(name, 6, a, b, capsule.radius_m, part))
    return shapes


def urdf(arm: Arm, dh: Dh, shapes: Sequence[Shape]) -> str:
    """The arm as URDF text; link i is the DH frame i - 1 turned by joint i."""
    lines = [f'<robot name="{arm.name}">', _link("base", 0, None, shapes)]
    origin = np.eye(4)
    for i, joint in enumerate(JOINTS):
        turned = np.eye(4)
        c, s = np.cos(dh.theta[i]), np.sin(dh.theta[i])
        turned[:2, :2] = [[c, -s], [s, c]]
        parent = "base" if i == 0 else f"{JOINTS[i - 1]}_link"
        lines += [
            _link(f"{joint}_link", i + 1, _inertia(arm, dh, i), shapes),
            f'<joint name="{joint}" type="revolute"><parent link="{parent}"/>'
            f'<child link="{joint}_link"/>{_origin(origin @ turned)}<axis xyz="0 0 1"/>'
            f'<limit lower="{-float(POSITION[i])!r}" upper="{float(POSITION[i])!r}" '
            f'effort="{float(arm.torque[i])!r}" velocity="{float(arm.speed[i])!r}"/></joint>',
        ]
        origin = step_matrix(dh, i)
    lines += [
        '<link name="flange"/>',
        f'<joint name="tool_mount" type="fixed"><parent link="{JOINTS[5]}_link"/>'
        f'<child link="flange"/>{_origin(origin)}</joint>',
        "</robot>",
    ]
    return "\n".join(lines) + "\n"


def _origin(m: Floats) -> str:
    """An origin element; roll, pitch, yaw of the rotation."""
    roll, pitch = np.arctan2(m[2, 1], m[2, 2]), np.arcsin(np.clip(-m[2, 0], -1, 1))
    yaw = np.arctan2(m[1, 0], m[0, 0])
    xyz = " ".join(repr(float(x)) for x in m[:3, 3])
    return f'<origin xyz="{xyz}" rpy="{float(roll)!r} {float(pitch)!r} {float(yaw)!r}"/>'


def _inertia(arm: Arm, dh: Dh, i: int) -> str:
    """The inertial element of link i: mass properties are published in the DH frame's axes."""
    link, m = arm.links[i], step_matrix(dh, i)
    at = np.eye(4)
    at[:3, :3], at[:3, 3] = m[:3, :3], m[:3, :3] @ np.array(link.centre) + m[:3, 3]
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    tensor = " ".join(f'{n}="{float(v)!r}"' for n, v in zip(names, link.inertia, strict=True))
    return f'<inertial>{_origin(at)}<mass value="{link.mass!r}"/><inertia {tensor}/></inertial>'


def _link(name: str, link: int, inertia: str | None, shapes: Sequence[Shape]) -> str:
    """A link element; URDF has no capsule, so each is a cylinder and two spheres."""
    parts = []
    for shape in shapes:
        if shape.link != link:
            continue
        at, length = _capsule_frame(shape)
        parts.append(
            f"<collision>{_origin(at)}<geometry>"
            f'<cylinder radius="{shape.radius!r}" length="{length!r}"/></geometry></collision>'
        )
        for end in (shape.a, shape.b):
            xyz = " ".join(repr(float(x)) for x in end)
            parts.append(
                f'<collision><origin xyz="{xyz}" rpy="0 0 0"/><geometry>'
                f'<sphere radius="{shape.radius!r}"/></geometry></collision>'
            )
    return f'<link name="{name}">{inertia or ""}{"".join(parts)}</link>'


def _capsule_frame(shape: Shape) -> tuple[Floats, float]:
    """Where a capsule's middle is (4, 4), its axis along z, and its axis' length [m]."""
    axis = shape.b - shape.a
    length = float(np.linalg.norm(axis))
    z = axis / length if length > 0 else np.array([0.0, 0.0, 1.0])
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    m = np.eye(4)
    m[:3, :3] = np.column_stack((x, np.cross(z, x), z))
    m[:3, 3] = (shape.a + shape.b) / 2
    return m, length


class Cell:
    """Dynamics and distances of one arm in its surroundings.

    Attributes:
        arm: the arm.
        shapes: its capsules, and those it carries.
        pairs: names of the two shapes of every pair that is checked.
        model: pinocchio's model, payload included.
    """

    def __init__(self, arm: Arm, options: Options, dh: Dh | None = None) -> None:
        self.arm, self._options = arm, options
        self.dh = dh or arm.dh
        self.shapes = arm_shapes(arm) + carried_shapes(arm, options)
        self.urdf = urdf(arm, self.dh, self.shapes)
        self.model: Any = pin.buildModelFromXML(self.urdf)
        payload = options.payload
        at = Transform.from_matrix(step_matrix(self.dh, 5)).apply(np.array(payload.cog_m))
        self.model.appendBodyToJoint(
            6, pin.Inertia(payload.kg, at, np.zeros((3, 3))), pin.SE3.Identity()
        )
        self._data: Any = self.model.createData()
        self._geometry: Any = pin.GeometryModel()
        self._add_shapes()
        self._distances: Any = self._geometry.createData()
        self._contacts: Any = self._geometry.createData()
        for request in self._contacts.collisionRequests:
            request.security_margin = options.workspace.clearance_m
        self.pairs = [
            tuple(self._geometry.geometryObjects[i].name for i in (pair.first, pair.second))
            for pair in self._geometry.collisionPairs
        ]

    def _add_shapes(self) -> None:
        geometry, workspace = self._geometry, self._options.workspace
        fixed: list[tuple[str, Any, Any]] = []
        if workspace.table_m is not None:
            plane = coal.Halfspace(np.array([0.0, 0.0, 1.0]), workspace.table_m)
            fixed.append((TABLE, plane, pin.SE3.Identity()))
        for box in workspace.boxes:
            half = np.radians(box.yaw_deg) / 2
            turn = quat_to_matrix(np.array([0.0, 0.0, np.sin(half), np.cos(half)]))
            fixed.append((box.name, coal.Box(*box.size_m), pin.SE3(turn, np.array(box.centre_m))))
        arm_ids = []
        for shape in self.shapes:
            at, length = _capsule_frame(shape)
            capsule = coal.Capsule(shape.radius, length)
            where = pin.SE3(at[:3, :3], at[:3, 3])
            arm_ids.append(
                geometry.addGeometryObject(
                    pin.GeometryObject(shape.name, shape.link, where, capsule)
                )
            )
        for (i, first), (j, second) in (
            (x, y)
            for x in zip(arm_ids, self.shapes, strict=True)
            for y in zip(arm_ids, self.shapes, strict=True)
            if y[1].part - x[1].part > NEIGHBOURS and y[1].link > x[1].link
        ):
            if (first.name, second.name) not in NEVER:
                geometry.addCollisionPair(pin.CollisionPair(i, j))
        for name, body, where in fixed:
            k = geometry.addGeometryObject(pin.GeometryObject(name, 0, where, body))
            for i, shape in zip(arm_ids, self.shapes, strict=True):
                if shape.link > 1 or (shape.link == 1 and name != TABLE):
                    geometry.addCollisionPair(pin.CollisionPair(i, k))

    def collides(self, q: Floats) -> Bools:
        """Whether any pair comes nearer than the clearance, at joint angles (n, 6)."""
        found = np.zeros(len(q), dtype=bool)
        model, data, geometry, contacts = self.model, self._data, self._geometry, self._contacts
        for k, angles in enumerate(q):
            pin.updateGeometryPlacements(model, data, geometry, contacts, angles)
            found[k] = pin.computeCollisions(geometry, contacts, True)
        return found

    def clearance(self, q: Floats) -> tuple[Floats, Ints]:
        """Least distances (n,) [m] at joint angles (n, 6), and which pair (n,) has them."""
        least, which = np.empty(len(q)), np.empty(len(q), dtype=np.int64)
        model, data, geometry, near = self.model, self._data, self._geometry, self._distances
        for k, angles in enumerate(q):
            pin.updateGeometryPlacements(model, data, geometry, near, angles)
            nearest = pin.computeDistances(geometry, near)
            which[k], least[k] = nearest, near.distanceResults[nearest].min_distance
        return least, which

    def torque(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Joint torques (n, 6) [Nm] that the motion takes, payload included."""
        model, data = self.model, self._data
        return np.array([pin.rnea(model, data, *row) for row in zip(q, qd, qdd, strict=True)])

    def flange(self, q: Floats) -> Floats:
        """`T_base_flange` (4, 4) of one posture (6,), by pinocchio."""
        pin.framesForwardKinematics(self.model, self._data, q)
        return np.array(self._data.oMf[self.model.getFrameId("flange")].homogeneous)
