"""Conformance: tests that every plugin passes; inherit the class of its kind, and say its name.

    from vrbench.plugin.testing import HeadsetConformance

    class TestPico4(HeadsetConformance):
        name = "pico4"

`vrbench plugin check NAME` runs the same tests.
"""

from vrbench.plugin.testing.files import ImporterConformance
from vrbench.plugin.testing.headsets import (
    HeadsetConformance,
    HeadsetModelConformance,
    MocapConformance,
)
from vrbench.plugin.testing.metrics import MetricConformance
from vrbench.plugin.testing.robots import RobotConformance
from vrbench.plugin.testing.suites import SuiteConformance
from vrbench.plugin.testing.verdicts import NonconformityError, NotCheckedError

__all__ = [
    "HeadsetConformance",
    "HeadsetModelConformance",
    "ImporterConformance",
    "MetricConformance",
    "MocapConformance",
    "NonconformityError",
    "NotCheckedError",
    "RobotConformance",
    "SuiteConformance",
]
