"""WebXR for vrbench: the headset's own browser opens a page, and the page streams its poses.

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
    """The route `webxr`."""
    from vrbench_webxr.route import HEADSET

    return [HEADSET]
