"""Conditions, loops, holds, events: what suites may say, in which order, and what is refused."""

from pathlib import Path

import pytest

from vrbench.config.suite import load_suite
from vrbench.errors import ConfigError

TEXT = """\
suite: covered
version: 1
title: Covered
motions: {head: shooter-1, calibration: saturate-1, check: saturate-30s-1}
cases:
  - {id: calibrate, motion: calibration, role: calibration}
  - {id: check, motion: check, role: check}
  - {id: replay, motion: head, repeats: 2, needs: [x, clock, y]}
conditions:
  - {id: none, baseline: true}
  - {id: two, occlude: two, repeats: 1}
  - {id: three, occlude: three}
order: given
compare: paired
metrics: [ape]
rank: {metric: ape.translation.aligned}
"""
LOOPED = """\
suite: looped
version: 1
title: Looped
motions: {head: shooter-1, opening: saturate-30s-1}
cases:
  - {id: loop, motion: head, loops: 3, hold: 2 s, exclude: [opening, gap]}
metrics: [coverage]
rank: {metric: coverage.valid, statistic: value}
"""


@pytest.fixture
def load(tmp_path):
    def load(text: str, *changes: tuple[str, str]):
        for old, new in changes:
            assert text.count(old) == 1, old
            text = text.replace(old, new)
        path = tmp_path / "suite.yaml"
        path.write_text(text)
        return load_suite(str(path))

    return load


def names(suite, mount: int = 1) -> list[str]:
    return [step.name.replace(f".m{mount}", "") for step in suite.schedule() if step.mount == mount]


# order


def test_in_the_given_order_every_condition_is_opened_by_a_check(load):
    assert names(load(TEXT)) == [
        "calibrate.default.r1",
        "check.none.r1",
        "replay.none.r1",
        "replay.none.r2",
        "check.two.r1",
        "replay.two.r1",
        "check.three.r1",
        "replay.three.r1",
        "replay.three.r2",
        "calibrate.default.r2",
    ]


def visited(suite, mount: int = 1) -> list[str]:
    """The conditions in the order in which they are come to."""
    found = [s.condition for s in suite.schedule() if s.mount == mount and s.case.id == "replay"]
    return [c for c, before in zip(found, [None, *found], strict=False) if c != before]


def test_abba_goes_there_and_back_and_nothing_is_checked_where_nothing_changes(load):
    suite = load(TEXT, ("order: given", "order: abba"))
    order = visited(suite)
    assert order == order[::-1]
    assert order[0] == "none"
    assert set(order) == {"none", "two", "three"}
    assert sum(name.startswith("check") for name in names(suite)) == len(order) == 5
    repeats = [s.repeat for s in suite.schedule() if (s.case.id, s.condition) == ("replay", "none")]
    assert repeats == [1, 2, 3, 4]


def test_shuffled_begins_and_ends_with_the_baseline_and_is_the_same_every_time(load):
    six = "".join(f"\n  - {{id: c{k}}}" for k in range(6))
    changes = [("order: given", "order: shuffled"), ("repeats: 2,", "repeats: 2, remounts: 3,")]
    suite = load(TEXT, *changes, ("\n  - {id: three, occlude: three}", six))
    orders = [tuple(visited(suite, mount)) for mount in range(1, 5)]
    assert {(order[0], order[-1]) for order in orders} == {("none", "none")}
    assert len(set(orders)) > 1  # another order in another mount
    assert orders[0] == tuple(visited(suite))


def test_a_condition_sets_what_it_names_and_leaves_the_rest(load):
    suite = load(TEXT)
    steps = {step.name: step.case for step in suite.schedule()}
    assert steps["replay.two.m1.r1"].occlude == "two"
    assert steps["replay.none.m1.r1"].occlude == "none"
    assert steps["check.three.m1.r1"].occlude == "three"
    assert steps["calibrate.default.m1.r1"].occlude == "none"
    assert steps["replay.two.m1.r1"].needs == ("x", "clock", "y")


# digest


def test_a_knob_that_has_its_default_moves_no_digest(load):
    written = load(LOOPED, ("loops: 3", "loops: 3, speed: 1.0, occlude: none, repeats: 1"))
    assert written.digest == load(LOOPED).digest


@pytest.mark.parametrize(
    ("text", "change"),
    [
        (TEXT, ("order: given", "order: abba")),
        (TEXT, ("compare: paired\n", "")),
        (TEXT, ("occlude: three", "occlude: all")),
        (LOOPED, ("loops: 3", "loops: 4")),
        (LOOPED, ("hold: 2 s", "hold: 3 s")),
        (LOOPED, ("exclude: [opening, gap]", "exclude: [gap]")),
        (LOOPED, ("loops: 3", "duration: 5 min")),
        (LOOPED, ("hold: 2 s", "hold: 2 s, events: [{after: 1, do: recentre}]")),
    ],
)
def test_every_knob_is_part_of_the_digest(load, text, change):
    assert load(text, change).digest != load(text).digest


