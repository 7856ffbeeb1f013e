import numpy as np
import pytest

from vrbench.errors import ConfigError, DataError
from vrbench.geometry import Transform, relative_angle, rotvec_to_quat
from vrbench.motion.files import Header, given, has_header, read_motion, resampled, write_motion
from vrbench.motion.generators import generate
from vrbench.trajectory import NS, Trajectory, read_tum

HEAD = """# motion: seated-shooter
# version: 2
# up: y
# rate_hz: 100.0
# source: captured
# game: Example
# posture: seated
# licence: CC-BY-4.0
# consent: written, for publication
"""
ROWS = "0.0 0 0 0 0 0 0 1\n0.01 0 0.001 0 0 0 0 1\n0.02 0 0.003 0 0 0 0 1\n"
S = np.arange(0, 2, 0.01)
MOVED = Trajectory(
    5 * NS + np.rint(S * NS).astype(np.int64),
    Transform(
        np.stack((S, np.sin(S), 0.1 * S), axis=1),
        rotvec_to_quat(np.stack((0.1 * S, 0.2 * S, 0.3 + 0 * S), axis=1)),
    ),
)


def header(**more):
    fields = {"motion": "seated-shooter", "version": 2, "up": "y", "rate_hz": 100.0}
    fields |= {"source": "captured", "licence": "CC-BY-4.0", "consent": "written"}
    return Header(**(fields | more))


@pytest.fixture
def read(tmp_path):
    def read_text(text):
        path = tmp_path / "head.tum"
        path.write_text(text)
        return read_motion(path)

    return read_text


def test_a_motion_comes_back_as_it_was_written(tmp_path):
    path = tmp_path / "head.tum"
    written = write_motion(path, header(), MOVED)
    assert written.name == "seated-shooter-2"
    assert written.digest == read_motion(path).digest
    want = MOVED.pose[0].inverse() @ MOVED.pose
    np.testing.assert_allclose(written.trajectory.pose.p, want.p, atol=1e-12)
    assert relative_angle(written.trajectory.pose.q, want.q).max() < 1e-7
    assert written.trajectory.t[0] == 0
    # any program that reads TUM reads it
    assert len(read_tum(path)) == len(MOVED)
    with pytest.raises(ConfigError, match="is there already"):
        write_motion(path, header(), MOVED)


def test_a_motion_that_is_refused_leaves_no_file(tmp_path):
    path = tmp_path / "made" / "head.tum"
    far = np.where(S < 1.0, 0.0, 0.5)[:, None] * [1.0, 0.0, 0.0]
    leaping = Trajectory(MOVED.t, Transform(MOVED.pose.p + far, MOVED.pose.q))
    for refused, says in ((leaping, "leaps at"), (MOVED[np.r_[0:50, 80:200]], "has no rows")):
        with pytest.raises(DataError, match=rf"head\.tum: {says}"):
            write_motion(path, header(), refused)
        assert not path.parent.exists()
    # the same name is free for the next try, and the folder is made
    assert write_motion(path, header(), MOVED).digest == read_motion(path).digest
    assert [found.name for found in path.parent.iterdir()] == ["head.tum"]


def test_the_digest_is_of_name_version_and_movement_and_of_nothing_else(tmp_path):
    def digest(n, trajectory=MOVED, **more):
        return write_motion(tmp_path / f"{n}.tum", header(**more), trajectory).digest

    first = digest(1)
    assert digest(2, game="Another", licence="CC0", source="captured twice") == first
    assert digest(3, version=3) != first
    moved = Transform(MOVED.pose.p * 1.001, MOVED.pose.q)
    assert digest(4, Trajectory(MOVED.t, moved)) != first


def test_a_generated_motion_needs_no_consent_and_keeps_its_digest(tmp_path):
    made = generate("saturate-30s-1")
    fields = {"motion": "saturate-30s", "version": 1, "up": "y", "rate_hz": 120.0}
    head = Header(**fields, source="generated")
    assert write_motion(tmp_path / "s.tum", head, made.trajectory).digest == made.digest


