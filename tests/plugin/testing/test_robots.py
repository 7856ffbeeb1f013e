"""What a bad robot does is told, each fault by its own check."""

from dataclasses import replace

import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict

from vrbench.devices.ports import Plan
from vrbench.devices.specs import RobotSpec
from vrbench.errors import ConfigError
from vrbench.geometry import Transform
from vrbench.plugin.testing import RobotConformance
from vrbench.plugin.testing.robots import Moved, nod
from vrbench.streams import Samples
from vrbench.trajectory import NS

BEGUN = 1_700_000_000 * NS


class Options(BaseModel):
    model_config = ConfigDict(extra="forbid")


SPEC = RobotSpec("crx", "CRX", print, 100.0, Options, real=True)


def moved():
    """What comes of a robot that does all as it should, 80 ms late."""
    target = nod().mapped(lambda m: Transform.of((0.4, 0.1, 0.5), (0.0, 0.0, 0.0, 1.0)) @ m)
    t = np.arange(0, 2.5, 0.01)
    late = np.clip(np.rint((t - 0.08) * NS).astype(np.int64), 0, target.t[-1])
    stamps = BEGUN + np.rint(t * NS).astype(np.int64)
    samples = Samples.of(stamps, target.at(late))
    return Moved(
        options={},
        plan=Plan(target, "a"),
        again=("a", "b"),
        refused=ConfigError("dry run"),
        samples=samples,
        begun=BEGUN,
        rested=samples[-30:],
        closed_again=None,
    )


def failed(found):
    class Robot(RobotConformance):
        name = "crx"

        @classmethod
        def moved(cls):
            return found

        @classmethod
        def thing(cls):
            return SPEC

        def test_opening_without_a_device_fails_cleanly(self):
            pass

        def test_registering_imports_no_vendor_sdk(self):
            pass

        def test_its_plugin_is_whole(self):
            pass

    return {x.check: x for x in Robot.run() if x.status != "passed"}


def test_a_sound_robot_passes_every_check():
    assert failed(moved()) == {}


def posed(change):
    found = moved()
    return {"samples": replace(found.samples, pose=change(found.samples.pose))}


FAULTS = {
    "moves without leave": (
        lambda: {"refused": None},
        "what_nobody_allowed_is_refused",
        "it moves without leave",
    ),
    "refuses with an error of Python's": (
        lambda: {"refused": RuntimeError("no")},
        "what_nobody_allowed_is_refused",
        "RuntimeError",
    ),
    "has another hash every time": (
        lambda: {"again": ("c", "b")},
        "planning_again_gives_the_same_hash",
        "two hashes",
    ),
    "has one hash for all": (
        lambda: {"again": ("a", "a")},
        "planning_again_gives_the_same_hash",
        "two motions have one",
    ),
    "goes on moving": (
        lambda: {"rested": moved().samples[60:120]},
        "closed_early_it_stops",
        "still moves",
    ),
    "tells millimetres": (
        lambda: posed(lambda pose: Transform(1e3 * pose.p, pose.q)),
        "known_twist",
        "off its plan",
    ),
    "tells another frame": (
        lambda: posed(lambda pose: Transform(pose.p[:, [1, 0, 2]], pose.q)),
        "known_twist",
        "off its plan",
    ),
    "sends a tenth of what it says": (
        lambda: {"samples": moved().samples[::10]},
        "rate_is_as_declared",
        "10 poses a second, 100 declared",
    ),
}


@pytest.mark.parametrize("how", FAULTS)
def test_a_robot_that(how):
    changes, check, says = FAULTS[how]
    found = failed(replace(moved(), **changes()))
    assert list(found) == [check]
    assert says in found[check].what
    assert found[check].fix
