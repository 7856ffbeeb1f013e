"""Files of a bundle: that they lie in it, and what they hold; folders for what is made of it."""

from __future__ import annotations

import hashlib
import os
from itertools import accumulate
from pathlib import Path, PurePath
from stat import S_ISDIR, S_ISREG

from vrbench.errors import ConfigError, DataError


def inside(folder: Path, name: str) -> Path:
    """The path of a file of a bundle.

    Raises:
        DataError: the name, or a link on the way, leads out of the bundle.
    """
    below = PurePath(name)
    path, steps = folder / below, accumulate(below.parts, os.path.join, initial=os.fspath(folder))
    # what has no links below the folder stays in it; but Windows has junctions
    plain = not below.anchor and ".." not in below.parts and os.name != "nt"
    if not plain or any(map(os.path.islink, [*steps][1:])):
        real, root = os.path.realpath(path), os.path.realpath(folder)
        if os.path.commonpath((real, root)) != root:
            raise DataError(
                "leads out of the bundle", file=path, fix="a bundle holds its own files, no links"
            )
    return path


def file_size(path: Path) -> int:
    """How many bytes a file has.

    Raises:
        DataError: a pipe or a device stands there, which could be read for ever.
    """
    found = path.stat()
    if not (S_ISREG(found.st_mode) or S_ISDIR(found.st_mode)):
        raise DataError("is no file", file=path, fix="a bundle holds files and folders only")
    return found.st_size


def file_digest(path: Path) -> str:
    """sha256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def new_folder(path: Path) -> None:
    """Makes a folder, or takes an empty one.

    Raises:
        ConfigError: it can't be made, or holds files.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        empty = not any(path.iterdir())
    except OSError as error:
        raise ConfigError("can't be made", file=path, field="-o", fix=str(error)) from None
    if not empty:
        raise ConfigError("holds files already", file=path, field="-o", fix="name a new folder")
