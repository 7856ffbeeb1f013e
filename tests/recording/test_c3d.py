"""C3D files, written by ezc3d itself."""

import numpy as np
import pytest

from tests.recording.markers import markers_of
from vrbench.errors import DataError
from vrbench.geometry import Transform, relative_angle, rotvec_to_quat
from vrbench.recording.importers.c3d import IMPORTER, Options

ezc3d = pytest.importorskip("ezc3d", reason="reading C3D needs ezc3d: pip install 'vrbench[c3d]'")

N = 120
RNG = np.random.default_rng(6)
SHAPE = np.array([[81, 34, -41], [-74, 41, -32], [13, 78, 21], [-52, -29, -63]]) / 1e3
POSE = Transform(
    np.cumsum(RNG.normal(0, 0.01, (N, 3)), axis=0),
    rotvec_to_quat(np.cumsum(RNG.normal(0, 0.03, (N, 3)), axis=0)),
)
LABELS = ["h1", "h2", "h3", "h4", "chair"]


@pytest.fixture
def write(tmp_path):
    def write_file(*, unit="mm", scale=1000.0, lost=(), rate=240.0):
        markers = np.concatenate((markers_of(SHAPE, POSE), np.zeros((N, 1, 3))), axis=1)
        file = ezc3d.c3d()
        file["parameters"]["POINT"]["UNITS"]["value"] = [unit]
        file["parameters"]["POINT"]["RATE"]["value"] = [rate]
        file["parameters"]["POINT"]["LABELS"]["value"] = LABELS
        points = np.ones((4, len(LABELS), N))
        points[:3] = np.moveaxis(markers, (0, 1, 2), (2, 1, 0)) * scale
        for frame in lost:
            points[:3, :2, frame] = np.nan
        file["data"]["points"] = points
        path = tmp_path / "take.c3d"
        file.write(str(path))
        return path

    return write_file


def read(path, **options):
    options = {"markers": LABELS[:4], "up": "y", **options}
    return IMPORTER.read(path, Options(**options))


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1000.0), ("m", 1.0), ("cm", 100.0)])
def test_the_body_is_fitted_to_its_markers(write, unit, scale):
    imported = read(write(unit=unit, scale=scale))
    samples = imported.samples
    assert len(samples) == N
    apart = np.linalg.norm(imported.markers[:, None] - imported.markers, axis=2)
    true = np.linalg.norm(SHAPE[:, None] - SHAPE, axis=2)
    np.testing.assert_allclose(apart, true, atol=1e-5)
    constant = POSE.inverse() @ samples.pose
    assert np.ptp(constant.p, axis=0).max() < 1e-5
    assert relative_angle(constant.q, constant.q[0]).max() < 1e-4
    assert np.diff(samples.pose_t).mean() == pytest.approx(1e9 / 240.0)
    assert "gives no time of day" in imported.repairs[0]


def test_lost_markers_make_invalid_samples(write):
    samples = read(write(lost=(3, 4, 5))).samples
    assert np.flatnonzero(~samples.good).tolist() == [3, 4, 5]


def test_z_up_is_turned_and_the_start_is_given(write):
    path = write()
    y = read(path).samples
    z = read(path, up="z", start="2024-01-31T13:00:50+01:00").samples
    np.testing.assert_allclose(z.pose.p, y.pose.p[:, [0, 2, 1]] * [1, 1, -1], atol=1e-6)
    assert z.pose_t[0] - y.pose_t[0] == 1_706_702_450 * 10**9


def test_what_is_wrong_is_named(write, tmp_path):
    path = write()
    with pytest.raises(DataError, match=r"no marker hat \(there are h1, h2, h3, h4, chair\)"):
        read(path, markers=["h1", "h2", "hat"])
    with pytest.raises(DataError, match="don't keep their distances"):
        read(path, markers=None)
    with pytest.raises(DataError, match="'furlong' isn't a known unit"):
        read(write(unit="furlong"))
    with pytest.raises(DataError, match="no such file"):
        read(tmp_path / "none.c3d")
    broken = tmp_path / "broken.c3d"
    broken.write_bytes(path.read_bytes()[:300])
    with pytest.raises(DataError, match=r"broken\.c3d"):
        read(broken)
