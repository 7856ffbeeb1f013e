"""Finds plugins by entry point and loads them one by one: a broken one breaks nothing else."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import pluggy
from pydantic import BaseModel

from vrbench import __version__
from vrbench.config.yaml_file import load_yaml, located, validate
from vrbench.errors import ConfigError
from vrbench.plugin import builtin, hookspecs
from vrbench.plugin.offers import Spec, offered_by_hook, place_of, told, unmarked

if TYPE_CHECKING:
    from vrbench.config.suite import Suite
    from vrbench.devices.specs import HeadsetSpec, MocapSpec, RobotSpec
    from vrbench.metrics.registry import Family
    from vrbench.recording.importer import Importer

GROUP = "vrbench"
# Names of the plugins to load, separated by commas; none where it is empty.
NARROW = "VRBENCH_PLUGINS"
BUILTIN = "builtin"
# What plugins offer, by the attribute of `Plugins` that holds it.
KINDS = {
    "headset": "headsets",
    "mocap": "mocap",
    "robot": "robots",
    "importer": "importers",
    "metric": "metrics",
    "suite": "suites",
}


Options = TypeVar("Options", bound=BaseModel)


@dataclass(frozen=True, slots=True)
class PluginInfo:
    """A plugin as it was found.

    Attributes:
        name: of its entry point.
        version: of its distribution.
        distribution: the name to install it by.
        broken: why it couldn't be loaded, or which of its hooks gave nothing and why; None for a
            sound one.
    """

    name: str
    version: str
    distribution: str
    broken: str | None = None


class Plugins:
    """All that plugins offer, by name.

    Plugins are imported at once; a hook is called when what it returns is first asked for. A hook
    that fails offers nothing, and its plugin's other hooks still count.
    """

    def __init__(self) -> None:
        self._manager = pluggy.PluginManager(GROUP)
        self._manager.add_hookspecs(hookspecs)
        self._manager.register(builtin, BUILTIN)
        self._infos = [PluginInfo(BUILTIN, __version__, "vrbench")]
        # where in _infos each loaded plugin stands: two may bear one name, but one is loaded
        self._loaded = {BUILTIN: 0}
        self._offers: dict[tuple[str, str], str] = {}
        self._passed_by: dict[tuple[str, str], list[str]] = {}
        wanted = os.environ.get(NARROW)
        for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
            if wanted is None or entry.name in wanted.split(","):
                self._infos.append(self._load(entry))

    @property
    def infos(self) -> Sequence[PluginInfo]:
        """Every plugin found, sound or broken, the built-in one first. Calls every hook."""
        for hook in vars(hookspecs):
            if hook.startswith("vrbench_"):
                getattr(self, hook.removeprefix("vrbench_"))
        return tuple(self._infos)

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
                    f"is made for plugin API {wanted!r}, this vrbench has {hookspecs.PLUGIN_API}: "
                    "install versions that match"
                )
            elif self._manager.has_plugin(entry.name):
                broken = f"another plugin is called {entry.name!r} too: remove one of them"
            else:
                self._register(module, entry.name)
                self._loaded[entry.name] = len(self._infos)
                broken = unmarked(module)
        except KeyboardInterrupt:  # Ctrl-C, as far as anyone can tell
            raise
        except pluggy.PluginValidationError as error:
            broken = " ".join(str(error).split())
        except BaseException as error:  # a plugin may raise anything
            broken = (
                f"{type(error).__name__}: {error}{place_of(error)}"
                f" (mend it, or: pip install --force-reinstall {name})"
            )
        return PluginInfo(entry.name, version, name, broken)

    def _register(self, module: Any, name: str) -> None:
        """Registers a plugin whole or, where a hook is not as hookspecs.py has it, not at all."""
        try:
            self._manager.register(module, name)
            self._manager.check_pending()
        except pluggy.PluginValidationError:
            self._manager.unregister(name=name)
            raise

    def _named(self, hook: str, kind: type[Spec]) -> dict[str, Spec]:
        """What one hook of all plugins returns, by name.

        The first plugin to take a name has it; the other's is passed by, and nothing else of it.
        """
        found: dict[str, Spec] = {}
        for impl in getattr(self._manager.hook, hook).get_hookimpls():
            try:
                offered = offered_by_hook(impl, kind)
            except KeyboardInterrupt:
                raise
            except BaseException as error:  # a plugin may raise anything
                if impl.plugin is builtin:
                    raise
                self._blame(impl.plugin_name, f"{hook} {told(error)}")
                continue
            for name, thing in offered.items():
                place = hook.removeprefix("vrbench_"), name
                if name not in found:
                    found[name] = thing
                    self._offers[place] = impl.plugin_name
                    continue
                self._passed_by.setdefault(place, []).append(impl.plugin_name)
                self._blame(
                    impl.plugin_name,
                    f"{hook} offers {name!r}, and that name is taken by {self._offers[place]}: "
                    "rename it, or uninstall one",
                )
        return found

    def _blame(self, name: str, reason: str) -> None:
        index = self._loaded[name]
        info = self._infos[index]
        reasons = f"{info.broken}; {reason}" if info.broken else reason
        self._infos[index] = replace(info, broken=reasons)

    @cached_property
    def headsets(self) -> Mapping[str, HeadsetSpec]:
        from vrbench.devices.specs import HeadsetSpec

        return self._named("vrbench_headsets", HeadsetSpec)

    @cached_property
    def mocap(self) -> Mapping[str, MocapSpec]:
        from vrbench.devices.specs import MocapSpec

        return self._named("vrbench_mocap", MocapSpec)

    @cached_property
    def robots(self) -> Mapping[str, RobotSpec]:
        from vrbench.devices.specs import RobotSpec

        return self._named("vrbench_robots", RobotSpec)

    @cached_property
    def importers(self) -> Mapping[str, Importer]:
        from vrbench.recording.importer import Importer

        return self._named("vrbench_importers", Importer)

    @cached_property
    def metrics(self) -> Mapping[str, Family]:
        from vrbench.metrics.registry import Family

        return self._named("vrbench_metrics", Family)

    @cached_property
    def suites(self) -> Mapping[str, Path]:
        return self._named("vrbench_suites", Path)

    def things(self, kind: str) -> Mapping[str, Any]:
        """What is offered of a kind, by name; `KINDS` are the kinds."""
        things: Mapping[str, Any] = getattr(self, KINDS[kind])
        return things

    def offered_by(self, kind: str, name: str) -> PluginInfo:
        """The plugin that offers the thing of this kind and name.

        Raises:
            KeyError: nobody does.
        """
        self.things(kind)
        return self._infos[self._loaded[self._offers[KINDS[kind], name]]]

    def passed_by(self, kind: str, name: str) -> Sequence[str]:
        """Plugins that offer something of this kind and name too, and came too late."""
        self.things(kind)
        return tuple(self._passed_by.get((KINDS[kind], name), ()))

    def versions(self) -> dict[str, str]:
        """Versions of the loaded plugins' distributions."""
        infos = (self._infos[index] for index in self._loaded.values())
        return {info.distribution: info.version for info in infos}