def test_z_up_is_turned_to_y_up(read):
    rows = ROWS.replace("0 0.001 0", "0 0 0.001").replace("0 0.003 0", "0 0 0.003")
    motion = read((HEAD + rows).replace("up: y", "up: z"))
    np.testing.assert_allclose(motion.trajectory.pose.p[:, 1], [0, 0.001, 0.003])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda s: s.replace("# licence: CC-BY-4.0\n", ""), "a person's motion needs licence"),
        (lambda s: s.replace("written, for publication", "unknown"), "needs consent"),
        (lambda s: s.replace("version: 2", "version: two"), "version: Input should be a valid int"),
        (lambda s: s.replace("# game", "# title"), "title: Extra inputs .*fields are motion"),
        (lambda s: s.replace("up: y", "up: x"), "up: Input should be 'y' or 'z'"),
        (lambda s: s.replace("# ", "# {", 1), "its header is not YAML"),
        (lambda s: s[s.index("0.0") :], "has no header"),
        (lambda s: s.replace("0.0 0 0 0", "0.0 0.1 0 0"), "first pose isn't the identity"),
        (lambda s: s.replace("\n0.0 ", "\n-0.01 "), "don't begin at 0 s"),
        (lambda s: s.replace("100.0", "120.0"), "rows have 100 Hz, its header says 120"),
        (lambda s: s + "0.03 0 0\n", "is not TUM text"),
    ],
)
def test_what_is_wrong_is_named(read, change, says):
    with pytest.raises((ConfigError, DataError), match=rf"(?s)head\.tum: .*{says}"):
        read(change(HEAD + ROWS))


def test_a_plain_tum_file_is_no_motion_file(tmp_path):
    for text, is_one in (
        (HEAD + ROWS, True),
        ("# timestamp tx ty tz\n" + ROWS, False),
        ("", False),
    ):
        path = tmp_path / "head.tum"
        path.write_text(text)
        assert has_header(path) == is_one
    assert not has_header(tmp_path / "none.tum")


def test_words_that_say_nothing_are_no_licence():
    assert given("CC-BY-4.0")
    assert not any(map(given, (None, "", " ", "none", "Unknown", "TBD")))


def test_resampling_keeps_the_movement_and_refuses_gaps():
    even = resampled(MOVED, 72.0, max_gap_s=0.05)
    assert np.diff(even.t).mean() == pytest.approx(NS / 72.0)
    np.testing.assert_allclose(even.pose.p[:, 0], (even.t - MOVED.t[0]) / NS, atol=1e-9)
    gap = MOVED[np.r_[0:50, 80:200]]
    with pytest.raises(DataError, match=r"1 gaps, the first of 0\.31 s after 0\.49 s"):
        resampled(gap, 72.0, max_gap_s=0.05)


# other frames and units


def scaled(path, *, metres: float = 1.0, seconds: float = 1.0, w_first: bool = False):
    """A motion file whose numbers are in other units."""
    from vrbench.trajectory import read_tum

    made = generate("saturate-30s-1")
    header = Header(motion="odd", version=1, up="y", rate_hz=120.0, source="generated")
    write_motion(path, header, made.trajectory)
    head = [line for line in path.read_text().splitlines() if line.startswith("#")]
    rows = read_tum(path)
    lines = []
    for t, p, q in zip(rows.t / 1e9 * seconds, rows.pose.p * metres, rows.pose.q, strict=True):
        lines.append(" ".join(map(str, (t, *p, *((q[3], *q[:3]) if w_first else q)))))
    path.write_text("\n".join([*head, *lines]) + "\n")
    return path


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"metres": 1e3}, r"no head's motion .*positions are in m; these look like mm"),
        ({"metres": 1e2}, r"no head's motion .*these look like cm"),
        ({"seconds": 1e3}, r"rate_hz: its rows have 0\.12 Hz.*stamps look like ms; they are in s"),
        ({"seconds": 1e6}, "stamps look like us"),
        ({"w_first": True}, r"first quaternion is 1 0 0 0.*the order is qx qy qz qw"),
    ],
)
def test_another_unit_or_order_is_told(tmp_path, wrong, says):
    with pytest.raises(DataError, match=says):
        read_motion(scaled(tmp_path / "odd.tum", **wrong))


def test_poses_in_a_room_are_told(tmp_path):
    path = scaled(tmp_path / "odd.tum")
    head = [line for line in path.read_text().splitlines() if line.startswith("#")]
    rows = [f"{k / 120} {0.4 + k * 1e-4} 1.6 -0.3 0 0 0 1" for k in range(240)]
    path.write_text("\n".join([*head, *rows]) + "\n")
    with pytest.raises(DataError, match=r"isn't the identity: 1\.68 m .*not in a room or world"):
        read_motion(path)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda rows: rows[:1000] + rows[1500:], r"has no rows for 4\.17 s after 8\.\d+ s"),
        (
            lambda rows: rows[:1000] + [moved(row, 0.3) for row in rows[1000:]],
            r"leaps at \d\d\.?\d* m/s after 8\.325 s",
        ),
    ],
)
def test_holes_and_leaps_are_told(tmp_path, change, says):
    path = scaled(tmp_path / "odd.tum")
    lines = path.read_text().splitlines()
    head = [line for line in lines if line.startswith("#")]
    path.write_text("\n".join(head + change(lines[len(head) :])) + "\n")
    with pytest.raises(DataError, match=says):
        read_motion(path)


def moved(row: str, metres: float) -> str:
    t, x, *rest = row.split()
    return " ".join((t, str(float(x) + metres), *rest))
