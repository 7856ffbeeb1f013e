"""How much a take may unpack to: what others hand in isn't unpacked beyond it."""

from __future__ import annotations

from typing import Any
from zlib import crc32

# Ours unpack to half a megabyte a chunk, and two hours of every stream to less than a gigabyte.
MAX_CHUNK_BYTES = 64 << 20
MAX_TAKE_BYTES = 4 << 30
# Poses shrink to a third; a stream that stands still, to a hundredth.
MAX_RATIO = 1000
SMALL_BYTES = 1 << 20


class Unpacking:
    """Unpacks the chunks of one take, and keeps count."""

    def __init__(self) -> None:
        self._total = 0
        self._zstd: Any = None

    def __call__(self, compression: str, records: bytes, stated: int, checksum: int) -> bytes:
        """The chunk's records.

        Args:
            compression: `zstd`, `lz4` or nothing,
            records: packed by it,
            stated: how many bytes they are said to unpack to,
            checksum: CRC-32 of those; 0 for none.

        Raises:
            ValueError: it is larger than it says or than a cap, damaged, or packed in another way.
        """
        self._total += stated
        if stated > MAX_CHUNK_BYTES:
            raise ValueError(f"a chunk of {stated} bytes, and {MAX_CHUNK_BYTES} are allowed")
        if self._total > MAX_TAKE_BYTES:
            raise ValueError(f"it unpacks to more than the {MAX_TAKE_BYTES} bytes that are allowed")
        if stated > SMALL_BYTES and stated > MAX_RATIO * len(records):
            raise ValueError(f"a chunk unpacks to over {MAX_RATIO} times its size")
        data = self._unpack(compression, records, stated)
        if len(data) != stated:
            raise ValueError(f"a chunk doesn't unpack to the {stated} bytes that it states")
        if checksum and crc32(data) != checksum:
            raise ValueError("a chunk's checksum doesn't fit")
        return data

    def _unpack(self, compression: str, data: bytes, stated: int) -> bytes:
        """One byte more than is stated, at most."""
        if compression == "zstd":
            if self._zstd is None:
                import zstandard

                self._zstd = zstandard.ZstdDecompressor()
            return bytes(self._zstd.stream_reader(data).read(stated + 1))
        if compression == "lz4":
            import lz4.frame

            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=stated + 1))
        if compression:
            raise ValueError(f"chunks are packed by {compression!r}, not by zstd or lz4")
        return data
