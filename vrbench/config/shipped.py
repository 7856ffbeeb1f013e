"""Files that come with vrbench: suites, recordings and published results, found by name."""

from __future__ import annotations

from pathlib import Path

from vrbench.errors import ConfigError

_PACKAGE = Path(__file__).parents[1]


def shipped_folder(kind: str) -> Path:
    """The folder of a kind, `suites` say: in the wheel, or beside the package of a checkout."""
    inside = _PACKAGE / kind
    return inside if inside.is_dir() else _PACKAGE.parent / kind


def shipped_files(kind: str) -> dict[str, Path]:
    """Shipped files of a kind, by name."""
    return {path.stem: path for path in sorted(shipped_folder(kind).glob("*.yaml"))}


def find_file(
    kind: str, name: str, others: dict[str, Path] | None = None, beside: Path | None = None
) -> Path:
    """A file by its path, or by its name among the shipped ones and `others`.

    Args:
        kind: `suites` or `recordings`.
        name: the path or the name.
        others: files of plugins, by name.
        beside: the folder that a relative path starts from; the working directory where None.

    Raises:
        ConfigError: neither a file nor a known name.
    """
    known = {**shipped_files(kind), **(others or {})}
    if name in known:
        return known[name]
    fix = f"a path to a .yaml file, or {', '.join(known)}"
    path = (beside or Path()) / name
    if path.suffix in (".yaml", ".yml") or path.is_file():
        if path.is_file():
            return path
        raise ConfigError("no such file", file=path, fix=fix)
    raise ConfigError(f"no {kind} file or name is {name!r}", fix=fix)
