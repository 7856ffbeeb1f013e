"""How much a take may unpack to: what others hand in isn't unpacked beyond it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from zlib import crc32

if TYPE_CHECKING:
    from mcap.records import Chunk

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

    def __call__(self, chunk: Chunk) -> bytes:
        """The chunk's records.

        Raises:
            ValueError: it is larger than it says or than a cap, damaged, or packed in another way.
        """
        stated, packed = chunk.uncompressed_size, len(chunk.data)
        self._total += stated
        if stated > MAX_CHUNK_BYTES:
            raise ValueError(f"a chunk of {stated} bytes, and {MAX_CHUNK_BYTES} are allowed")
        if self._total > MAX_TAKE_BYTES:
            raise ValueError(f"it unpacks to more than the {MAX_TAKE_BYTES} bytes that are allowed")
        if stated > SMALL_BYTES and stated > MAX_RATIO * packed:
            raise ValueError(f"a chunk unpacks to over {MAX_RATIO} times its size")
        data = _unpack(chunk.compression, chunk.data, stated)
        if len(data) != stated:
            raise ValueError(f"a chunk doesn't unpack to the {stated} bytes that it states")
        if chunk.uncompressed_crc and crc32(data) != chunk.uncompressed_crc:
            raise ValueError("a chunk's checksum doesn't fit")
        return data


def _unpack(compression: str, data: bytes, stated: int) -> bytes:
    """One byte more than is stated, at most."""
    if compression == "zstd":
        import zstandard

        unpacked: Any = zstandard.ZstdDecompressor().stream_reader(data).read(stated + 1)
        return bytes(unpacked)
    if compression == "lz4":
        import lz4.frame

        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=stated + 1))
    if compression:
        raise ValueError(f"chunks are packed by {compression!r}, not by zstd or lz4")
    return data
