from pathlib import Path

import pytest

from vrbench.config.suite import load_suite
from vrbench.errors import ConfigError

TEXT = """\
suite: swing
version: 1
title: A swing
motions: {head: shooter-1, calibration: saturate-1}
cases:
  - {id: calibrate, motion: calibration, role: calibration}
  - {id: replay, motion: head, repeats: 3, remounts: 1, needs: [x, clock, y], anchor: 10 s}
metrics: [ape, rpe]
gate: {handeye.translation: 15 mm, handeye.rotation: 0.5 deg, max_age: 60 min, bracket: 1 mm}
rank: {metric: ape.translation.aligned, min_coverage: 95 %}
"""


@pytest.fixture
def write(tmp_path):
    def write(text: str, name: str = "swing") -> Path:
        path = tmp_path / f"{name}.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.fixture
def load(write):
    def load(text: str, name: str = "swing", **others: Path):
        return load_suite(str(write(text, name)), others)

    return load


def changed(*pairs: tuple[str, str]) -> str:
    text = TEXT
    for old, new in pairs:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def test_a_suite_is_what_its_file_says(load):
    suite = load(TEXT)
    assert suite.label == "swing@1"
    assert suite.mover == "robot"
    assert suite.gate.handeye_translation == 0.015
    assert suite.rank.min_coverage == 0.95
    assert suite.case("replay").anchor == 10.0
    assert [case.id for case in suite.calibrations] == ["calibrate"]


@pytest.mark.parametrize(
    ("old", "new", "place", "says"),
    [
        ("version: 1", "version: 0", "2:1", "version: found 0 .*greater than or equal to 1"),
        ("suite: swing", "suite: A Swing", "1:1", "suite: found 'A Swing'"),
        ("title: A swing", "colour: red", "3:1", "colour: .*1 more besides"),
        ("repeats: 3", "repeats: 0", "7:32", r"cases\.1\.repeats: found 0"),
        (
            "repeats: 3",
            "repeat: 3",
            "7:32",
            r"cases\.1\.repeat: .*no such field.*repeats, remounts",
        ),
        ("anchor: 10 s", "anchor: 10 mm", "7:79", r"cases\.1\.anchor: found '10 mm' .*s, ms, min"),
        ("anchor: 10 s", "anchor: 0 s", "7:79", r"cases\.1\.anchor: .*greater than 0"),
        ("role: calibration", "role: calib", "6:42", "'calibration', 'check' or 'scored'"),
        ("[x, clock, y]", "[x, z]", "7:68", r"needs\.1: found 'z' .*'x', 'clock' or 'y'"),
        ("bracket: 1 mm", "brackets: 1 mm", "9:80", "fields are handeye.translation, "),
        ("min_coverage: 95 %", "min_coverage: 95", "10:41", "less than or equal to 1"),
        ("[ape, rpe]", "[]", "8:1", "metrics: "),
        ("motion: head", "motion: hat", "1:1", "replay moves by 'hat' .*head, calibration"),
        ("id: replay", "id: calibrate", "1:1", "two cases are called calibrate .*an id each"),
        (", role: calibration", "", "1:1", "case replay needs x .*role calibration"),
    ],
)
def test_an_error_says_where_what_and_what_would_be_right(load, old, new, place, says):
    text = changed((old, new))
    with pytest.raises(ConfigError, match=rf"swing\.yaml:{place}: .*{says}") as error:
        load(text)
    assert error.value.fix


def test_an_unknown_case_lists_the_known(load):
    with pytest.raises(ConfigError, match=r"swing@1 has no case 'dance' .*calibrate, replay"):
        load(TEXT).case("dance")


# names and versions


def test_a_suite_is_found_by_name_and_by_name_and_version(write):
    path = write(TEXT)
    for name in ("swing", "swing@1", str(path)):
        assert load_suite(name, {"swing": path}).label == "swing@1"


def test_a_version_that_is_not_there_names_the_one_that_is(write):
    with pytest.raises(ConfigError, match=r"swing\.yaml: version: version 2 .*it is swing@1"):
        load_suite("swing@2", {"swing": write(TEXT)})