def pick(things: Mapping[str, Spec], name: str, what: str, *, field: str, file: str | None) -> Spec:
    """The thing of this name.

    Raises:
        ConfigError: nothing has the name; says what there is.
    """
    if name not in things:
        known = ", ".join(sorted(things)) or "none"
        raise ConfigError(
            f"no {what} is called {name!r}",
            file=None if file is None else located(file, field),
            field=field,
            fix=f"there are {known}; `vrbench plugin list` tells of broken plugins",
        )
    return things[name]


def check_options(
    options: Mapping[str, Any],
    model: type[Options],
    *,
    field: str,
    file: str | None,
    beside: Collection[str] = (),
) -> Options:
    """A device's or format's options, validated by its plugin's own model.

    Those named in `beside` stand in the file beside `field`, not in it.

    Raises:
        ConfigError: an option is unknown, missing or wrong.
    """
    if file is None or not Path(file).is_file():
        return validate(dict(options), model, f"{file}: {field}" if file else field)
    under = [int(part) if part.isdecimal() else part for part in field.split(".")]
    return validate(dict(options), model, file, load_yaml(Path(file))[1], under, beside)


def titles(things: Mapping[str, Any]) -> Sequence[tuple[str, str]]:
    """Name and title of each thing."""
    return [(name, getattr(thing, "title", "")) for name, thing in things.items()]


def families_of(suite: Suite, plugins: Plugins, file: str | None) -> list[Family]:
    """The metric families that a suite asks for.

    Raises:
        ConfigError: there is no such family, or none of them has the metric it ranks by.
    """
    families = [
        pick(plugins.metrics, name, "metric", field=f"metrics.{index}", file=file)
        for index, name in enumerate(suite.metrics)
    ]
    metrics = {metric for family in families for metric in family.units}
    if suite.rank.metric not in metrics:
        raise ConfigError(
            f"the suite ranks by {suite.rank.metric!r}, which none of its metrics gives",
            file=None if file is None else located(file, "rank.metric"),
            field="rank.metric",
            fix=f"they give {', '.join(sorted(metrics))}",
        )
    return families
