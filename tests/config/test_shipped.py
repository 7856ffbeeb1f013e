import pytest

from vrbench.config.case import OPENING
from vrbench.config.recordings import load_recordings
from vrbench.config.shipped import find_file, shipped_files
from vrbench.config.suite import load_suite
from vrbench.errors import ConfigError
from vrbench.metrics.registry import builtin_families
from vrbench.motion.generators import GENERATORS

SUITES, RECORDINGS = shipped_files("suites"), shipped_files("recordings")


def test_suites_and_recordings_come_along():
    assert {"calibration", "gameplay-replay"} <= set(SUITES)
    assert {"banaszczyk2024-quest-2", "banaszczyk2024-quest-pro"} <= set(RECORDINGS)


@pytest.mark.parametrize("name", SUITES)
def test_every_suite_loads_under_the_name_of_its_file(name):
    suite = load_suite(name)
    assert suite.suite == name
    assert load_suite(suite.label).digest == suite.digest


@pytest.mark.parametrize("name", SUITES)
def test_every_suite_names_motions_and_metrics_that_there_are(name):
    suite = load_suite(name)
    families = {family.name for family in builtin_families()}
    if suite.mover == "robot":  # a person moves as they like
        assert set(suite.motions.values()) <= set(GENERATORS)
    assert set(suite.metrics) <= families
    assert suite.rank.metric.partition(".")[0] in suite.metrics


@pytest.mark.parametrize("name", SUITES)
def test_every_suite_uses_each_of_its_motions(name):
    suite = load_suite(name)
    opening = {OPENING} if any(case.looped for case in suite.all_cases()) else set()
    assert {case.motion for case in suite.cases} | opening == set(suite.motions)


@pytest.mark.parametrize("name", RECORDINGS)
def test_all_recordings_load_and_their_cases_are_the_suites(name):
    recordings = load_recordings(RECORDINGS[name])
    suite = load_suite(recordings.suite)
    assert {take.case for take in recordings.takes} <= {case.id for case in suite.cases}


def test_a_file_is_found_by_path_by_name_and_among_others(tmp_path):
    mine = tmp_path / "mine.yaml"
    mine.write_text("")
    assert find_file("suites", str(mine)) == mine
    assert find_file("suites", "mine", {"mine": mine}) == mine
    assert find_file("suites", "calibration", {"mine": mine}) == SUITES["calibration"]


def test_what_is_not_there_lists_what_is(tmp_path):
    with pytest.raises(ConfigError, match=r"no recordings file or name is 'mine' .*quest-2"):
        find_file("recordings", "mine")
    with pytest.raises(ConfigError, match=r"mine\.yaml: no such file .*quest-2"):
        find_file("recordings", str(tmp_path / "mine.yaml"))