def test_an_unknown_suite_lists_the_known(write):
    with pytest.raises(
        ConfigError, match=r"'dance' .*calibration, gameplay-replay, head-capture, .*swing"
    ):
        load_suite("dance", {"swing": write(TEXT)})


def test_a_missing_file_is_named():
    with pytest.raises(ConfigError, match=r"dance\.yaml: no such file .*gameplay-replay"):
        load_suite("dance.yaml")


# digest


@pytest.mark.parametrize(
    "pairs",
    [
        [("title: A swing", "title: Another title")],
        [("anchor: 10 s", "anchor: 10000 ms")],
        [("anchor: 10 s", "anchor: 10")],
        [("max_age: 60 min", "max_age: 1 h"), ("bracket: 1 mm", "bracket: 0.1 cm")],
        [("min_coverage: 95 %", "min_coverage: 0.95")],
        [("version: 1", "version: 1\nmover: robot\nreferences: [robot]")],
        [
            (
                "{head: shooter-1, calibration: saturate-1}",
                "{calibration: saturate-1, head: shooter-1}",
            )
        ],
        [("suite: swing\n", "# a remark\nsuite: 'swing'\n")],
    ],
)
def test_the_digest_is_blind_to_title_units_order_and_writing(load, pairs):
    assert load(changed(*pairs), "other").digest == load(TEXT).digest


@pytest.mark.parametrize(
    "pair",
    [
        ("suite: swing", "suite: swing-2"),
        ("version: 1", "version: 2"),
        ("shooter-1", "shooter-2"),
        ("handeye.translation: 15 mm", "handeye.translation: 14 mm"),
        ("max_age: 60 min", "max_age: 61 min"),
        ("repeats: 3", "repeats: 4"),
        ("anchor: 10 s", "anchor: 11 s"),
        ("[ape, rpe]", "[ape]"),
        ("95 %", "94 %"),
    ],
)
def test_the_digest_is_changed_by_all_else(load, pair):
    assert load(changed(pair), "other").digest != load(TEXT).digest


# extends


EXTENDING = "suite: slow-swing\nversion: 1\ntitle: Slow\nextends: swing@1\n"


def test_what_is_not_written_is_copied(load, write):
    base = write(TEXT)
    slow = load(EXTENDING, "slow-swing", swing=base)
    expected = {**load_suite(str(base)).canonical(), "suite": "slow-swing", "title": "Slow"}
    assert slow.canonical() == expected


def test_a_suite_that_extends_has_the_digest_of_one_that_is_written_out(load, write):
    slow = load(EXTENDING, "slow-swing", swing=write(TEXT))
    assert slow.digest == load(changed(("suite: swing", "suite: slow-swing")), "whole").digest


def test_lists_and_mappings_are_replaced_whole(load, write):
    text = EXTENDING + "metrics: [scale]\ngate: {bracket: 2 mm}\n"
    slow = load(text, "slow-swing", swing=write(TEXT))
    assert slow.metrics == ("scale",)
    assert slow.gate.bracket == 0.002
    assert slow.gate.handeye_translation == 0.015
    assert slow.case("replay").repeats == 3


def test_a_chain_of_suites_is_resolved(load, write):
    others = {"swing": write(TEXT), "slow-swing": write(EXTENDING, "slow-swing")}
    text = "suite: slower\nversion: 1\ntitle: Slower\nextends: slow-swing@1\nmetrics: [ape]\n"
    slower = load(text, "slower", **others)
    assert slower.metrics == ("ape",)
    assert slower.case("replay").repeats == 3


@pytest.mark.parametrize(
    ("extends", "says"),
    [
        ("swing@2", "there is no swing@2 .*swing@1"),
        ("swing", r"there is no swing@\? .*swing@1"),
        ("dance@1", "'dance' .*gameplay-replay.*swing"),
        ("none.yaml@1", "none.yaml.*gameplay-replay|no such file .*gameplay-replay"),
    ],
)
def test_a_base_that_is_not_there_is_an_error_in_the_line_that_names_it(load, write, extends, says):
    text = EXTENDING.replace("swing@1", extends)
    with pytest.raises(ConfigError, match=rf"slow-swing\.yaml:4:1: extends: .*(?:{says})"):
        load(text, "slow-swing", swing=write(TEXT))


