"""What a computer evaluates with: computers that share work must agree in it."""

from __future__ import annotations

import sys
from collections.abc import Mapping

from vrbench import __version__
from vrbench.sources import vrbench_digest


def build() -> dict[str, str]:
    """Versions, by name, of all that decides about a number's last digit but the processor."""
    import numpy
    import scipy

    return {
        "vrbench": f"{__version__} ({vrbench_digest()[:12]})",
        "python": f"{sys.version_info.major}.{sys.version_info.minor}",
        "numpy": numpy.__version__,
        "scipy": scipy.__version__,
    }


def differences(here: Mapping[str, str], there: Mapping[str, str]) -> list[str]:
    """What another computer has otherwise, a text for each."""
    return [
        f"{name} {there.get(name, 'is missing')}, here {stated}"
        for name, stated in here.items()
        if there.get(name) != stated
    ]
