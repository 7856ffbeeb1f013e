"""Which code this is: digests of source files, so that two versions of it are told apart."""

from __future__ import annotations

import ast
import hashlib
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path

PACKAGE = Path(__file__).parent
NAME = PACKAGE.name


def vrbench_digest() -> str:
    """sha256 over all of vrbench's own code."""
    return digest_of(_tree(PACKAGE, "*.py"))


def digest_of(files: Iterable[Path]) -> str:
    """sha256 over files, each under its name and its folder's; where these lie doesn't matter."""
    total = hashlib.sha256()
    names = {path: f"{path.parent.name}/{path.name}" for path in files}
    for line in sorted(f"{name}\0{_digest_of_file(path)}\n" for path, name in names.items()):
        total.update(line.encode())
    return total.hexdigest()


def code_of(modules: Iterable[str]) -> set[Path]:
    """The files of modules and of all that these import, however far down.

    Of vrbench it is each module alone; of another package, a plugin's, all that lies in its folder,
    data too. What is installed for good is left out: it is known by its version. Imports are read
    from the source, so that those within functions count; what is imported by a computed name
    isn't seen.

    Raises:
        FileNotFoundError: a module has no file.
    """
    files: set[Path] = set()
    wanted = set(modules)
    waiting, seen = list(wanted), set[str]()
    while waiting:
        module = waiting.pop()
        top = module.partition(".")[0]
        unit = module if top == NAME else top
        if unit in seen or unit in sys.stdlib_module_names:
            continue
        seen.add(unit)
        own = [_file_of(module)] if top == NAME else _files_of(top, wanted=module in wanted)
        files.update(own)
        for path in own:
            if path.suffix == ".py":
                waiting += _imports(path)
    return files


def _file_of(module: str) -> Path:
    """The file of a module of vrbench, or of what holds the name that was imported."""
    place = PACKAGE.joinpath(*module.split(".")[1:])
    for path in (place.with_suffix(".py"), place / "__init__.py"):
        if path.is_file():
            return path
    return _file_of(module.rpartition(".")[0])


def _files_of(package: str, *, wanted: bool) -> list[Path]:
    """All files of a package of others; none where it is installed for good, unless wanted."""
    try:
        spec = find_spec(package)
    except (ImportError, ValueError):
        spec = None
    if spec is None or spec.origin in (None, "built-in", "frozen"):
        if wanted:
            raise FileNotFoundError(package)
        return []
    assert spec.origin is not None
    file = Path(spec.origin)
    installed = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    if not wanted and any(file.is_relative_to(place) for place in installed):
        return []
    return list(_tree(file.parent, "*")) if spec.submodule_search_locations else [file]


def _tree(folder: Path, pattern: str) -> Iterator[Path]:
    return (p for p in folder.rglob(pattern) if p.is_file() and p.parent.name != "__pycache__")


@cache
def _digest_of_file(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@cache
def _imports(path: Path) -> tuple[str, ...]:
    """The modules, or names in modules, that a file imports."""
    found = []
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:  # else of the same package
            found += [f"{node.module}.{alias.name}" for alias in node.names]
    return tuple(found)
