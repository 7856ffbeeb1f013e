"""What a plugin's hook returns, taken in or refused, and what is said of one that fails."""

from __future__ import annotations

import os
import traceback
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Protocol, TypeVar

import pluggy
from pluggy import HookImpl

from vrbench.plugin import hookspecs

OURS = f"{Path(__file__).parents[1]}{os.sep}"
PLUGGY = f"{Path(pluggy.__file__ or '').parent}{os.sep}"


class _Named(Protocol):
    @property
    def name(self) -> str: ...


Spec = TypeVar("Spec", bound=_Named)


class UnfitError(Exception):
    """What a hook returned can't be used."""


def offered_by_hook(impl: HookImpl, kind: type[Spec]) -> dict[str, Spec]:
    """What one plugin's hook returns, by name: all of it, or an error."""
    returned: object = impl.function()
    if isinstance(returned, str) or not isinstance(returned, Iterable):
        raise UnfitError(f"returns {_kind(returned)}: it must return a list of {kind.__name__}")
    offered: dict[str, Spec] = {}
    for thing in returned:
        if not isinstance(thing, kind):
            raise UnfitError(f"offers {_kind(thing)}: it must return a list of {kind.__name__}")
        if isinstance(thing, Path) and not thing.is_file():
            raise UnfitError(f"offers {thing}, which is no file")
        key = thing.stem if isinstance(thing, Path) else thing.name
        if not isinstance(key, str) or not isinstance(getattr(thing, "title", ""), str):
            raise UnfitError(f"offers {key!r}: names and titles are text")
        if key in offered:
            raise UnfitError(f"offers {key!r} twice")
        offered[key] = thing
    return offered


def _kind(thing: object) -> str:
    return "None" if thing is None else f"a {type(thing).__name__}"


def told(error: BaseException) -> str:
    """What is said of a hook that raised this."""
    if isinstance(error, UnfitError):
        return str(error)
    return f"raises {type(error).__name__}: {error}{place_of(error)}"


def place_of(error: BaseException) -> str:
    """The last line of a plugin's that an error came through."""
    frames = traceback.extract_tb(error.__traceback__)
    theirs = [at for at in frames if not at.filename.startswith(("<", OURS, PLUGGY))]
    theirs = [at for at in theirs if "importlib" not in at.filename]
    return f", at {theirs[-1].filename}:{theirs[-1].lineno}" if theirs else ""


def unmarked(module: Any) -> str | None:
    """What is wrong with a module whose functions are named as hooks, and aren't marked so."""
    hooks = [name for name in vars(hookspecs) if name.startswith("vrbench_")]
    bare = [
        name
        for name in hooks
        if callable(found := getattr(module, name, None)) and not hasattr(found, "vrbench_impl")
    ]
    return f"{', '.join(bare)} lacks @hookimpl, and is never called" if bare else None
