"""The importer on logs made here, line by line as the app writes them."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from vrbench_quest.unity_log import IMPORTER, TICKS_AT_1970

from vrbench.errors import DataError
from vrbench.geometry import quat_normalize
from vrbench.recording.importer import NoOptions

START = datetime(2024, 1, 31, 13, 0, 50, 693_178, tzinfo=UTC)
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
START_TICKS = TICKS_AT_1970 + (START - EPOCH) // timedelta(microseconds=1) * 10
RNG = np.random.default_rng(2)
N = 30
POSES = np.hstack((RNG.normal(size=(N, 3)), quat_normalize(RNG.normal(size=(N, 4)))))
POSES[:, 3:] *= np.where(
    np.cumprod(np.r_[1, np.sign(np.sum(POSES[1:, 3:] * POSES[:-1, 3:], axis=1))]) < 0, -1, 1
)[:, None]
TICKS = START_TICKS + np.arange(N) * 138_889


def line(ticks, pose, *, local_h=1, number=repr):
    time = EPOCH + timedelta(microseconds=(int(ticks) - TICKS_AT_1970) // 10)
    calendar = (time.year, time.month, time.day, time.hour, time.minute, time.second)
    fields = (int(ticks) + local_h * 36_000_000_000, ticks, *calendar, time.microsecond // 1000)
    return ",".join([*map(str, fields), *(number(float(x)) for x in pose)])


def log(ticks=TICKS, poses=POSES, **options):
    return [line(t, pose, **options) for t, pose in zip(ticks, poses, strict=True)]


def text(lines):
    return "".join(f"{line}\n" for line in lines)


@pytest.fixture
def read(tmp_path):
    def read_text(content):
        path = tmp_path / "eye.txt"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return IMPORTER.read(path, NoOptions())

    return read_text


def test_ticks_become_nanoseconds_exactly_and_unity_becomes_openxr(read):
    imported = read(text(log()))
    samples = imported.samples
    for t in (samples.source_t, samples.pose_t, samples.receive_t):
        assert t.dtype == np.int64
        assert t.tolist() == [(int(x) - TICKS_AT_1970) * 100 for x in TICKS]
    np.testing.assert_array_equal(samples.pose.p, POSES[:, :3] * [1, 1, -1])
    np.testing.assert_allclose(samples.pose.q, POSES[:, 3:] * [-1, -1, 1, 1], atol=1e-15)
    assert samples.good.all()
    assert imported.repairs == ()


@given(st.integers(0, 99_999_999_999))
def test_no_tick_is_lost(tmp_path_factory, later):
    path = tmp_path_factory.mktemp("log") / "eye.txt"
    path.write_text(text(log([START_TICKS + later], POSES[:1])))
    t = IMPORTER.read(path, NoOptions()).samples.pose_t
    assert t.tolist() == [(START_TICKS + later - TICKS_AT_1970) * 100]


@pytest.mark.parametrize("local_h", [-11, 0, 1, 14])
def test_local_time_does_not_matter(read, local_h):
    imported = read(text(log(local_h=local_h)))
    np.testing.assert_array_equal(imported.samples.pose_t, read(text(log())).samples.pose_t)


def test_scientific_notation_is_read(read):
    imported = read(text(log(number=lambda x: f"{x:.15E}")))
    np.testing.assert_allclose(imported.samples.pose.p, POSES[:, :3] * [1, 1, -1], atol=1e-14)


@pytest.mark.parametrize("keep", [1, 20, 60, -1])
def test_a_line_cut_short_is_left_out_and_recorded(read, keep):
    lines = log()
    imported = read(text(lines[:-1]) + lines[-1][:keep])
    assert len(imported.samples) == N - 1
    assert imported.repairs == (f"line {N} left out: the file ends in the midst of it",)


def test_a_whole_last_line_without_its_newline_is_not_trusted(read):
    assert len(read(text(log())[:-1]).samples) == N - 1


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
@pytest.mark.parametrize("start", ["", "\ufeff"])
def test_line_endings_and_marks_of_editors_do_not_matter(read, ending, start):
    imported = read(start + ending.join(log()) + ending + ending)
    assert len(imported.samples) == N
    assert imported.repairs == ()


def with_comma(x):
    return f"{x:.9g}".replace(".", ",")


def test_decimal_commas_are_recognised_and_recorded(read):
    plain = read(text(log(number=lambda x: f"{x:.9g}"))).samples
    semicolons = [line.replace(",", ";") for line in log(number=lambda x: f"{x:.9g}")]
    for lines, said in (
        (log(number=with_comma), "numbers with a decimal comma read as such"),
        (semicolons, "columns split at semicolons"),
        ([line.replace(".", ",") for line in semicolons], "columns split at semicolons"),
    ):
        imported = read(text(lines))
        np.testing.assert_array_equal(imported.samples.pose.p, plain.pose.p)
        np.testing.assert_array_equal(imported.samples.pose.q, plain.pose.q)
        assert imported.repairs == (said,)


def test_decimal_commas_and_exponents_go_together(read):
    small = np.tile([1.5e-05, -2.5e-06, 1.25, 0.5, -0.5, 0.5, -0.5], (3, 1))
    lines = log(TICKS[:3], small, number=lambda x: f"{x:E}".replace(".", ","))
    np.testing.assert_array_equal(
        read(text(lines)).samples.pose.p, small[:, :3] * np.array([1, 1, -1])
    )


def test_frames_of_whole_numbers_are_read_in_any_language(read):
    poses = np.vstack(([0, 0, 0, 0, 0, 0, 1], POSES[1:]))
    imported = read(text(log(poses=poses, number=with_comma)))
    np.testing.assert_array_equal(imported.samples.pose.p[0], [0, 0, 0])
    assert len(imported.samples) == N


def test_decimal_commas_that_cannot_be_told_apart_are_refused(read):
    poses = POSES.copy()
    poses[3, 1] = 2.0
    with pytest.raises(
        DataError, match=r"line 4: has 22 columns: its decimal commas can't be told"
    ):
        read(text(log(poses=poses, number=with_comma)))


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("", "is empty"),
        ("\n\n", "is empty"),
        ("638423028506931760,6384230", "holds no whole line"),
        ("\n638423028506931760,6384230", "holds no whole line"),
        ("a,b,c\n", r"line 1: has 3 columns \(16 columns: local_ticks, utc_ticks"),
        (b"\xff\xfe\x00\x01\n", "line 1: has 1 columns"),
        (b"\0" * 4096, "holds no whole line"),
    ],
)
def test_what_is_no_log_gives_one_error(read, content, says):
    with pytest.raises(DataError, match=rf"eye\.txt: .*{says}"):
        read(content)


@pytest.mark.parametrize("columns", [15, 17])
def test_a_line_of_another_number_of_columns_is_named(read, columns):
    lines = log()
    lines[6] = ",".join([*lines[6].split(","), "0"][:columns])
    with pytest.raises(DataError, match=rf"line 7: has {columns} columns"):
        read(text(lines))


@pytest.mark.parametrize("blank", ["", "   ", "\r"])
def test_a_blank_line_in_between_is_passed_by_and_told(read, blank):
    lines = log()
    imported = read(text([*lines[:6], blank, *lines[6:]]))
    assert len(imported.samples) == N
    assert imported.repairs == ("a blank line passed by (first: line 7)",)


def test_lines_after_a_blank_one_are_counted_as_an_editor_does(read):
    lines = log()
    with pytest.raises(DataError, match="line 9: has 1 columns"):
        read(text([*lines[:6], "", *lines[6:7], "oops"]))


@pytest.mark.parametrize(
    ("column", "value", "says"),
    [
        (2, "6.38E+17", r"column 2 \(utc_ticks\): '6\.38E\+17' is not a whole number"),
        (2, "638423028506931780.5", r"column 2 \(utc_ticks\)"),
        (2, "", r"column 2 \(utc_ticks\): '' is not a whole number"),
        (2, "9" * 25, r"column 2 \(utc_ticks\)"),
        (10, "abc", r"column 10 \(x\): 'abc' is not a number"),
        (16, "", r"column 16 \(qw\): '' is not a number"),
        (12, "0.1.2", r"column 12 \(z\)"),
        (12, "# 1", r"column 12 \(z\)"),
    ],
)
def test_a_value_that_is_no_number_is_named_by_line_and_column(read, column, value, says):
    lines = log()
    fields = lines[4].split(",")
    fields[column - 1] = value
    lines[4] = ",".join(fields)
    with pytest.raises(DataError, match=rf"line 5, {says}"):
        read(text(lines))


@pytest.mark.parametrize("value", ["NaN", "Infinity", "-inf"])
def test_values_that_are_not_finite_are_refused(read, value):
    lines = log()
    fields = lines[4].split(",")
    fields[10] = value
    lines[4] = ",".join(fields)
    with pytest.raises(DataError, match="position of line 5 is not finite"):
        read(text(lines))


def test_quaternions_that_are_none_are_refused(read):
    poses = POSES.copy()
    poses[2, 3:] = 0.0
    with pytest.raises(DataError, match="quaternion of line 3 has length 0"):
        read(text(log(poses=poses)))


def test_another_file_of_16_columns_is_refused(read):
    with pytest.raises(DataError, match=r"line 1, column 2 \(utc_ticks\): 1 is not the time"):
        read(text([",".join("1" for _ in range(15)) + ",0", *log()]))
    swapped = [",".join((b, a, *rest)) for a, b, *rest in (x.split(",") for x in log())]
    with pytest.raises(DataError, match="is not the time 2024 1 31 13 0 50 693 in ticks"):
        read(text(swapped))


def test_a_frame_logged_twice_is_dropped_and_recorded(read):
    ticks = TICKS.copy()
    ticks[9] = ticks[8]
    imported = read(text(log(ticks)))
    assert len(imported.samples) == N - 1
    assert imported.repairs == ("1 line dropped, whose stamps repeat or go back (first: line 10)",)


def test_a_clock_that_was_set_back_is_refused(read):
    ticks = TICKS.copy()
    ticks[15:] -= 5 * 138_889
    with pytest.raises(DataError, match=r"first at line 16, by up to 0\.056 s"):
        read(text(log(ticks)))


def test_jumps_of_position_are_kept(read):
    poses = POSES.copy()
    poses[:, :3] = 0.0
    poses[3:, 0] = 0.05
    assert len(read(text(log(poses=poses))).samples) == N


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(DataError, match=r"none\.txt: can't be read"):
        IMPORTER.read(tmp_path / "none.txt", NoOptions())
    with pytest.raises(DataError, match="can't be read"):
        IMPORTER.read(tmp_path, NoOptions())


@given(st.lists(st.tuples(st.integers(0, 4000), st.binary(max_size=6)), min_size=1, max_size=4))
def test_a_damaged_log_gives_poses_or_one_error(tmp_path_factory, places):
    content = text(log()).encode()
    for at, what in places:
        content = content[:at] + what + content[at + max(len(what), 1) :]
    path = tmp_path_factory.mktemp("log") / "eye.txt"
    path.write_bytes(content)
    try:
        samples = IMPORTER.read(path, NoOptions()).samples
    except DataError as error:
        assert "eye.txt" in str(error)
    else:
        assert np.isfinite(samples.pose.p).all()
        assert np.all(np.diff(samples.pose_t) > 0)
