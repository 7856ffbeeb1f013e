"""Which protocols there are: the `PROTOCOL` of each module here that has one."""

from __future__ import annotations

import importlib
import pkgutil

from vrbench import protocols
from vrbench.errors import ConfigError
from vrbench.protocols.protocol import Protocol


def builtin_protocols() -> list[Protocol]:
    """The protocols of `vrbench.protocols`, by name."""
    modules = (
        importlib.import_module(f"{protocols.__name__}.{info.name}")
        for info in pkgutil.iter_modules(protocols.__path__)
    )
    found = [module.PROTOCOL for module in modules if hasattr(module, "PROTOCOL")]
    return sorted(found, key=lambda protocol: protocol.name)


def find_protocol(name: str) -> Protocol:
    """The protocol of this name.

    Raises:
        ConfigError: there is none; says which there are.
    """
    known = {protocol.name: protocol for protocol in builtin_protocols()}
    if name not in known:
        raise ConfigError(
            f"no protocol is called {name!r}",
            field="--protocol",
            fix=f"there are {', '.join(known)}",
        )
    return known[name]
