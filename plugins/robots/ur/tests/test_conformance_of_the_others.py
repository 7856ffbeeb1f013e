"""What every robot plugin passes; the UR3e and the UR10e moved a little on their emulators."""

import sys

import pytest

from vrbench.plugin.testing import RobotConformance
from vrbench.plugin.testing.robots import nod

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="ur-rtde's wheels are Linux's")


class TestUr3e(RobotConformance):
    name = "ur3e"
    motion = nod(1.0)


class TestUr10e(RobotConformance):
    name = "ur10e"
    motion = nod(1.0)
