"""What a bad metric family, suite or robot does is told."""

from types import SimpleNamespace

import numpy as np
import pytest

from vrbench.metrics.registry import Family, Value
from vrbench.plugin.manager import Plugins
from vrbench.plugin.testing import MetricConformance, NonconformityError, SuiteConformance


def outcomes(base, made, called):
    class Made(base):
        name = called

        @classmethod
        def thing(cls):
            return made

        def test_registering_imports_no_vendor_sdk(self):
            pass

        def test_its_plugin_is_whole(self):
            pass

    return {x.check: x for x in Made.run() if x.status == "failed"}


def path_mm(take):
    steps = np.diff(take.estimate.pose.p, axis=0)
    yield Value("path.length", "value", 1e3 * float(np.linalg.norm(steps, axis=1).sum()), "mm", 9)


def family(of_take=path_mm, unit="mm"):
    return Family("path", "How far the eye goes", {"path.length": unit}, of_take)


def of(**fields):
    told = {"metric": "path.length", "statistic": "value", "value": 1.0, "unit": "mm"}
    return lambda take: [Value(**{**told, "samples": 9, **fields})]


def chance(take):
    yield Value("path.length", "value", float(np.random.default_rng().normal()), "mm", 9)


def scribble(take):
    take.truth.p[0] = 0.0
    return []


FAULTS = {
    "a unit of its own": (family(of(unit="furlong"), "furlong"), "furlong"),
    "another unit than declared": (family(of(unit="deg")), "comes in 'deg', declared is 'mm'"),
    "a metric that it doesn't declare": (family(of(metric="path.width")), "declared is None"),
    "a statistic nobody knows": (family(of(statistic="modus")), "statistic 'modus'"),
    "no number": (family(of(value=float("nan"))), "is nan"),
    "no number and no reason": (family(of(value=None)), "no number and no reason"),
    "plain numbers": (family(lambda take: [1.0]), "yields a float"),
    "chance": (family(chance), "the same take gives other values"),
    "notes in the take": (family(scribble), "writes into the take"),
    "an error of its own": (family(lambda take: 1 / 0), "raises ZeroDivisionError"),
    "nothing to compute": (family(None), "computes nothing"),
}


def test_a_sound_family_passes():
    assert outcomes(MetricConformance, family(), "path") == {}


@pytest.mark.parametrize("how", FAULTS)
def test_a_family_with(how):
    made, says = FAULTS[how]
    found = outcomes(MetricConformance, made, "path")
    assert says in " ".join(x.what for x in found.values())
    assert all(x.fix for x in found.values())


SUITES = {
    "another name than its file's": ("suite: other", "holds the suite 'other'"),
    "a metric that isn't there": ("suite: mine\nmetrics: [ape, none]", "no metric is called"),
    "a motion that isn't there": ("suite: mine\nmotions: {head: none, calibration: none}", "none"),
}


@pytest.mark.parametrize("how", SUITES)
def test_a_suite_with(how, tmp_path):
    text, says = SUITES[how]
    path = tmp_path / "mine.yaml"
    path.write_text(f"{text}\nversion: 1\ntitle: Mine\nextends: gameplay-replay@1\n")
    found = outcomes(SuiteConformance, path, "mine")
    assert says in " ".join(x.what for x in found.values())


def test_a_sound_suite_passes_and_a_shipped_name_is_taken(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("suite: mine\nversion: 1\ntitle: Mine\nextends: gameplay-replay@1\n")
    assert outcomes(SuiteConformance, path, "mine") == {}
    with pytest.raises(NonconformityError, match="comes with vrbench"):
        taken = type("Taken", (SuiteConformance,), {"name": "long-loop"})
        taken.thing = classmethod(lambda cls: path)
        taken.plugins = classmethod(lambda cls: SimpleNamespace(suites=Plugins().suites))
        taken().test_it_takes_no_shipped_name()
