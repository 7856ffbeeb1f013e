"""The importer of the Unity logger's own log, on logs made here."""

import numpy as np
import pytest
from vrbench_quest.vrbench_log import COLUMNS, FIRST, IMPORTER, LogOptions, facts_of

from vrbench.errors import DataError

ORIGIN = 1_700_000_000_123_456_789
HEAD = (
    f"{FIRST}\n# utc_origin_ns: {ORIGIN}\n# model: Quest 3\n# take: replay\n{','.join(COLUMNS)}\n"
)


def line(t, moment="render", p=(0.1, 0.2, 0.3), q=(0.0, 0.0, 0.0, 1.0), flags=15, epoch=0):
    numbers = ",".join(map(str, (*p, *q)))
    return f"{t},1,{moment},{numbers},0,0,0,NaN,NaN,NaN,{flags},1,{epoch}\n"


ROWS = "".join(
    line(10**9 + k * 13_888_889 + m, name)
    for k in range(5)
    for m, name in enumerate(("update", "render"))
)


@pytest.fixture
def read(tmp_path):
    def read_text(text, **options):
        path = tmp_path / "log.csv"
        path.write_text(text)
        return IMPORTER.read(path, LogOptions(**options))

    return read_text


def test_times_are_exact_and_unity_becomes_openxr(read):
    samples = read(HEAD + ROWS).samples
    assert samples.source_t.tolist() == [10**9 + k * 13_888_889 + 1 for k in range(5)]
    assert (samples.pose_t - samples.source_t).tolist() == [ORIGIN] * 5
    np.testing.assert_array_equal(samples.pose.p, [[0.1, 0.2, -0.3]] * 5)
    assert samples.good.all()
    assert read(HEAD + ROWS, moment="update").samples.source_t[0] == 10**9


def test_flags_and_epochs_are_kept_and_lost_tracking_is_said(read):
    text = HEAD + ROWS + "# event 5 reset epoch 1\n"
    text += line(2 * 10**9, flags=7, epoch=1) + line(3 * 10**9, q=(0, 0, 0, 0), flags=0, epoch=1)
    imported = read(text)
    assert imported.samples.flags.tolist() == [15] * 5 + [7, 0]
    assert imported.samples.epoch.tolist() == [0] * 5 + [1, 1]
    assert imported.repairs == ("2 samples are not tracked, as the headset says",)


@pytest.mark.parametrize("wrong", [{"p": (1, "NaN", 3)}, {"q": (0, 0, 0, 0)}, {"q": (1, 1, 0, 0)}])
def test_a_sample_that_is_no_pose_is_no_good_one_as_it_is_live(read, wrong):
    imported = read(HEAD + ROWS + line(9**10, **wrong) + line(9**10 + 1))
    assert imported.samples.good.tolist() == [True] * 5 + [False, True]
    assert imported.repairs == ("1 samples called tracked are no poses, and not taken as such",)


@pytest.mark.parametrize("blank", ["\n", "  \n", "\r\n"])
def test_a_blank_line_is_passed_by_and_told(read, blank):
    imported = read(HEAD + ROWS + blank + line(9**10))
    assert len(imported.samples) == 6
    assert imported.repairs == ("a blank line passed by (first: line 16)",)


def test_the_header_tells_of_the_device(read, tmp_path):
    read(HEAD + ROWS)
    facts = facts_of(tmp_path / "log.csv")
    assert facts["model"] == "Quest 3"
    assert facts["take"] == "replay"


def test_a_log_cut_short_keeps_its_whole_lines(read):
    imported = read(HEAD + ROWS + line(9 * 10**9)[:-4])
    assert len(imported.samples) == 5
    assert imported.repairs == ("line 16 left out: the file ends in the midst of it",)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"),
        ("t,x\n1,2\n", "is not a log of vrbench's Unity logger"),
        (f"{FIRST}\n{','.join(COLUMNS)}\n{ROWS}", "utc_origin_ns is ''"),
        (HEAD.replace(str(ORIGIN), "noon") + ROWS, "utc_origin_ns is 'noon'"),
        (HEAD.replace("flags", "state") + ROWS, "line 5: has other columns: state"),
        (HEAD.replace(",epoch", "") + ROWS, "line 5: has other columns: epoch"),
        (HEAD.replace("log 1", "log 2") + ROWS, "is a log of version 2"),
        (HEAD + ROWS.replace("0.1", "0,1"), "line 6: has 20 columns"),
        (HEAD, "holds no samples of the moment render"),
        (HEAD + ROWS + "1,2,3\n", "line 16: has 3 columns"),
        (HEAD + ROWS + line("soon"), r"line 16, column 1 \(time_ns\): 'soon' is not a number"),
        (HEAD + ROWS + line(9**10, p=(1, "x", 3)), r"line 16, column 5 \(y\): 'x' is not a"),
        (HEAD + ROWS + line(9**10, flags=99), "flags or epoch of sample 6"),
        (HEAD + ROWS + line(9**10, flags=0.5), "flags or epoch of sample 6"),
        (HEAD + ROWS + ROWS, "stamps go back or repeat"),
    ],
)
def test_bad_logs_give_one_error(read, text, says):
    with pytest.raises(DataError, match=rf"log\.csv: .*{says}"):
        read(text)
