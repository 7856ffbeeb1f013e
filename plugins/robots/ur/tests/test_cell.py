import numpy as np
import pinocchio as pin
import pytest
from vrbench_ur.arms import ARMS, UR5E
from vrbench_ur.cell import Cell
from vrbench_ur.kinematics import link_frames
from vrbench_ur.options import Box, Options, Workspace
from vrbench_ur.testing import options

RNG = np.random.default_rng(2)
Q = RNG.uniform(-3, 3, (200, 6))


@pytest.fixture(scope="module")
def cell():
    return Cell(UR5E, options())


@pytest.mark.parametrize("robot", ARMS.values(), ids=list(ARMS))
def test_pinocchio_agrees_with_the_published_kinematics(robot):
    made = Cell(robot, options(payload={"kg": 1.0}))
    want = link_frames(Q, robot.dh)[:, 6]
    got = np.array([made.flange(q) for q in Q])
    np.testing.assert_allclose(got, want, atol=1e-12)


@pytest.mark.parametrize("robot", ARMS.values(), ids=list(ARMS))
def test_the_model_weighs_what_the_maker_says(robot):
    made = Cell(robot, options(payload={"kg": 1.5}))
    want = sum(link.mass for link in robot.links) + 1.5
    assert pin.computeTotalMass(made.model) == pytest.approx(want, abs=1e-12)


def test_the_urdf_stands_on_its_own(cell):
    model = pin.buildModelFromXML(cell.urdf)
    assert model.nq == 6
    geometry = pin.buildGeomFromUrdfString(model, cell.urdf, pin.GeometryType.COLLISION)
    assert geometry.ngeoms == 3 * len(cell.shapes)


def segment_distance(a0, a1, b0, b1):
    """Least distance of two segments, by brute force and refinement."""
    lo, hi = np.zeros(2), np.ones(2)
    for _ in range(6):
        s, t = (np.linspace(lo[i], hi[i], 21) for i in range(2))
        p = a0 + s[:, None] * (a1 - a0)
        q = b0 + t[:, None] * (b1 - b0)
        d = np.linalg.norm(p[:, None] - q[None], axis=2)
        i, j = np.unravel_index(np.argmin(d), d.shape)
        width = (hi - lo) / 20
        lo = np.clip([s[i] - width[0], t[j] - width[1]], 0, 1)
        hi = np.clip([s[i] + width[0], t[j] + width[1]], 0, 1)
    return d.min()


def test_distances_are_those_of_capsules(cell):
    """An independent distance: the frames of DH, and segments searched by brute force."""
    named = {shape.name: shape for shape in cell.shapes}
    for q in Q[:12]:
        frames = link_frames(q, UR5E.dh)
        least = np.inf
        ends = {}
        for name, shape in named.items():
            m = np.eye(4)
            if shape.link:
                c, s = np.cos(q[shape.link - 1]), np.sin(q[shape.link - 1])
                m = frames[shape.link - 1] @ np.array(
                    [[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
                )
            ends[name] = [m[:3, :3] @ end + m[:3, 3] for end in (shape.a, shape.b)]
        for a, b in cell.pairs:
            if b == "table":
                low = min(end[2] for end in ends[a]) + 0.005
                distance = low - named[a].radius
            else:
                distance = segment_distance(*ends[a], *ends[b])
                distance -= named[a].radius + named[b].radius
            least = min(least, distance)
        got = cell.clearance(q[None])[0][0]
        # what overlaps is only known to overlap
        assert got == pytest.approx(least, abs=2e-4) if least > 0 else got <= 0


def test_nearer_than_the_clearance_counts_as_a_collision(cell):
    distance, _ = cell.clearance(Q)
    assert np.array_equal(cell.collides(Q), distance < 0.02)


def test_gravity_alone_loads_the_shoulder_as_levers_say():
    bare = Cell(UR5E, options(payload={"kg": 0.0}))
    loaded = Cell(UR5E, options(payload={"kg": 2.0, "cog_m": (0, 0, 0)}))
    q, rest = np.zeros((1, 6)), np.zeros((1, 6))
    extra = loaded.torque(q, rest, rest) - bare.torque(q, rest, rest)
    # the flange of the stretched arm is .8172 m from the shoulder's axis
    assert abs(extra[0, 1]) == pytest.approx(2.0 * 9.81 * 0.8172, rel=1e-6)


def test_boxes_of_the_rig_are_in_the_way():
    box = Box(name="cupboard", centre_m=(-0.6, 0.0, 0.4), size_m=(0.3, 0.3, 0.8), yaw_deg=20)
    crowded = Cell(UR5E, options(workspace=Workspace(boxes=(box,))))
    q = np.array([[0.0, -0.9, 1.2, -0.3, -1.57, 0.0]])
    distance, pair = crowded.clearance(q)
    assert distance[0] < 0
    assert "cupboard" in crowded.pairs[pair[0]]


def test_options_refuse_what_is_no_host():
    with pytest.raises(ValueError, match="host name"):
        Options(host="a b")
