"""Finds plugins by entry point and loads them one by one: a broken one breaks nothing else."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import pluggy
from pydantic import BaseModel

from vrbench import __version__
from vrbench.config.yaml_file import validate
from vrbench.errors import ConfigError
from vrbench.plugin import builtin, hookspecs

if TYPE_CHECKING:
    from vrbench.devices.ports import HeadsetSpec, MocapSpec, RobotSpec
    from vrbench.metrics.registry import Family
    from vrbench.recording.importer import Importer

GROUP = "vrbench"
# Names of the plugins to load, separated by commas; none where it is empty.
NARROW = "VRBENCH_PLUGINS"
BUILTIN = "builtin"


class _Named(Protocol):
    @property
    def name(self) -> str: ...


Spec = TypeVar("Spec", bound=_Named)
Options = TypeVar("Options", bound=BaseModel)


@dataclass(frozen=True, slots=True)
class PluginInfo:
    """A plugin as it was found.

    Attributes:
        name: of its entry point.
        version: of its distribution.
        distribution: the name to install it by.
        broken: why it couldn't be loaded; None for a sound one.
    """

    name: str
    version: str
    distribution: str
    broken: str | None = None


class Plugins:
    """All that plugins offer, by name.

    Attributes:
        infos: every plugin found, sound or broken, the built-in one first.
    """

    def __init__(self) -> None:
        self._manager = pluggy.PluginManager(GROUP)
        self._manager.add_hookspecs(hookspecs)
        self._manager.register(builtin, BUILTIN)
        self.infos = [PluginInfo(BUILTIN, __version__, "vrbench")]
        wanted = os.environ.get(NARROW)
        for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
            if wanted is None or entry.name in wanted.split(","):
                self.infos.append(self._load(entry))

    def _load(self, entry: EntryPoint) -> PluginInfo:
        """Registers one plugin; whatever it raises is its reason, and nobody else's trouble."""
        name = entry.dist.name if entry.dist else "?"
        version = entry.dist.version if entry.dist else "?"
        broken: str | None = None
        try:
            module = entry.load()
            wanted = getattr(module, "PLUGIN_API", hookspecs.PLUGIN_API)
            if wanted != hookspecs.PLUGIN_API:
                broken = (
                    f"is made for plugin API {wanted}, this vrbench has {hookspecs.PLUGIN_API}: "
                    "install versions that match"
                )
            elif self._manager.has_plugin(entry.name):
                broken = f"another plugin is called {entry.name!r} too: remove one of them"
            else:
                self._manager.register(module, entry.name)
        except (KeyboardInterrupt, SystemExit) as error:
            broken = f"raises {type(error).__name__} when imported"
        except Exception as error:  # a plugin may raise anything
            broken = f"{type(error).__name__}: {error} (pip install --force-reinstall {name})"
        return PluginInfo(entry.name, version, name, broken)

    def _named(self, hook: str) -> dict[str, Any]:
        """What one hook of all plugins returns, by name; the first plugin to take a name has it."""
        found: dict[str, Any] = {}
        for plugin_name, plugin in self._manager.list_name_plugin():
            function = getattr(plugin, hook, None)
            if function is None:
                continue
            for thing in function():
                key = thing.stem if isinstance(thing, Path) else thing.name
                if key in found:
                    raise ConfigError(
                        f"{hook}: two plugins offer {key!r}, the second is {plugin_name}",
                        fix="uninstall one of them",
                    )
                found[key] = thing
        return found

    @cached_property
    def headsets(self) -> Mapping[str, HeadsetSpec]:
        return self._named("vrbench_headsets")

    @cached_property
    def mocap(self) -> Mapping[str, MocapSpec]:
        return self._named("vrbench_mocap")

    @cached_property
    def robots(self) -> Mapping[str, RobotSpec]:
        return self._named("vrbench_robots")

    @cached_property
    def importers(self) -> Mapping[str, Importer]:
        return self._named("vrbench_importers")

    @cached_property
    def metrics(self) -> Mapping[str, Family]:
        return self._named("vrbench_metrics")

    @cached_property
    def suites(self) -> Mapping[str, Path]:
        return self._named("vrbench_suites")

    def versions(self) -> dict[str, str]:
        """Versions of the sound plugins' distributions."""
        return {info.distribution: info.version for info in self.infos if not info.broken}


def pick(things: Mapping[str, Spec], name: str, what: str, *, field: str, file: str | None) -> Spec:
    """The thing of this name.

    Raises:
        ConfigError: nothing has the name; says what there is.
    """
    if name not in things:
        known = ", ".join(sorted(things)) or "none"
        raise ConfigError(
            f"no {what} is called {name!r}",
            file=file,
            field=field,
            fix=f"there are {known}; `vrbench plugin list` tells of broken plugins",
        )
    return things[name]


def check_options(
    options: Mapping[str, Any], model: type[Options], *, field: str, file: str | None
) -> Options:
    """A device's or format's options, validated by its plugin's own model.

    Raises:
        ConfigError: an option is unknown, missing or wrong.
    """
    return validate(dict(options), model, f"{file}: {field}" if file else field)


def titles(things: Mapping[str, Any]) -> Sequence[tuple[str, str]]:
    """Name and title of each thing."""
    return [(name, getattr(thing, "title", "")) for name, thing in things.items()]
