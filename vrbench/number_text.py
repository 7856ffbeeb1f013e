"""Text that is nothing but numbers, a fixed count a line, as one array: quickly, and to the digit.

Numbers in JSON are read by pydantic's parser some three times as fast as by `float`, and rounded
just the same. Text, JSON and the list of numbers of one piece stay in the processor's cache; larger
pieces take up to half as much again.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vrbench.geometry import Floats

CHUNK_BYTES = 1 << 16
BOM = b"\xef\xbb\xbf"
_OF_NUMBERS = b"0123456789+-.eE\r"
_TO_JSON = bytes.maketrans(b" \n\r", b",, ")


def read_plain(path: Path, columns: int) -> Floats | None:
    """The numbers (n, columns) of a plain text; None where it isn't plain, or isn't numbers at all.

    Plain are lines of so many numbers, single spaces between them, below any lines of comment.

    Raises:
        OSError: the file can't be read.
    """
    parts: list[Floats] = []
    with path.open("rb") as file:
        rest = _below_comments(file.read(CHUNK_BYTES))
        while chunk := rest + file.read(CHUNK_BYTES):
            end = chunk.rfind(b"\n") + 1 or len(chunk)
            part = _numbers(chunk[:end], columns)
            if part is None:
                return None
            parts.append(part)
            rest = chunk[end:]
    return np.concatenate(parts) if parts else None


def _below_comments(chunk: bytes) -> bytes:
    chunk = chunk.removeprefix(BOM)
    while chunk.startswith(b"#"):
        chunk = chunk.partition(b"\n")[2]
    return chunk


def _numbers(lines: bytes, columns: int) -> Floats | None:
    from pydantic_core import from_json

    lines = lines.removesuffix(b"\n")
    line = b" " * (columns - 1) + b"\n"
    between = lines.translate(None, _OF_NUMBERS) + b"\n"
    rows = len(between) // columns
    # also no strings, no true, no null
    if between != line * rows:
        return None
    try:
        numbers = from_json(b"[" + lines.translate(_TO_JSON) + b"]", allow_inf_nan=False)
        return np.fromiter(numbers, np.float64, rows * columns).reshape(-1, columns)
    except (ValueError, TypeError, OverflowError):
        return None
