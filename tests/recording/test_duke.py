import numpy as np
import pytest

from vrbench.errors import DataError
from vrbench.recording.importer import AxesOptions
from vrbench.recording.importers.duke import IMPORTER

HEADER = "timestamp,pos_x,pos_y,pos_z,qua_1,qua_2,qua_3,qua_4\n"
ROWS = "1742321034.3303676,1,2,3,0.6,0,0,0.8\n1742321034.363701,4,5,6,-0.6,0,0,-0.8\n"
STAMPS = [1742321034330367600, 1742321034363701000]


@pytest.fixture
def read(tmp_path):
    def read_text(text, axes=None):
        path = tmp_path / "quest3.csv"
        path.write_text(text)
        return IMPORTER.read(path, AxesOptions(axes=axes))

    return read_text


@pytest.mark.parametrize("header", ["", HEADER])
@pytest.mark.parametrize("separator", [",", " ", "\t", ", "])
def test_commas_and_blanks_with_and_without_a_header(read, header, separator):
    imported = read((header + ROWS).replace(",", separator), "openxr")
    samples = imported.samples
    assert samples.pose_t.tolist() == STAMPS
    np.testing.assert_array_equal(samples.pose.p, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_allclose(samples.pose.q, [[0.6, 0, 0, 0.8]] * 2)
    assert imported.repairs == ()


def test_the_engines_axes_become_openxrs(read):
    unity, ros = read(ROWS, "unity").samples, read(ROWS, "ros").samples
    np.testing.assert_array_equal(unity.pose.p[0], [1, 2, -3])
    np.testing.assert_allclose(unity.pose.q[0], [-0.6, 0, 0, 0.8])
    np.testing.assert_array_equal(ros.pose.p[0], [-2, 3, -1])


def test_axes_that_nobody_gave_are_said(read):
    imported = read(ROWS)
    np.testing.assert_array_equal(imported.samples.pose.p[0], [1, 2, 3])
    assert imported.repairs == ("axes taken to be OpenXR's: the file doesn't say, nor does `axes`",)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"),
        (HEADER, "holds no poses"),
        (HEADER + "1,2,3\n", "line 2: has 3 columns"),
        (HEADER + ROWS + "\nx\n", "line 5: has 1 columns"),
        (HEADER + "1,a,3,4,0,0,0,1\n", r"line 2, column 2 \(x\): 'a' is not a number"),
        (HEADER + "1,1,3,4,1,1,0,1\n", r"quaternion of pose 1 has length 1\.732"),
        (HEADER + ROWS * 2, "stamps go back"),
    ],
)
def test_bad_files_give_one_error(read, text, says):
    with pytest.raises(DataError, match=rf"quest3\.csv: .*{says}"):
        read(text)