def test_a_field_that_is_wrong_in_a_suite_that_extends_has_its_line(load, write):
    with pytest.raises(ConfigError, match=r"slow-swing\.yaml:6:3: gate\.brackets: "):
        load(EXTENDING + "gate:\n  brackets: 1 mm\n", "slow-swing", swing=write(TEXT))


def test_suites_that_extend_each_other_are_refused(load, write):
    text = "suite: a\nversion: 1\ntitle: A\nextends: b@1\n"
    others = {"b": write("suite: b\nversion: 1\ntitle: B\nextends: a@1\n", "b")}
    others["a"] = write(text, "a")
    with pytest.raises(ConfigError, match=r"a\.yaml:4:1: extends: extends itself"):
        load(text, "a", **others)


def test_a_suite_may_not_pass_for_the_one_it_extends(load, write):
    with pytest.raises(ConfigError, match=r"posing\.yaml:1:1: suite: is called swing@1"):
        load("extends: swing@1\nmetrics: [ape]\n", "posing", swing=write(TEXT))


# schedule


def names(suite) -> list[str]:
    return [step.name for step in suite.schedule()]


def test_every_mount_is_opened_and_closed_by_the_calibrations(load):
    assert names(load(TEXT)) == [
        "calibrate.default.m1.r1",
        "replay.default.m1.r1",
        "replay.default.m1.r2",
        "replay.default.m1.r3",
        "calibrate.default.m1.r2",
        "calibrate.default.m2.r1",
        "replay.default.m2.r1",
        "replay.default.m2.r2",
        "replay.default.m2.r3",
        "calibrate.default.m2.r2",
    ]


def test_a_case_without_remounts_is_run_in_the_first_mount_only(load):
    text = changed(("metrics:", "  - {id: check, motion: head}\nmetrics:"), ("repeats: 3, ", ""))
    assert names(load(text)) == [
        "calibrate.default.m1.r1",
        "replay.default.m1.r1",
        "check.default.m1.r1",
        "calibrate.default.m1.r2",
        "calibrate.default.m2.r1",
        "replay.default.m2.r1",
        "calibrate.default.m2.r2",
    ]


def test_without_calibrations_only_the_cases_are_run(load):
    text = changed((", role: calibration", ""), ("[x, clock, y]", "[]"), (", remounts: 1", ""))
    assert names(load(text))[0] == "calibrate.default.m1.r1"
    assert names(load(text))[1:] == [f"replay.default.m1.r{n}" for n in (1, 2, 3)]


def test_no_two_takes_have_one_name(load):
    found = names(load(changed(("remounts: 1", "remounts: 3"))))
    assert len(found) == len(set(found)) == 4 * 5


@pytest.mark.parametrize(
    ("name", "digest"),
    [
        ("calibration", "b9c14c12414b2a5d9c4712eb70f3bb0a58609da4a630ff180b965ab61dd25789"),
        ("gameplay-replay", "e1e646fd134813a487be43b5052cb71fc4f34d32e91b179758b83dbf75f03fe2"),
        ("head-capture", "24fe60cef9987864e08180c7edf926a2d5b3bc58a3b61d9fea491e064e6d61d5"),
        ("long-loop", "7b121ffb3ded730895d3fa7ed35ccfcca7262921b199ecee4774b136b69db37d"),
        ("occluded-cameras", "3dbb70aeeb68c3d59f0d2f92eaf4cad6d9cfa3e00eb9f28c833aa0e4e952b84f"),
        ("relocalisation", "cf162e6ccaef796678b36d3d00cefdfd44df87b5fc388324f4be9d67b1eaf62d"),
        ("speed-sweep", "a4406d29fc4f9f2d9abbea5341434519220d5e87c4c7ca06cb5ddce2bb915e50"),
        ("static-jitter", "c46e5a144d43c0f014ab9f910f4b79e59a5a1d5ef4406f0f54e9d6addaf62729"),
    ],
)
def test_a_released_suite_never_changes(name, digest):
    """Where this fails, results of today stand on another board: raise the suite's version."""
    assert load_suite(name).digest == digest
