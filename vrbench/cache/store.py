"""Entries of the cache: files by key, whole or not there, checked when they are read.

It is the user's own folder: `VRBENCH_CACHE`, or where the system keeps caches. An entry is written
beside its place and moved there, so that processes may share it; the longest unused ones go when
all together pass `VRBENCH_CACHE_GB`.
"""

from __future__ import annotations

import hashlib
import json
import mmap
import os
import struct
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from vrbench.cache.packing import Arrays
from vrbench.errors import ConfigError

FOLDER, GIGABYTES = "VRBENCH_CACHE", "VRBENCH_CACHE_GB"
USUAL_GB = 4.0
MAGIC = b"vrbench cache 1\n"
_LENGTH = struct.Struct("<Q")
DIGEST_BYTES = 32
ALIGNED = 64
PIECE = 1 << 20
SUFFIX = ".entry"


def warn(text: str) -> None:
    """Tells whoever runs this."""
    sys.stderr.write(f"warning: {text}\n")


class Store:
    """A folder of entries.

    Args:
        folder: where they are; made when the first is written.
        cap: bytes that they may have together.
        tell: told of what is wrong with them.
    """

    def __init__(self, folder: Path, cap: int, tell: Callable[[str], None] = warn) -> None:
        self.folder, self.cap = folder, cap
        self._tell = tell
        self._broken = False

    @classmethod
    def usual(cls) -> Store:
        """The user's.

        Raises:
            ConfigError: `VRBENCH_CACHE_GB` is no size.
        """
        from platformdirs import user_cache_path

        named = os.environ.get(FOLDER)
        folder = Path(named) if named else user_cache_path("vrbench") / "evaluate"
        text = os.environ.get(GIGABYTES) or str(USUAL_GB)
        try:
            size = float(text)
            if not 0.0 <= size < 1e6:
                raise ValueError
        except ValueError:
            fix = "how many GB the cache may have, such as 4"
            raise ConfigError(f"{text!r} is no size", field=GIGABYTES, fix=fix) from None
        return cls(folder, int(size * 1e9))

    def get(self, key: str) -> tuple[Any, Sequence[npt.NDArray[Any]]] | None:
        """An entry's tree and arrays; None where there is none, or a damaged one, which is told."""
        path = self._path(key)
        try:
            with path.open("rb") as file:
                found = _read(file)
            os.utime(path)
        except OSError:
            return None
        except (ValueError, KeyError, TypeError, struct.error) as error:
            self.drop(key, error)
            return None
        return found

    def drop(self, key: str, error: Exception) -> None:
        """Removes an entry that can't be used, and says so."""
        path = self._path(key)
        self._tell(f"{path}: the cache's entry is damaged, computed anew ({error})")
        with suppress(OSError):
            path.unlink()

    def put(self, key: str, tree: Any, arrays: Arrays) -> None:
        """Writes an entry; where that can't be, it is told once and nothing is written any more."""
        if self._broken or sum(array.nbytes for array in arrays) > self.cap // 2:
            return
        path = self._path(key)
        try:
            if not self.folder.exists():
                self.folder.mkdir(parents=True, mode=0o700)
            path.parent.mkdir(exist_ok=True)
            with NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as file:
                try:
                    _write(file, tree, arrays)
                    file.close()
                    Path(file.name).replace(path)
                except BaseException:
                    Path(file.name).unlink(missing_ok=True)
                    raise
        except OSError as error:
            self._broken = True
            self._tell(f"{self.folder}: the cache can't be written: {error.strerror or error}")

    def trim(self) -> None:
        """Removes the longest unused entries, until the rest keeps to the cap."""
        entries = []
        for path in self.folder.glob(f"*/*{SUFFIX}"):
            with suppress(OSError):
                stat = path.stat()
                entries.append((stat.st_mtime_ns, stat.st_size, path))
        total = sum(size for _, size, _ in entries)
        for _, size, path in sorted(entries):
            if total <= self.cap:
                break
            with suppress(OSError):  # another process removed it, or Windows has it open
                path.unlink()
            total -= size

    def _path(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key}{SUFFIX}"


def _write(file: Any, tree: Any, arrays: Arrays) -> None:
    """Magic, length of the head, the head, every array on a multiple of 64 bytes, sha256."""
    layout, at = [], 0
    for array in arrays:
        layout.append([array.dtype.str, array.shape, at])
        at += -(-array.nbytes // ALIGNED) * ALIGNED
    head = json.dumps({"tree": tree, "arrays": layout, "bytes": at}).encode()
    head += b" " * (-(len(MAGIC) + _LENGTH.size + len(head)) % ALIGNED)
    digest = hashlib.sha256()

    def write(content: bytes | memoryview) -> None:
        digest.update(content)
        file.write(content)

    write(MAGIC + _LENGTH.pack(len(head)) + head)
    for array in arrays:
        write(array.reshape(-1).view(np.uint8).data if array.size else b"")
        write(bytes(-array.nbytes % ALIGNED))
    file.write(digest.digest())


def _read(file: BinaryIO) -> tuple[Any, list[npt.NDArray[Any]]]:
    """An entry's tree, and its arrays as they lie in the file, which is read as they are used."""
    end = file.seek(-DIGEST_BYTES, os.SEEK_END) if file.seek(0, os.SEEK_END) > DIGEST_BYTES else 0
    if end < len(MAGIC) + _LENGTH.size:
        raise ValueError("it is cut short")
    stated = file.read()
    file.seek(0)
    digest = hashlib.sha256()
    for at in range(0, end, PIECE):
        digest.update(file.read(min(PIECE, end - at)))
    if digest.digest() != stated:
        raise ValueError("its sha256 differs")
    content = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    start = len(MAGIC) + _LENGTH.size
    if content[: len(MAGIC)] != MAGIC:
        raise ValueError("it is no entry")
    (length,) = _LENGTH.unpack(content[len(MAGIC) : start])
    head = json.loads(content[start : start + length])
    first = start + length
    arrays = []
    for kind, shape, at in head["arrays"]:
        count = int(np.prod(shape, dtype=np.int64))
        flat = np.frombuffer(content, np.dtype(kind), count, first + at)
        arrays.append(flat.reshape(shape))
    return head["tree"], arrays
