"""How large a take is once it is unpacked, by its summary alone."""

from __future__ import annotations

from pathlib import Path

# Of a take without a summary, which was cut short: how well its like are packed.
PACKED = 4


def unpacked_bytes(path: Path) -> int:
    """The bytes of a take's chunks, unpacked; an estimate where it has no summary."""
    from mcap.reader import make_reader

    try:
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
    except Exception:  # a damaged file can raise anything; who reads it tells
        summary = None
    if summary is None or not summary.chunk_indexes:
        return PACKED * path.stat().st_size
    return sum(chunk.uncompressed_size for chunk in summary.chunk_indexes)
