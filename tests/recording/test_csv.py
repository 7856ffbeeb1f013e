import numpy as np
import pytest
from pydantic import ValidationError

from vrbench.errors import DataError
from vrbench.geometry import ROS, UNITY, UNREAL, Transform, quat_normalize, relative_angle
from vrbench.recording.importers.csv import IMPORTER, CsvOptions

NAMED = {
    "time": "t",
    "position": ["px", "py", "pz"],
    "quaternion": ["qx", "qy", "qz", "qw"],
}
NUMBERED = {"time": 1, "position": [2, 3, 4], "quaternion": [5, 6, 7, 8]}
HEADER = "t,px,py,pz,qx,qy,qz,qw\n"
ROWS = "1706706034.330367565,1,2,3,0.6,0,0,0.8\n1706706034.363700898,4,5,6,-0.6,0,0,-0.8\n"
STAMPS = [1706706034330367565, 1706706034363700898]


@pytest.fixture
def read(tmp_path):
    def read_text(text, **options):
        path = tmp_path / "log.csv"
        path.write_text(text)
        return IMPORTER.read(path, CsvOptions(**options))

    return read_text


def test_named_columns_are_found_wherever_they_stand(read):
    text = "qw, qz, qy, qx, state, t, pz, py, px\n0.8,0,0,0.6,ok,1706706034.330367565,3,2,1\n"
    samples = read(text, **NAMED).samples
    assert samples.pose_t.tolist() == STAMPS[:1]
    np.testing.assert_array_equal(samples.pose.p, [[1, 2, 3]])
    np.testing.assert_allclose(samples.pose.q, [[0.6, 0, 0, 0.8]])