# what doesn't go together


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            ("{id: none, baseline: true}", "{id: none}"),
            "no condition is the baseline .*baseline: true",
        ),
        (("{id: two,", "{id: two, baseline: true,"), "none and two are both the baseline"),
        (("{id: two,", "{id: none,"), "two conditions are called none .*an id each"),
        (
            ("order: given", "order: random"),
            r"order: found 'random' .*'given', 'abba' or 'shuffled'",
        ),
        (("compare: paired", "compare: all"), "compare: found 'all'"),
        (
            ("occlude: three}", "cover: three}"),
            r"conditions\.2\.cover: there is no such field .*occlude",
        ),
        (("occlude: three}", "speed: 20}"), r"conditions\.2\.speed: found 20"),
        (("role: check", "role: check, repeats: 2"), "case check is a check, .*no repeats"),
        (("role: check", "role: check, hold: 2 s"), "case check is a check, its motion run once"),
        ((", role: calibration", ""), "case check checks the mount .*role calibration"),
        (("occlude: three}", "loops: 3}"), "case replay repeats its motion .*motions an opening"),
    ],
)
def test_conditions_that_are_no_use_are_refused(load, change, says):
    with pytest.raises(ConfigError, match=rf"suite\.yaml:\d+:\d+: .*{says}") as error:
        load(TEXT, change)
    assert error.value.fix


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            ("loops: 3", "loops: 3, duration: 2 h"),
            "both loops and duration: give|both loops and dur",
        ),
        (("opening: saturate-30s-1", "other: saturate-30s-1"), "clocks .*motions an opening"),
        (
            ("opening: saturate-30s-1", "opening: shooter-1"),
            "opens with the motion that",
        ),
        (("loops: 3, ", ""), "excludes opening, which its takes don't have"),
        (("exclude: [opening, gap]", "exclude: [pause]"), r"exclude\.0: found 'pause'"),
        (("hold: 2 s, exclude: [opening, gap]", "exclude: [hold]"), "excludes hold"),
        (("hold: 2 s", "hold: 2 mm"), r"hold: found '2 mm' .*s, ms, min"),
        (("loops: 3", "loops: 0"), "loops: found 0"),
        (("version: 1", "version: 1\norder: abba"), "order is abba, and there are no conditions"),
        (("version: 1", "version: 1\ncompare: paired"), "compare is paired, and there are no cond"),
        (
            ("version: 1", "version: 1\nmover: person"),
            "how a robot moves, and the mover is a person",
        ),
        (("hold: 2 s", "events: [{do: uncover}]"), "one time .*give after .* or at"),
        (("hold: 2 s", "events: [{after: 1, at: 2 s, do: recentre}]"), "one time"),
        (("hold: 2 s", "events: [{after: 1, do: occlude}]"), "has a level .*level: all"),
        (("hold: 2 s", "events: [{after: 1, do: uncover, level: all}]"), "has a level"),
        (("hold: 2 s", "events: [{at: 5 s, do: uncover}]"), "a hand at the headset.*give after"),
        (
            ("hold: 2 s", "events: [{after: 4, do: uncover}]"),
            "after run 4 .*run 3 times .*loops: 4",
        ),
        (("hold: 2 s", "events: [{after: 1, do: dance}]"), "do: found 'dance'"),
    ],
)
def test_knobs_that_do_not_go_together_are_refused(load, change, says):
    with pytest.raises(ConfigError, match=rf"suite\.yaml:\d+:\d+: .*(?:{says})") as error:
        load(LOOPED, change)
    assert error.value.fix


# motion files


@pytest.fixture
def motion_file(tmp_path) -> Path:
    from vrbench.motion.files import Header, write_motion
    from vrbench.motion.generators import generate

    folder = tmp_path / "motions"
    folder.mkdir()
    head = generate("saturate-30s-1").trajectory[:1200]
    header = Header(motion="mine", version=2, up="y", rate_hz=120.0, source="generated")
    write_motion(folder / "mine.tum", header, head)
    return folder / "mine.tum"


FILED = ("head: shooter-1", "head: motions/mine.tum")


def test_a_motion_file_is_found_from_the_suites_folder_and_known_by_its_content(load, motion_file):
    suite = load(LOOPED, FILED)
    motion = suite.motion("head")
    assert (motion.name, len(motion.trajectory)) == ("mine-2", 1200)
    assert suite.canonical()["motions"]["head"] == f"mine-2 sha256:{motion.digest}"
    before = suite.digest
    rows = motion_file.read_text()
    motion_file.write_text(rows.replace("0.00833", "0.00834"))
    with pytest.raises(ConfigError, match=r"mine\.tum: has changed since the suite was loaded"):
        suite.motion("head")
    motion_file.write_text(rows)
    renamed = motion_file.rename(motion_file.with_name("other.tum"))
    assert load(LOOPED, ("head: shooter-1", "head: motions/other.tum")).digest == before
    rows = renamed.read_text().splitlines()
    renamed.write_text("\n".join(rows[:-1]) + "\n")
    assert load(LOOPED, ("head: shooter-1", "head: motions/other.tum")).digest != before


def test_a_suite_that_extends_keeps_the_motion_files_of_its_base(load, motion_file, tmp_path):
    load(LOOPED, FILED)
    above = tmp_path / "above.yaml"
    above.write_text("suite: above\nversion: 1\ntitle: Above\nextends: suite.yaml@1\n")
    suite = load_suite(str(above))
    assert suite.motion("head").name == "mine-2"


def test_a_motion_file_that_is_not_there_is_named_with_the_line_that_names_it(load):
    with pytest.raises(ConfigError, match=r"suite\.yaml:4:11: motions\.head: no motion file is at"):
        load(LOOPED, FILED)


def test_a_resolved_suite_says_where_to_load_its_motion_file_from(load, motion_file):
    from vrbench.config.suite import Suite

    resolved = Suite.model_validate(load(LOOPED, FILED).canonical())
    with pytest.raises(ConfigError, match=r"motion mine-2 is a file .*load the suite from its own"):
        resolved.motion("head")
