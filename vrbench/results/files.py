"""Files of a bundle: that they lie in it, what they hold, how they are written."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from stat import S_ISDIR, S_ISREG

from vrbench.errors import DataError


def inside(folder: Path, name: str) -> Path:
    """The path of a file of a bundle.

    Raises:
        DataError: the name, or a link on the way, leads out of the bundle.
    """
    path = folder / name
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


def replace_text(path: Path, text: str) -> None:
    """Writes a file so that it is, at any moment, the old one or the new one."""
    part = path.with_name(path.name + ".part")
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def file_digest(path: Path) -> str:
    """sha256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
