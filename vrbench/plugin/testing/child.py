"""Checks that need a process of their own: what registering imports, and opening with no device."""

from __future__ import annotations

import importlib.metadata
import json
import os
import re
import site
import subprocess
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from vrbench.errors import VrbenchError
from vrbench.plugin.manager import GROUP, NARROW, Plugins
from vrbench.plugin.testing.verdicts import NonconformityError, require

# A device that isn't there must be told as soon; its own patience is an option of the stand-in's.
PATIENCE_S = 30.0


@cache
def check_registration(plugin: str) -> None:
    """That importing a plugin and calling its hooks loads no vendor's SDK.

    Raises:
        NonconformityError: it does, or it can't be imported.
    """
    told = _ask("imports", plugin, patience_s=60.0)
    require(
        not told["loaded"],
        f"registering {plugin} imports {', '.join(told['loaded'])}",
        "Import a vendor's SDK inside the function that opens the device, so that listing plugins "
        "is quick and works where the SDK isn't.",
    )


def check_without_device(kind: str, name: str, options: Mapping[str, Any]) -> None:
    """That opening a device that isn't there ends in one clear error, and soon.

    Raises:
        NonconformityError: it hangs, raises something else, or doesn't say what to do.
    """
    where = "Raise vrbench.errors.DeviceError(what, fix=what to do) from __enter__ or start"
    try:
        told = _ask("open", kind, name, json.dumps(dict(options)), patience_s=PATIENCE_S)
    except subprocess.TimeoutExpired:
        raise NonconformityError(
            f"with no device, opening {name} hangs: nothing came of it in {PATIENCE_S:g} s",
            f"Give every wait a timeout. {where}.",
        ) from None
    require(
        told["how"] != "opened",
        f"with no device, {name} opens and starts all the same",
        f"{where}.",
    )
    require(
        told["how"] == "refused",
        f"with no device, {name} raises {told.get('error')}: {told.get('what')}",
        f"{where}, so that a user reads a sentence and no traceback.",
    )
    require(
        told.get("fix"),
        f"with no device, {name} says {told.get('what')!r} and not what to do",
        "Give the DeviceError a `fix`.",
    )


def _ask(*words: str, patience_s: float) -> dict[str, Any]:
    """What a child says, as JSON, in its last line."""
    done = subprocess.run(
        [sys.executable, "-m", __name__, *words],
        capture_output=True,
        text=True,
        timeout=patience_s,
        check=False,
        stdin=subprocess.DEVNULL,
    )
    lines = done.stdout.strip().splitlines()
    if done.returncode != 0 or not lines:
        last = (done.stderr.strip().splitlines() or ["it says nothing"])[-1]
        raise NonconformityError(
            f"a process that was to try it ended with code {done.returncode}: {last}",
            "Try it by hand: " + " ".join(["python -m", __name__, *words]),
        )
    told: dict[str, Any] = json.loads(lines[-1])
    return told


# In the child.


def _imports(plugin: str) -> dict[str, Any]:
    """The distributions that registering a plugin loads, and which aren't vrbench's own."""
    os.environ[NARROW] = ""
    before = Plugins()
    _all_of(before)
    known = set(sys.modules)
    os.environ[NARROW] = plugin
    found = [info for info in _all_of(Plugins()) if info.name == plugin]
    modules = {e.module for e in importlib.metadata.entry_points(group=GROUP)}
    own = {"vrbench", *(module.partition(".")[0] for module in modules)}
    allowed = set(_needed_by("vrbench")) | {_key(info.distribution) for info in found}
    dists = importlib.metadata.packages_distributions()
    tops = {name.partition(".")[0] for name in set(sys.modules) - known}
    foreign = set[str]()
    for top in tops - own - set(sys.stdlib_module_names):
        if top in dists:
            foreign |= {dist for dist in dists[top] if _key(dist) not in allowed}
        elif not top.startswith("_") and not _beside(top, own):
            foreign.add(top)
    return {"loaded": sorted(foreign)}


def _beside(top: str, own: set[str]) -> bool:
    """Whether a module of no distribution is the plugin's own: in its folder, or in none at all.

    Libraries without metadata are copied into site-packages, or lie on PYTHONPATH.
    """
    folder = _folder(top)
    shared = {Path(path) for path in (*site.getsitepackages(), sysconfig.get_path("purelib"))}
    return folder is None or (folder not in shared and folder in {_folder(name) for name in own})


def _folder(top: str) -> Path | None:
    """The folder that a module or package lies in; None for what has no file."""
    file = getattr(sys.modules.get(top), "__file__", None)
    if file is None:
        return None
    path = Path(file)
    return path.parent.parent if path.stem == "__init__" else path.parent


def _all_of(plugins: Plugins) -> Any:
    """Calls every hook, and reads every metric's module."""
    return plugins.infos


def _needed_by(distribution: str, seen: frozenset[str] = frozenset()) -> Iterator[str]:
    """A distribution and all that it requires, without extras."""
    key = _key(distribution)
    if key in seen:
        return
    yield key
    try:
        requirements = importlib.metadata.requires(distribution) or []
    except importlib.metadata.PackageNotFoundError:
        return
    for requirement in requirements:
        if "extra ==" not in requirement:
            name = re.split(r"[^A-Za-z0-9._-]", requirement, maxsplit=1)[0]
            yield from _needed_by(name, seen | {key})


def _key(distribution: str) -> str:
    return re.sub(r"[-_.]+", "-", distribution).lower()


def _open(kind: str, name: str, options: str) -> dict[str, Any]:
    """What comes of opening and starting a device."""
    from vrbench.plugin.testing.opening import opened

    try:
        spec = Plugins().things(kind)[name]
        with opened(kind, spec, spec.options.model_validate(json.loads(options))) as source:
            source.start("conformance")
            source.stop()
    except VrbenchError as error:
        return {"how": "refused", "what": error.what, "fix": error.fix or ""}
    except Exception as error:  # a plugin may raise anything
        return {"how": "raised", "error": type(error).__name__, "what": str(error)}
    return {"how": "opened"}


def main() -> None:
    """Does what the arguments say, and prints what came of it."""
    what, *words = sys.argv[1:]
    told = _imports(*words) if what == "imports" else _open(*words)
    sys.stdout.write("\n" + json.dumps(told) + "\n")
    sys.stdout.flush()
    # threads of a device that was not closed don't keep a child alive
    os._exit(0)


if __name__ == "__main__":
    main()
