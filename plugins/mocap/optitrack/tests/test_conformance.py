"""What every plugin of motion capture passes: `vrbench plugin check optitrack` runs the same."""

from vrbench.plugin.testing import ImporterConformance, MocapConformance


class TestLive(MocapConformance):
    name = "optitrack"


class TestMotiveCsv(ImporterConformance):
    name = "motive-csv"
