import numpy as np
import pytest

from vrbench.errors import DataError
from vrbench.recording.importer import AxesOptions
from vrbench.recording.importers.tum import IMPORTER


def test_rows_become_samples_with_one_time_each(tmp_path):
    path = tmp_path / "head.tum"
    path.write_text("# t x y z qx qy qz qw\n0.5 1 2 3 0 0 0 1\n0.75 4 5 6 0 0 0 -1\n")
    samples = IMPORTER.read(path, AxesOptions()).samples
    for t in (samples.source_t, samples.pose_t, samples.receive_t):
        np.testing.assert_array_equal(t, [500_000_000, 750_000_000])
    np.testing.assert_array_equal(samples.pose.p, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(samples.pose.q, [[0, 0, 0, 1]] * 2)
    assert samples.good.all()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "holds no poses"),
        ("# only a comment\n", "holds no poses"),
        ("0 1 2 3 0 0 0\n", "rows have 7 columns"),
        ("0 1 2 3 0 0 0 1\n1 1 2 3 0 0 0\n", "is not TUM text"),
        ("0 1 2 3 0 0 zero 1\n", "is not TUM text"),
        ("0 1 2 nan 0 0 0 1\n", "position of pose 1 is not finite"),
        ("nan 1 2 3 0 0 0 1\n", "stamp of pose 1 is nan s"),
        ("0 1 2 3 0 0 0 1\n1e300 1 2 3 0 0 0 1\n", r"stamp of pose 2 is 1e\+300 s"),
        ("0 1 2 3 0 0 0 1e200\n", "quaternion of pose 1 has length inf"),
        ("0 1 2 3 0 0 0 2\n", "quaternion of pose 1 has length 2"),
        ("".join(f"{9 - k} 1 2 3 0 0 0 1\n" for k in range(9)), "stamps go back or repeat at 8"),
        ("0 1 2 3 0 0 0 1", "holds no whole line"),
    ],
)
def test_bad_rows_give_one_error_that_names_the_file(tmp_path, text, says):
    path = tmp_path / "head.tum"
    path.write_text(text)
    with pytest.raises(DataError, match=rf"head\.tum: .*{says}"):
        IMPORTER.read(path, AxesOptions())


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(DataError, match=r"none\.tum: can't be read"):
        IMPORTER.read(tmp_path / "none.tum", AxesOptions())


ROWS = "".join(f"{k}.5 1 2 {k} 0 0 0 1\n" for k in range(20))


def test_a_last_row_without_its_newline_is_left_out_and_told(tmp_path):
    path = tmp_path / "head.tum"
    path.write_text("# t x y z qx qy qz qw\n" + ROWS + "20.5 1 2 20 0 0 0 1")
    imported = IMPORTER.read(path, AxesOptions())
    assert len(imported.samples) == 20
    assert imported.samples.pose_t[-1] == 19_500_000_000
    assert imported.repairs == ("line 22 left out: the file ends in the midst of it",)


def test_a_byte_order_mark_is_no_number(tmp_path):
    path = tmp_path / "head.tum"
    path.write_text(ROWS, encoding="utf-8-sig")
    assert len(IMPORTER.read(path, AxesOptions()).samples) == 20


def test_one_row_that_stands_twice_is_dropped_and_told(tmp_path):
    path = tmp_path / "head.tum"
    path.write_text(ROWS + "19.5 1 2 19 0 0 0 1\n")
    imported = IMPORTER.read(path, AxesOptions())
    assert len(imported.samples) == 20
    assert "1 pose dropped" in imported.repairs[0]
