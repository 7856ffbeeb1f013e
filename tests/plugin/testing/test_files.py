"""What a bad importer does is told: above all when it takes one convention for another."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from vrbench.devices.specs import HeadsetProfile, HeadsetSpec
from vrbench.geometry import OPENXR, ROS, UNITY, Axes, Transform
from vrbench.plugin.sample import write_sample
from vrbench.plugin.scaffold import TEMPLATE
from vrbench.plugin.testing import ImporterConformance
from vrbench.recording.importer import Imported, Importer
from vrbench.recording.importers import builtin_importers

CODE = (TEMPLATE / "importer" / "module.py.in").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sample")
    write_sample("importer", "log", folder, "gameplay-replay")
    return folder / "recordings.yaml"


def importer(read_as=UNITY, **changes):
    """The importer of a new plugin; its sample is written in Unity's axes."""
    module: dict[str, object] = {}
    code = CODE.replace("$name", "log").replace("$title", "Log").replace("$module", "log")
    exec(compile(code, "log", "exec"), module)
    module["AXES"] = read_as
    return replace(module["vrbench_importers"]()[0], **changes)


def outcomes(made, sample, headsets=None):
    """Of every check of an importer; the sample names a headset that is simulated."""
    formats = {each.name: each for each in builtin_importers()} | {made.name: made}

    class Format(ImporterConformance):
        name = made.name
        recordings = sample

        @classmethod
        def plugins(cls):
            return SimpleNamespace(importers=formats, things=lambda _: headsets or {})

        @classmethod
        def thing(cls):
            return made

        def test_registering_imports_no_vendor_sdk(self):
            pass

        def test_its_plugin_is_whole(self):
            pass

    return {outcome.check: outcome for outcome in Format.run()}


def failed(found):
    return {name: x for name, x in found.items() if x.status == "failed"}


def test_a_sound_importer_passes(sample):
    found = outcomes(importer(), sample)
    assert {x.status for x in found.values()} == {"passed"}


@pytest.mark.parametrize(
    ("axes", "says"),
    [
        (OPENXR, "doesn't fit the robot beside it|differs from the robot"),
        (ROS, "doesn't fit the robot beside it|differs from the robot"),
        # a proper rotation of both sides fits any reference: gravity tells
        (Axes("z", "x", "left"), "y axis is 90 deg off the robot's up"),
        (replace(UNITY, unit_m=0.01), "it fits if its positions are 100 times too small"),
        (replace(UNITY, unit_m=10.0), "it fits if its positions are 10 times too large"),
        (replace(UNITY, unit_m=100.0), "it fits if its positions are in cm"),
    ],
    ids=["mirrored", "ros", "z up", "centimetres", "tens of metres", "not from centimetres"],
)
def test_one_that_takes_its_axes_for_others_is_told_by_the_reference(axes, says, sample):
    found = failed(outcomes(importer(axes), sample))
    assert list(found) == ["known_twist"]
    assert re.search(says, found["known_twist"].what), found["known_twist"].what
    assert "Axes(" in found["known_twist"].fix


def spoilt(change, **replaced):
    """The importer with another `parse`; made of its own row."""
    code = CODE.replace("$name", "log").replace("$title", "Log").replace("$module", "log")
    module: dict[str, object] = {}
    exec(compile(code, "log", "exec"), module)
    parse = module["parse"]
    module["parse"] = lambda line: change(*parse(line))
    return module["vrbench_importers"]()[0]


@pytest.mark.parametrize(
    ("change", "check", "says"),
    [
        (
            lambda t, pose, *more: (t, [*pose[:3], pose[6], *pose[3:6]], *more),
            "known_twist",
            "order w x y z, and were read as x y z w",
        ),
        (
            lambda t, *more: (t // 1000, *more),
            "known_twist",
            "and 31 s passed: microseconds were taken for nanoseconds",
        ),
        (
            lambda t, *more: ((t - 1_699_999_990 * 10**9) * 1000, *more),
            "known_twist",
            "nanoseconds were taken for microseconds",
        ),
        (
            lambda t, pose, *more: (t, [*pose[:3], *(2.0 * x for x in pose[3:])], *more),
            "samples_are_read",
            "has length 2",
        ),
    ],
    ids=["w first", "microseconds", "times a thousand", "not of unit length"],
)
def test_a_mistake_in_a_line_is_named(change, check, says, sample):
    found = failed(outcomes(spoilt(change), sample))
    assert list(found) == [check]
    assert says in found[check].what


@pytest.mark.parametrize(("declared", "fails"), [(72.0, False), (90.0, True), (None, None)])
def test_a_log_has_the_rate_that_its_model_declares(declared, fails, sample, monkeypatch):
    import yaml

    content = yaml.safe_load(sample.read_text())
    content["device"]["headset"] = "pico4"
    path = sample.with_name("of-pico4.yaml")
    path.write_text(yaml.safe_dump(content))
    specs = {"pico4": HeadsetSpec("pico4", "Pico 4", HeadsetProfile(declared))}
    found = outcomes(importer(), path, specs if declared else {})["the_rate_is_the_models"]
    assert (found.status == "failed") == bool(fails)
    if fails:
        assert "poses a second, 90 declared" in found.what


def test_a_log_that_tells_of_recentres_is_read_with_its_epochs(sample, tmp_path):
    lines = (sample.parent / "replay-1.headset.csv").read_text().splitlines()
    half = len(lines) // 2
    lines[half:] = [line[: line.rindex(",")] + ",1" for line in lines[half:]]
    lines[half + 5] = lines[half + 5].replace(",1,1", ",0,1")
    log = tmp_path / "log.csv"
    log.write_text("\n".join(lines) + "\n")
    made = importer()
    samples = made.read(log, made.options()).samples
    assert len(samples) == len(lines) - 1
    assert np.flatnonzero(np.diff(samples.epoch.astype(int))).tolist() == [half - 2]
    assert not samples.good[half + 4]


def careless(path, _options):
    """Reads anything, and nothing with care."""
    rows = [[float(x) for x in line.split(",")] for line in path.read_text().splitlines()[1:]]
    numbers = np.array(rows)
    t = numbers[:, 0].astype(np.int64) * 1000
    pose = UNITY.to_openxr(Transform(numbers[:, 1:4], 2.0 * numbers[:, 4:8]))
    from vrbench.streams import Samples

    return Imported(Samples.of(t, pose))


def test_one_that_checks_nothing_is_told_what_it_lets_pass(sample):
    found = failed(outcomes(importer(read=careless), sample))
    assert "raises" not in found
    assert {
        "what_is_no_such_file_is_refused",
        "a_file_cut_short_is_told",
        "quaternions_are_of_unit_length",
    } <= set(found)
    assert "DataError" in found["what_is_no_such_file_is_refused"].fix


def test_one_that_returns_something_else_is_told(sample):
    found = failed(outcomes(importer(read=lambda *_: [1, 2]), sample))
    assert list(found) == ["samples_are_read", "what_is_no_such_file_is_refused"]
    assert "returns a list" in found["samples_are_read"].what


def test_without_recordings_what_needs_them_is_not_checked():
    found = outcomes(Importer("log", "Log", careless), None)
    assert found["known_twist"].status == "not checked"
    assert "--recordings" in found["known_twist"].fix
