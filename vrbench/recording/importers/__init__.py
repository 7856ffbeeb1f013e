"""Built-in importers: each module holds one format's `IMPORTER`."""

from __future__ import annotations

import importlib
import pkgutil
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vrbench.recording.importer import Importer


def builtin_importers() -> list[Importer]:
    """The `IMPORTER` of each module in here, by name."""
    modules = (
        importlib.import_module(f"{__name__}.{info.name}")
        for info in pkgutil.iter_modules(__path__)
    )
    return sorted((module.IMPORTER for module in modules), key=lambda importer: importer.name)
