"""One process at a time is at work in a run's folder: a lock that ends with who holds it."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from vrbench.errors import ConfigError
from vrbench.results.bundle import LOCK

if sys.platform == "win32":
    import msvcrt

    # past what is written there, which others may read
    FAR = 1 << 20

    def _lock(file: BinaryIO) -> None:
        file.seek(FAR)
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        file.seek(0)

else:
    import fcntl

    def _lock(file: BinaryIO) -> None:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Holds a run's folder; what has to be made for it goes again if nothing came into it.

    A lock file alone means nothing: what counts is whether a living process holds it, so that after
    a crash nobody has to remove anything.

    Raises:
        ConfigError: another process is at work in it, or it can't be made.
    """
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError("can't be made", file=folder, field="-o", fix=str(error)) from None
    path = folder / LOCK
    while True:
        file = path.open("a+b")
        try:
            _lock(file)
        except OSError:
            file.seek(0)
            owner = file.read(20).decode(errors="replace").strip()
            file.close()
            raise ConfigError(
                f"process {owner or '?'} is at work in this folder",
                file=folder,
                fix="let it finish, or name another folder",
            ) from None
        if _same(file, path):
            break
        file.close()  # its last owner removed it in between
    try:
        file.seek(0)
        file.truncate()
        file.write(str(os.getpid()).encode())
        file.flush()
        yield
    finally:
        if sys.platform != "win32":
            path.unlink(missing_ok=True)
        file.close()
        if sys.platform == "win32":
            path.unlink(missing_ok=True)
        with suppress(OSError):  # it isn't empty: a run stands there
            for empty in made:
                empty.rmdir()


def _same(file: BinaryIO, path: Path) -> bool:
    """Whether the open file is the one that stands there."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False
