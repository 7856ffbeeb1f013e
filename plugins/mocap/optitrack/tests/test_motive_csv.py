"""The importer of Motive's CSV exports, on files written here as each version writes them."""

from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from vrbench_optitrack.motive_csv import IMPORTER, Options

from vrbench.errors import DataError
from vrbench.geometry import relative_angle
from vrbench.importing import import_recordings
from vrbench.plugin.manager import Plugins
from vrbench.protocols.body import body_shapes

N = 40
RNG = np.random.default_rng(4)
P = np.array([0.2, 1.3, -0.4]) + np.cumsum(RNG.normal(0, 0.01, (N, 3)), axis=0)
Q = Rotation.from_rotvec(np.cumsum(RNG.normal(0, 0.02, (N, 3)), axis=0)).as_quat()
START = "2024-01-31 01.00.50.693 PM"
START_NS = round(datetime(2024, 1, 31, 13, 0, 50, 693_000, tzinfo=UTC).timestamp() * 1000) * 10**6
UNITS = {"Meters": 1.0, "Centimeters": 100.0, "Millimeters": 1000.0, "Inches": 1 / 0.0254}


def export(
    *,
    version="1.23",
    rotation="Quaternion",
    unit="Meters",
    rate=240.0,
    capture_rate=None,
    first=0,
    blanks=(),
    body="headset",
    space="Global",
    start=START,
    extra_bodies=(),
    carried=(),
):
    """A file as Motive writes it: a marker's columns before the body's, and the body's after."""
    facts = ["Format Version", version, "Take Name", "take", "Take Notes", ""]
    facts += ["Capture Frame Rate", f"{capture_rate or rate:.6f}"]
    facts += ["Export Frame Rate", f"{rate:.6f}", "Capture Start Time", start]
    facts += ["Rotation Type", rotation, "Length Units", unit, "Coordinate Space", space]
    axes = "XYZW" if rotation == "Quaternion" else "XYZ"
    types, names, ids, kinds, columns = [], [], [], [], []
    for name in (*extra_bodies, body):
        parts = [("Rotation", a) for a in axes] + [("Position", a) for a in "XYZ"]
        for kind, axis in [*parts, ("Mean Marker Error", "")]:
            types.append("Rigid Body")
            names.append(name)
            ids.append('"9D1FE3FA7E3011EE"')
            kinds.append(kind)
            columns.append(axis)
    for number in range(len(carried)):
        for axis in "XYZ":
            types.append("Rigid Body Marker")
            names.append(f"{body}:Marker{number + 1}")
            ids.append('"9D1FE3FA7E3011EF"')
            kinds.append("Position")
            columns.append(axis)
    marker = (["Marker"] * 3, [f"{body}:Marker1"] * 3, ['"2A"'] * 3, ["Position"] * 3, list("XYZ"))
    types, names, ids, kinds, columns = (
        m + b for m, b in zip(marker, (types, names, ids, kinds, columns), strict=True)
    )
    lines = [",".join(facts), ""]
    lines += [",".join(["", "Type", *types]), ",".join(["", "Name", *names])]
    lines += [",".join(["", "ID", *ids])]
    if version == "1.25":
        lines.append(",".join(["", "Parent", *names]))
    lines += [",".join(["", "", *kinds]), ",".join(["Frame", "Time (Seconds)", *columns])]
    turned = Rotation.from_quat(Q)
    turns = Q if rotation == "Quaternion" else turned.as_euler(rotation[:3], degrees=True)
    if rotation != "Quaternion":
        turns = turns[:, [rotation.index(axis) for axis in "XYZ"]]
    spots = np.concatenate([turned.apply(m) + P for m in carried], axis=1) if carried else P[:, :0]
    for i in range(N):
        scale = UNITS.get(unit, 1.0)
        values = [*turns[i], *(P[i] * scale), 0.0002, *(spots[i] * scale)]
        cells = [f"{x:.6f}" for x in values] if i not in blanks else [""] * len(values)
        other = [f"{x:.6f}" for _ in extra_bodies for x in [0.0] * (len(axes) - 1) + [1.0] * 5]
        marked = [f"{x:.6f}" for x in P[i]] if i not in blanks else [""] * 3
        cells = [str(first + i), f"{(first + i) / rate:.3f}000", *marked, *other, *cells]
        lines.append(",".join(cells))
    return "".join(f"{line}\n" for line in lines)


@pytest.fixture
def read(tmp_path):
    def read_text(text, **options):
        path = tmp_path / "take.csv"
        path.write_text(text, encoding="utf-8")
        return IMPORTER.read(path, Options(**options))

    return read_text


@pytest.mark.parametrize("version", ["1.20", "1.21", "1.22", "1.23", "1.24", "1.25"])
@pytest.mark.parametrize("unit", UNITS)
def test_every_version_and_unit(read, version, unit):
    imported = read(export(version=version, unit=unit), utc_offset="+00:00")
    samples = imported.samples
    np.testing.assert_allclose(samples.pose.p, P, atol=2e-6)
    assert relative_angle(samples.pose.q, Q).max() < 1e-5
    assert samples.pose_t[0] == START_NS
    assert imported.repairs == ()


