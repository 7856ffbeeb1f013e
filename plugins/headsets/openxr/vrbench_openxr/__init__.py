"""PC headsets for vrbench through OpenXR: profiles, and a route that needs no graphics.

Only the hook stands here; what it returns is imported when it is called, so that listing plugins
stays quick.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from vrbench.plugin import hookimpl

if TYPE_CHECKING:
    from vrbench.devices.specs import HeadsetSpec


@hookimpl
def vrbench_headsets() -> Sequence[HeadsetSpec]:
    """Index, Vive, Varjo, Windows MR, PS VR2, Monado; the route `openxr`."""
    from vrbench_openxr.profiles import HEADSETS
    from vrbench_openxr.route import HEADSET

    return [*HEADSETS, HEADSET]
