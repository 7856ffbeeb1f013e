"""Conformance of suites: their files are right, and what they name is there."""

from __future__ import annotations

from vrbench.config.shipped import shipped_files
from vrbench.config.suite import Suite, load_suite
from vrbench.plugin.manager import families_of
from vrbench.plugin.testing.offered import Offered
from vrbench.plugin.testing.verdicts import require


class SuiteConformance(Offered):
    """What a suite is held to."""

    kind = "suite"

    def _suite(self) -> Suite:
        return load_suite(str(self.thing()), dict(self.plugins().suites))

    def test_the_file_is_right(self) -> None:
        """The file is a suite, and named as the suite is."""
        suite = self._suite()
        require(
            suite.suite == self.name,
            f"the file {self.thing().name} holds the suite {suite.suite!r}",
            f"Name the file {suite.suite}.yaml.",
        )
        require(suite.title.strip(), "it has no title", "Say in `title` what is done.")

    def test_it_takes_no_shipped_name(self) -> None:
        """Its name is its own: two suites of one name can't both be ranked."""
        shipped = shipped_files("suites").get(self.name)
        require(
            shipped in (None, self.thing()),
            f"{self.name} is the name of a suite that comes with vrbench",
            "Give it another, and extend that one.",
        )

    def test_its_metrics_are_there(self) -> None:
        """Every metric that it names is installed, and so is the one it ranks by."""
        families_of(self._suite(), self.plugins(), str(self.thing()))

    def test_its_motions_are_there(self) -> None:
        """Every motion that it names can be made."""
        suite = self._suite()
        if suite.mover == "robot":
            for name in suite.motions:
                suite.motion(name)

    def test_its_schedule_is_the_same_every_time(self) -> None:
        """What is recorded, and in which order, is the same in every lab."""
        first = [step.name for step in self._suite().schedule()]
        require(
            first and first == [step.name for step in self._suite().schedule()],
            "its schedule is empty, or differs from time to time",
            "Give it cases.",
        )
        require(
            len(set(first)) == len(first), "two takes of it have one name", "Give cases ids each."
        )