@pytest.mark.parametrize("order", ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX", "XYZ Euler"])
def test_every_rotation_type(read, order):
    samples = read(export(rotation=order)).samples
    assert relative_angle(samples.pose.q, Q).max() < 1e-5


def test_euler_angles_turn_about_the_bodys_own_axes(read):
    quarter = export(rotation="XYZ").splitlines()
    cells = quarter[-1].split(",")
    cells[5:8] = ["90.0", "90.0", "0.0"]
    samples = read("\n".join([*quarter[:-1], ",".join(cells)]) + "\n").samples
    # a quarter about x, then one about the new y: x goes to where z was taken to by the first
    turned = Rotation.from_quat(samples.pose.q[-1]).apply(np.eye(3))
    np.testing.assert_allclose(turned, [[0, 1, 0], [0, 0, 1], [1, 0, 0]], atol=1e-6)


CARRIED = [(0.08, 0.01, 0.0), (-0.05, 0.06, 0.02), (0.0, 0.03, -0.09)]


@pytest.mark.parametrize("unit", ["Meters", "Millimeters"])
def test_where_the_bodys_markers_sit_is_read(read, unit):
    imported = read(
        export(unit=unit, carried=CARRIED, blanks=(0, 7), extra_bodies=["a"]), body="headset"
    )
    np.testing.assert_allclose(imported.markers, CARRIED, atol=1e-5)
    assert read(export()).markers is None


def test_with_z_up_markers_are_turned_as_the_body_is(read):
    markers = read(export(carried=CARRIED), up="z").markers
    x, y, z = np.transpose(CARRIED)
    np.testing.assert_allclose(markers, np.stack((x, z, -y), axis=1), atol=1e-5)


RECORDINGS = """
suite: head-capture
lab: test
device: {headset: unknown}
licence: CC-BY-4.0
consent: written
takes:
  - {case: play, motion: mine, mocap: {format: motive-csv, path: take.csv}}
"""


def test_an_imported_take_tells_where_the_markers_sit(tmp_path):
    (tmp_path / "take.csv").write_text(export(carried=CARRIED), encoding="utf-8")
    (tmp_path / "mine.yaml").write_text(RECORDINGS, encoding="utf-8")
    plugins = Plugins()
    bundle = import_recordings(
        str(tmp_path / "mine.yaml"), tmp_path / "run", plugins, lambda *_: None
    )
    (shape,) = body_shapes(bundle.columns(bundle.record.takes[0]), "mocap")
    np.testing.assert_allclose(shape, np.array(CARRIED) * 1e3, atol=0.01)


def test_blank_cells_are_invalid_samples_in_their_place(read):
    blanks = (0, 1, 17, N - 1)
    samples = read(export(blanks=blanks)).samples
    assert len(samples) == N
    assert np.flatnonzero(~samples.good).tolist() == list(blanks)
    seen = samples.pose.p[samples.good]
    np.testing.assert_allclose(seen, np.delete(P, blanks, axis=0), atol=2e-6)
    assert np.isfinite(samples.pose.p).all()
    assert len(samples.trajectory()) == N - len(blanks)


def test_times_are_frames_over_the_rate_and_not_the_rounded_column(read):
    samples = read(export(rate=360.0, first=78_593), start="1970-01-01T00:00:00+00:00").samples
    want = np.rint(np.arange(78_593, 78_593 + N) / 360.0 * 1e9)
    np.testing.assert_array_equal(samples.pose_t, want)


def test_the_rate_is_the_one_that_the_times_agree_with(read):
    text = export(rate=120.0).replace("Export Frame Rate,120.000000", "Export Frame Rate,60.000000")
    samples = read(text).samples
    assert np.diff(samples.pose_t).mean() == pytest.approx(1e9 / 120.0)
    wrong = text.replace("Capture Frame Rate,120.000000", "Capture Frame Rate,240.000000")
    with pytest.raises(DataError, match="agree with no frame rate it gives: 60, 240"):
        read(wrong)


@pytest.mark.parametrize(
    ("start", "hour"),
    [
        ("2024-01-31 01.00.50.693 PM", 13),
        ("2024-01-31 01.00.50.693 AM", 1),
        ("2024-01-31 12.00.50.693 AM", 0),
        ("2024-01-31 12.00.50.693 PM", 12),
        ("2024-01-31 10.00.50.693 DU.", 22),
        ("2024-01-31 10.00.50.693 DE.", 10),
        ("2024-01-31 13.00.50.693", 13),
    ],
)
def test_local_times_are_read_and_what_is_assumed_is_told(read, start, hour):
    imported = read(export(start=start))
    said = datetime.fromtimestamp(imported.samples.pose_t[0] / 1e9, tz=UTC)
    assert (said.day, said.hour, said.minute, said.second) == (31, hour, 0, 50)
    assert "has no zone and is taken for UTC" in imported.repairs[0]
    shifted = read(export(start=start), utc_offset="+01:00")
    assert imported.samples.pose_t[0] - shifted.samples.pose_t[0] == 3600 * 10**9
    assert shifted.repairs == ()


def test_a_word_for_noon_that_is_not_known_leaves_the_time_open(read):
    imported = read(export(start="2024-01-31 01.00.50.693 XX"))
    assert imported.samples.pose_t[0] == 0
    assert "gives no time of day" in imported.repairs[0]


def test_the_body_is_chosen_by_name(read):
    two = export(extra_bodies=("controller",))
    np.testing.assert_allclose(read(two, body="headset").samples.pose.p, P, atol=2e-6)
    with pytest.raises(DataError, match=r"which one is meant\? \(there are controller, headset"):
        read(two)
    with pytest.raises(DataError, match=r"no body 'hmd' \(there are headset\)"):
        read(export(), body="hmd")


def test_z_up_exports_are_turned(read):
    samples = read(export(), up="z").samples
    np.testing.assert_allclose(samples.pose.p, P[:, [0, 2, 1]] * [1, 1, -1], atol=2e-6)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda s: "", "is empty"),
        (lambda s: "a,b\n1,2\n", "line 1: isn't an export of Motive"),
        (lambda s: s.replace("Frame,Time", "Bild,Zeit"), "has no line of column names"),
        (lambda s: s.replace("Meters", "Cubits"), r"Length Units: 'Cubits' isn't a known unit"),
        (lambda s: s.replace("Quaternion", "Gibbs"), "Rotation Type: 'Gibbs' isn't a known"),
        (lambda s: s.replace("Global", "Local"), "Coordinate Space: poses are Local"),
        (lambda s: s.replace("Rigid Body", "Bone"), "has no rigid body .*it has Bone, Marker"),
        (lambda s: s.replace(",Position,Position,Mean", ",Pos,Pos,Mean"), "no column Position Y"),
        (lambda s: s.replace("\n5,", "\nfive,"), "line 13: has a cell that is no number"),
        (lambda s: "\n".join(s.split("\n")[:7]) + "\n", "holds no frames"),
        (lambda s: export(blanks=range(N)), "seen in no frame"),
    ],
)
def test_what_is_wrong_is_named(read, change, says):
    with pytest.raises(DataError, match=rf"take\.csv: .*{says}"):
        read(change(export()))


