"""What a bad importer does is told: above all when it takes one convention for another."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

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


def outcomes(made, sample):
    formats = {each.name: each for each in builtin_importers()} | {made.name: made}

    class Format(ImporterConformance):
        name = made.name
        recordings = sample

        @classmethod
        def plugins(cls):
            return SimpleNamespace(importers=formats)

        @classmethod
        def thing(cls):
            return made

        def test_registering_imports_no_vendor_sdk(self):
            pass

    return {outcome.check: outcome for outcome in Format.run()}


def failed(found):
    return {name: x for name, x in found.items() if x.status == "failed"}


def test_a_sound_importer_passes(sample):
    assert {x.status for x in outcomes(importer(), sample).values()} == {"passed"}


@pytest.mark.parametrize(
    ("axes", "says"),
    [
        (OPENXR, "doesn't fit the robot beside it|differs from the robot"),
        (ROS, "doesn't fit the robot beside it|differs from the robot"),
        # a proper rotation of both sides fits any reference: gravity tells
        (Axes("z", "x", "left"), "y axis is 90 deg off the robot's up"),
        (replace(UNITY, unit_m=0.01), "doesn't fit the robot beside it|differs from the robot"),
    ],
    ids=["mirrored", "ros", "z up", "centimetres"],
)
def test_one_that_takes_its_axes_for_others_is_told_by_the_reference(axes, says, sample):
    found = failed(outcomes(importer(axes), sample))
    assert list(found) == ["known_twist"]
    assert re.search(says, found["known_twist"].what), found["known_twist"].what
    assert "Axes(" in found["known_twist"].fix


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
    assert "returns a list" in found["stamps_go_forward"].what


def test_without_recordings_what_needs_them_is_not_checked():
    found = outcomes(Importer("log", "Log", careless), None)
    assert found["known_twist"].status == "not checked"
    assert "--recordings" in found["known_twist"].fix
