"""What every robot plugin passes; the UR5e moved on its emulator."""

import sys

import pytest

from vrbench.plugin.testing import RobotConformance

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="ur-rtde's wheels are Linux's")


class TestUr5e(RobotConformance):
    name = "ur5e"
