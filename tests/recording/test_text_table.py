"""Lines of text logs, and axes: what every importer of text does in one way."""

import numpy as np
import pytest

from vrbench.errors import DataError
from vrbench.geometry import CONVENTIONS, Transform, quat_normalize, relative_angle
from vrbench.recording.importers.csv import IMPORTER as CSV
from vrbench.recording.importers.duke import IMPORTER as DUKE
from vrbench.recording.importers.euroc import IMPORTER as EUROC
from vrbench.recording.importers.tum import IMPORTER as TUM
from vrbench.recording.text_table import filled_lines

RNG = np.random.default_rng(6)
EYE = Transform(RNG.normal(size=(9, 3)), quat_normalize(RNG.normal(size=(9, 4))))
COLUMNS = {"time": 1, "position": [2, 3, 4], "quaternion": [5, 6, 7, 8]}


def rows(pose, *, gap=",", unit=1, order=(0, 1, 2, 3)):
    numbers = np.hstack((pose.p, pose.q[:, order])).tolist()
    return [gap.join(map(str, (k * unit, *row))) for k, row in enumerate(numbers)]


FORMATS = {
    "tum": (TUM, {"gap": " "}, {}),
    "euroc": (EUROC, {"unit": 10**9, "order": (3, 0, 1, 2)}, {}),
    "duke": (DUKE, {}, {"axes": "openxr"}),
    "csv": (CSV, {}, COLUMNS),
}


@pytest.fixture(params=FORMATS)
def form(request, tmp_path):
    """Writes poses or lines as one of the formats, and reads them."""
    importer, writing, reading = FORMATS[request.param]

    class Form:
        def lines(self, pose=EYE):
            return rows(pose, **writing)

        def read(self, text, **options):
            path = tmp_path / "log.txt"
            path.write_text(text, newline="")
            return importer.read(path, importer.options(**{**reading, **options}))

    return Form()


@pytest.mark.parametrize("blank", ["", "  ", "\t", "\0\0\0", "\r"])
def test_a_blank_line_is_passed_by_and_told(form, blank):
    lines = form.lines()
    # without its newline, so that TUM too is read with care
    text = "\n".join([*lines[:4], blank, *lines[4:], "cut"])
    imported = form.read(text)
    np.testing.assert_array_equal(imported.samples.pose.p, EYE.p)
    assert "a blank line passed by (first: line 5)" in imported.repairs


def test_lines_are_counted_as_an_editor_does(form):
    lines = form.lines()
    text = "\n".join([lines[0], "", "", lines[1].replace(str(EYE.p[1, 0]), "x"), "cut"])
    with pytest.raises(DataError, match="line 4, column 2"):
        form.read(text)


def test_lines_may_end_as_on_windows(form):
    imported = form.read("\r\n".join([*form.lines(), ""]))
    np.testing.assert_array_equal(imported.samples.pose.p, EYE.p)
    assert imported.repairs == ()


# A map of columns says up, forward and handedness instead.
@pytest.mark.parametrize("axes", CONVENTIONS)
@pytest.mark.parametrize("form", sorted(FORMATS.keys() - {"csv"}), indirect=True)
def test_axes_that_are_named_become_openxrs(form, axes):
    theirs = CONVENTIONS[axes].from_openxr(EYE)
    pose = form.read("\n".join([*form.lines(theirs), ""]), axes=axes).samples.pose
    np.testing.assert_allclose(pose.p, EYE.p, atol=1e-12)
    assert relative_angle(pose.q, EYE.q).max() < 1e-12


def test_a_file_of_blank_lines_is_empty(tmp_path):
    path = tmp_path / "log.txt"
    path.write_text("\n  \n\t\n")
    with pytest.raises(DataError, match="is empty"):
        filled_lines(path, fix="rows")
    path.write_text("\0\0\n")
    with pytest.raises(DataError, match="is empty"):
        filled_lines(path, fix="rows")
