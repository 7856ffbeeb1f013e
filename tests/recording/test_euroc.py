import numpy as np
import pytest

from vrbench.errors import DataError
from vrbench.recording.importer import AxesOptions
from vrbench.recording.importers.euroc import IMPORTER

HEADER = "#timestamp [ns], p_x [m], p_y [m], p_z [m], q_w [], q_x [], q_y [], q_z []\n"
ROWS = "1706706034330367565,1,2,3,0.8,0.6,0,0\n1706706034363700898,4,5,6,-0.8,-0.6,0,0\n"


@pytest.fixture
def read(tmp_path):
    def read_text(text):
        path = tmp_path / "head.csv"
        path.write_text(text)
        return IMPORTER.read(path, AxesOptions())

    return read_text


@pytest.mark.parametrize("header", ["", HEADER, HEADER + "# more\n"])
def test_stamps_are_exact_and_quaternions_are_turned_to_xyzw(read, header):
    samples = read(header + ROWS).samples
    assert samples.pose_t.tolist() == [1706706034330367565, 1706706034363700898]
    np.testing.assert_array_equal(samples.pose.p, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_allclose(samples.pose.q, [[0.6, 0, 0, 0.8]] * 2)


def test_the_state_behind_the_pose_in_ground_truth_is_passed_by(read):
    wide = "".join(f"{row},{','.join('9' * 9)}\n" for row in ROWS.splitlines())
    np.testing.assert_array_equal(read(wide).samples.pose.p, read(ROWS).samples.pose.p)


def test_a_line_cut_short_is_left_out_and_recorded(read):
    imported = read(HEADER + ROWS + "1706706034397034231,1,2,3,0.8,0.6,0,0")
    assert len(imported.samples) == 2
    assert imported.repairs == ("line 4 left out: the file ends in the midst of it",)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"),
        (HEADER, "holds no poses"),
        (HEADER + ROWS + "1,2\n", r"line 4: has 2 columns \(8 columns: timestamp, x"),
        (HEADER + "1,2,3,4,5,6,7,8,9\n", "line 2: has 9 columns"),
        (HEADER + "0.5,1,2,3,1,0,0,0\n", r"line 2, column 1 \(timestamp\): '0\.5' is not a whole"),
        (HEADER + "5,1,2,3,one,0,0,0\n", r"line 2, column 5 \(qw\): 'one' is not a number"),
        (HEADER + "5,1,2,inf,1,0,0,0\n", "position of pose 1 is not finite"),
        (HEADER + "5,1,2,3,1,1,0,0\n", r"quaternion of pose 1 has length 1\.414"),
    ],
)
def test_bad_files_give_one_error(read, text, says):
    with pytest.raises(DataError, match=rf"head\.csv: .*{says}"):
        read(text)