@pytest.mark.parametrize("start", ["yesterday", "2024-01-31T13:00:50"])
def test_a_start_without_zone_is_refused(read, start):
    with pytest.raises(DataError, match="is not a time with its zone"):
        read(export(), start=start)


def test_a_line_cut_short_is_left_out_and_recorded(read):
    imported = read(export()[:-20], utc_offset="+00:00")
    assert len(imported.samples) == N - 1
    assert "left out" in imported.repairs[0]


@given(st.lists(st.tuples(st.integers(0, 6000), st.binary(max_size=6)), min_size=1, max_size=4))
def test_a_damaged_file_gives_poses_or_one_error(tmp_path_factory, places):
    content = export().encode()
    for at, what in places:
        content = content[:at] + what + content[at + max(len(what), 1) :]
    path = tmp_path_factory.mktemp("csv") / "take.csv"
    path.write_bytes(content)
    try:
        samples = IMPORTER.read(path, Options()).samples
    except DataError as error:
        assert "take.csv" in str(error)
    else:
        assert np.isfinite(samples.pose.p).all()


def test_real_exports_without_bodies_say_what_they_have(shared):
    for name, has in (("test_default", "nothing"), ("test_markers_enabled", "Marker")):
        with pytest.raises(DataError, match=rf"has no rigid body \(it has {has}: export again"):
            IMPORTER.read(shared / "motive_csv" / f"{name}.csv", Options())


def test_the_frames_of_a_real_export_agree_with_its_rate_and_its_local_time(shared, read):
    """A body is written over the columns of a real file's markers: all else stays as it was."""
    text = (shared / "motive_csv" / "test_markers_enabled.csv").read_text(encoding="utf-8-sig")
    lines = text.splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("Frame,"))
    labels = {line.split(",")[1]: i for i, line in enumerate(lines[:start]) if line.startswith(",")}
    seven = ["Rigid Body"] * 7, ["b"] * 7, ["Rotation"] * 4 + ["Position"] * 3, list("XYZWXYZ")
    at = (labels["Type"], labels["Name"], start - 1, start)
    for i, cells in zip(at, seven, strict=True):
        lines[i] += "," + ",".join(cells)
    for i in range(start + 1, len(lines)):
        lines[i] += ",0,0,0,1,100,1200,300"
    samples = read("\n".join(lines) + "\n").samples
    assert len(samples) == 1353
    assert np.diff(samples.pose_t).mean() == pytest.approx(1e9 / 360.0, rel=1e-6)
    assert datetime.fromtimestamp(samples.pose_t[0] / 1e9, tz=UTC).hour == 22
    np.testing.assert_allclose(samples.pose.p[0], [0.1, 1.2, 0.3])