def test_columns_without_names_are_counted_from_1(read):
    samples = read("# a remark\n" + ROWS, **NUMBERED).samples
    assert samples.pose_t.tolist() == STAMPS
    np.testing.assert_array_equal(samples.pose.p, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_allclose(samples.pose.q, [[0.6, 0, 0, 0.8]] * 2)


def test_remarks_and_quotes_are_no_numbers(read):
    first, second = ROWS.splitlines()
    text = f"# made by hand\n\n{HEADER}{first}\n# a pause\n"
    text += ",".join(f'"{field}"' for field in second.split(",")) + "\n"
    imported = read(text, **NAMED)
    assert imported.samples.pose_t.tolist() == STAMPS
    assert imported.repairs == ("a blank line passed by (first: line 2)",)


@pytest.mark.parametrize(
    ("unit", "text", "ns"),
    [
        ("s", "1.5e1", 15_000_000_000),
        ("ms", "12.000001", 12_000_001),
        ("us", "1700000000000000.25", 1_700_000_000_000_000_250),
        ("ns", "1700000000000000001", 1_700_000_000_000_000_001),
        ("ticks", "506931781", 50_693_178_100),
        # .NET, since the year 1: 2024-01-31 13:00:50.6931781
        ("utc-ticks", "638423028506931781", 1_706_706_050_693_178_100),
        ("ticks", "638423028506931781", None),
        ("s", "1706706050693178100", None),
    ],
)
def test_stamps_keep_every_digit_in_every_unit(read, unit, text, ns):
    row = f"{text},1,2,3,0,0,0,1\n"
    if ns is None:
        with pytest.raises(DataError, match=rf"'{text}' is no time since 1970.*another unit"):
            read(row, **NUMBERED, time_unit=unit)
    else:
        samples = read(row, **NUMBERED, time_unit=unit).samples
        assert samples.pose_t.tolist() == [ns]


@pytest.mark.parametrize(
    ("axes", "options"),
    [
        (UNITY, {"handedness": "left", "up": "y"}),
        (UNREAL, {"handedness": "left", "up": "z", "position_unit": "cm"}),
        (ROS, {"handedness": "right", "up": "z"}),
        (ROS, {"up": "z", "quaternion_order": "wxyz"}),
    ],
)
def test_poses_of_other_conventions_become_openxrs(read, axes, options):
    rng = np.random.default_rng(1)
    truth = Transform(rng.normal(size=(20, 3)), quat_normalize(rng.normal(size=(20, 4))))
    theirs = axes.from_openxr(truth)
    q = theirs.q[:, [3, 0, 1, 2]] if "quaternion_order" in options else theirs.q
    text = "".join(
        ",".join(map(repr, map(float, (i, *p, *r)))) + "\n"
        for i, (p, r) in enumerate(zip(theirs.p, q, strict=True))
    )
    samples = read(text, **NUMBERED, **options).samples
    np.testing.assert_allclose(samples.pose.p, truth.p, atol=1e-12)
    np.testing.assert_allclose(relative_angle(samples.pose.q, truth.q), 0.0, atol=1e-7)


@pytest.mark.parametrize("delimiter", [";", "tab", "space"])
def test_delimiters_and_decimal_commas(read, delimiter):
    sign = {"tab": "\t", "space": "   "}.get(delimiter, delimiter)
    text = (HEADER + ROWS).replace(",", sign).replace(".", ",")
    samples = read(text, **NAMED, delimiter=delimiter, decimal=",").samples
    assert samples.pose_t.tolist() == STAMPS


def test_lines_at_the_top_can_be_passed_by(read):
    assert len(read("Logger 3\nby the lab\n" + HEADER + ROWS, **NAMED, skip=2).samples) == 2


def test_a_line_cut_short_is_left_out_and_recorded(read):
    imported = read(HEADER + ROWS + "1706706034.4,1,2,3,0.6,0,0,0.8", **NAMED)
    assert imported.repairs == ("line 4 left out: the file ends in the midst of it",)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"),
        (HEADER, "holds no poses"),
        ("t,px,py,pz,qx,qy,qz\n1,2,3,4,5,6,7\n", r"has no column 'qw' \(7 columns: t, px"),
        ("t,px,py,pz,qx,qy,qz,qw,t\n" + ROWS, "has more than one column 't'"),
        (HEADER + ROWS + "1,2\n", r"line 4: has 2 columns \(8 columns: t, px"),
        (HEADER + ROWS + "\nx\n", "line 5: has 1 columns"),
        (HEADER + "1,2,x,3,0,0,0,1\n", r"line 2, column 3 \(py\): 'x' is not a number"),
        (HEADER + "now,2,2,3,0,0,0,1\n", r"line 2, column 1 \(t\): 'now' is not a number"),
        (HEADER + "nan,2,2,3,0,0,0,1\n", r"line 2, column 1 \(t\): 'nan' is not a number"),
        (HEADER + "1e30,2,2,3,0,0,0,1\n", r"line 2, column 1 \(t\)"),
        (HEADER + "1,2,inf,3,0,0,0,1\n", "position of pose 1 is not finite"),
        (HEADER + "1,2,2,3,0,0,0,0\n", "quaternion of pose 1 has length 0"),
        (
            HEADER + ROWS + "".join(f"1806706030,{k},2,3,0,0,0,1\n" for k in range(4)),
            "stamps go back or repeat.*one pose a stamp",
        ),
    ],
)
def test_bad_files_give_one_error(read, text, says):
    with pytest.raises(DataError, match=rf"log\.csv: .*{says}"):
        read(text, **NAMED)


def test_a_column_past_the_last_is_named(read):
    with pytest.raises(DataError, match="has no column '9'"):
        read(ROWS, time=9, position=(2, 3, 4), quaternion=(5, 6, 7, 8))


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({**NAMED, "time": 1}, "all names, or all numbers"),
        ({**NUMBERED, "time": 0}, "counted from 1"),
        ({**NUMBERED, "time": 2}, "named twice"),
        ({**NUMBERED, "decimal": ","}, "both ,"),
        ({**NUMBERED, "up": "x"}, "say which axis is forward"),
        ({**NUMBERED, "up": "y", "forward": "-y"}, "one line"),
        ({**NUMBERED, "scale": 2}, "scale"),
    ],
)
def test_options_that_make_no_sense_are_refused(options, says):
    with pytest.raises(ValidationError, match=says):
        CsvOptions(**options)
