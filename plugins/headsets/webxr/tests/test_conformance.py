"""What every headset plugin passes: `vrbench plugin check webxr` runs the same."""

from vrbench.plugin.testing import HeadsetConformance


class TestRoute(HeadsetConformance):
    name = "webxr"
