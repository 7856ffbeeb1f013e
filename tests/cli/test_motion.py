"""`vrbench motion`: what can be replayed; planning itself is the robot plugin's."""

import pytest
from click.testing import CliRunner

from vrbench.cli.motion import command
from vrbench.errors import ConfigError, DataError
from vrbench.motion.generators import GENERATORS, generate
from vrbench.trajectory import write_tum


def run(*words):
    done = CliRunner().invoke(command, words, catch_exceptions=True)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done.output


def test_every_generated_motion_is_listed_with_its_digest():
    told = run("list")
    for name in GENERATORS:
        assert name in told
        assert generate(name).digest[:12] in told


def test_a_motion_is_shown_by_name_and_by_file(tmp_path):
    assert "120.000 s" in run("show", "shooter-1")
    path = tmp_path / "head.tum"
    write_tum(generate("saturate-30s-1").trajectory, path)
    assert "30.000 s" in run("show", str(path))


@pytest.mark.parametrize("word", ["nothing-1"])
def test_an_unknown_motion_names_those_there_are(word):
    with pytest.raises(ConfigError, match="shooter-1"):
        run("show", word)


def test_a_file_that_is_not_there():
    with pytest.raises(DataError, match="can't be read"):
        run("show", "nowhere.tum")


def test_plan_wants_a_rig_or_a_robot():
    for words in ((), ("--rig", "sim", "--robot", "sim")):
        with pytest.raises(ConfigError, match="--rig RIG or --robot"):
            run("plan", "shooter-1", *words)


@pytest.mark.parametrize("word", ["nan", "inf", "-inf", "0.5", "slow"])
@pytest.mark.parametrize(
    "words",
    [
        ("plan", "shooter-1", "--stretch"),
        ("extract", "run", "--start"),
        ("extract", "run", "--end"),
    ],
)
def test_a_number_that_is_none_is_refused(words, word):
    if words[0] == "extract" and word == "0.5":
        word = "-0.5"
    told = run(*words, word)
    assert f"Invalid value for '{words[-1]}'" in told
    assert "Traceback" not in told


def test_the_simulated_robot_needs_no_plan():
    with pytest.raises(ConfigError, match="does every motion"):
        run("plan", "shooter-1", "--rig", "sim")


def test_a_motion_file_with_a_header_is_read_as_one(tmp_path):
    path = tmp_path / "head.tum"
    header = "# motion: nod\n# version: 2\n# up: y\n# rate_hz: 120\n# source: generated\n"
    write_tum(generate("saturate-30s-1").trajectory, path)
    path.write_text(header + path.read_text(encoding="utf-8"), encoding="utf-8")
    assert run("show", str(path)).startswith("nod-2")


def test_every_verb_of_motion_is_there():
    assert set(command.commands) == {"list", "show", "plan", "extract", "calibration"}
