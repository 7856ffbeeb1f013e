"""The motions that a suite names: generated ones by name, files by their content."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from vrbench.errors import ConfigError
from vrbench.motion.files import read_motion
from vrbench.motion.generators import generate
from vrbench.motion.motion import Motion

SUFFIXES = (".tum", ".txt")


def is_file(value: str) -> bool:
    """Whether a suite means a file by this, and not a generator."""
    return "/" in value or "\\" in value or value.endswith(SUFFIXES)


def identity(path: Path, where: str, field: str) -> str:
    """What stands for a motion file in a resolved suite: its name, and the digest of its content.

    Args:
        path: of the file.
        where: the suite's file and line, for messages,
        field: and its field.

    Raises:
        ConfigError: no such file, or its header is wrong.
        DataError: its rows are wrong.
    """
    if not path.is_file():
        raise ConfigError(
            f"no motion file is at {path}",
            file=where,
            field=field,
            fix="a path from the suite's folder, or the name of a generated motion",
        )
    motion = read_motion(path)
    return f"{motion.name} sha256:{motion.digest}"


def motion_of(value: str, files: Mapping[str, Path]) -> Motion:
    """The motion that a resolved suite names.

    Args:
        value: a generator's name, or what `identity` gave.
        files: where those files are.

    Raises:
        ConfigError: no generator has the name, or the file isn't known here, or has changed.
        DataError: the file's rows are wrong.
    """
    name, _, digest = value.partition(" sha256:")
    if not digest:
        return generate(name)
    if value not in files:
        raise ConfigError(
            f"motion {name} is a file that this suite was resolved from",
            field="motions",
            fix="load the suite from its own file",
        )
    motion = read_motion(files[value])
    if motion.digest != digest:
        raise ConfigError("has changed since the suite was loaded", file=files[value])
    return motion
