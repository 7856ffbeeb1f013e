"""The messages of an MCAP file, by topic, as whole columns of bytes: no object per message."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import SEEK_CUR, BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from vrbench.errors import DataError
from vrbench.geometry import Ints
from vrbench.recording.caps import Unpacking

Bytes = npt.NDArray[np.uint8]

# What stands before a message's data in its record: MCAP's opcode 5, little-endian, packed.
_HEAD = np.dtype([("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")])
_RECORD = struct.Struct("<BQ")
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _METADATA = 2, 3, 4, 5, 6, 12
MAGIC = b"\x89MCAP0\r\n"
# What ends the name of a file that is still written, or that nothing could end.
PART = ".part"


@dataclass(slots=True)
class Messages:
    """The messages of one topic, in the order of the file.

    Attributes:
        topic: the topic,
        schema: and the name of its type.
    """

    topic: str
    schema: str
    _log: list[Ints] = field(default_factory=list)
    _lengths: list[Ints] = field(default_factory=list)
    _data: list[Bytes] = field(default_factory=list)

    def append(self, log: Ints, lengths: Ints, data: Bytes) -> None:
        """Adds messages with log times (n,) and lengths (n,); data holds them end to end."""
        self._log.append(log)
        self._lengths.append(lengths)
        self._data.append(data)

    def __len__(self) -> int:
        return sum(map(len, self._log))

    @property
    def log_t(self) -> Ints:
        """Log times (n,) [ns]."""
        return np.concatenate(self._log)

    @property
    def first(self) -> bytes:
        """The first message."""
        return self._data[0][: self._lengths[0][0]].tobytes()

    def rows(self, layout: np.dtype[Any]) -> npt.NDArray[Any]:
        """All messages as one structured array (n,).

        Raises:
            DataError: a message has another size than the layout.
        """
        odd = [int(n) for part in self._lengths for n in np.unique(part) if n != layout.itemsize]
        if odd:
            raise DataError(
                f"messages of {odd[0]} bytes among those of {layout.itemsize}",
                field=self.topic,
                fix="names and frame of a topic stay the same throughout a take",
            )
        return np.concatenate(self._data).view(layout)

    def __iter__(self) -> Iterator[bytes]:
        for lengths, data in zip(self._lengths, self._data, strict=True):
            raw, at = data.tobytes(), 0
            for length in lengths.tolist():
                yield raw[at : at + length]
                at += length


def read_messages(path: Path, metadata: str) -> tuple[list[Messages], dict[str, str]]:
    """All messages by topic, and the metadata records of one name as one mapping.

    A file called `.part` may end anywhere: its complete chunks are read.

    Raises:
        DataError: no such file, or not a whole MCAP file.
    """
    reading = _Reading(metadata)
    cut = path.suffix == PART
    try:
        with path.open("rb") as file:
            whole = reading.file(file)
    except FileNotFoundError:
        raise DataError("no such take", file=path) from None
    except Exception as error:  # a damaged file can raise anything in its reader
        if not (cut and reading.begun):
            raise _damaged(path, str(error) or type(error).__name__) from error
        whole = False
    if not whole and not (cut and reading.begun):
        raise _damaged(path, "it ends early")
    return [m for m in reading.by_channel.values() if len(m)], reading.facts


def _damaged(path: Path, why: str) -> DataError:
    return DataError("is not a whole MCAP file", file=path, fix=f"record or import it again; {why}")


class _Reading:
    """What has been read so far."""

    def __init__(self, metadata: str) -> None:
        self.by_channel: dict[int, Messages] = {}
        self.facts: dict[str, str] = {}
        self.begun = False
        self._metadata = metadata
        self._unpack = Unpacking()
        self._schemas: dict[int, str] = {}

    def file(self, file: BinaryIO) -> bool:
        """Reads chunks and metadata, in order; whether the file is there to its end.

        Everything else, the indexes above all, is stepped over.
        """
        from mcap.data_stream import ReadDataStream
        from mcap.records import Metadata

        if file.read(len(MAGIC)) != MAGIC:
            return False
        self.begun = True
        while len(head := file.read(_RECORD.size)) == _RECORD.size:
            kind, length = _RECORD.unpack(head)
            if kind == _FOOTER:
                return len(file.read(length)) == length and file.read() == MAGIC
            if kind not in (_CHUNK, _METADATA):
                file.seek(length, SEEK_CUR)
                continue
            content = file.read(length)
            if len(content) < length:
                return False
            if kind == _CHUNK:
                self._chunk(content)
            else:
                metadata = Metadata.read(ReadDataStream(BytesIO(content)))
                if metadata.name == self._metadata:
                    self.facts |= metadata.metadata
        return False

    def _chunk(self, content: bytes) -> None:
        from mcap.data_stream import ReadDataStream
        from mcap.records import Chunk

        raw = self._unpack(Chunk.read(ReadDataStream(BytesIO(content))))
        starts, lengths = self._places(raw)
        if not len(starts):
            return
        data = np.frombuffer(raw, dtype=np.uint8)
        heads = _gather(data, starts, _HEAD.itemsize).view(_HEAD)
        for channel in np.unique(heads["channel"]).tolist():
            mine = heads["channel"] == channel
            at, size = starts[mine] + _HEAD.itemsize, lengths[mine] - _HEAD.itemsize
            if (size == size[0]).all():
                joined = _gather(data, at, int(size[0]))
            else:
                pieces = zip(at.tolist(), size.tolist(), strict=True)
                joined = np.concatenate([data[a : a + n] for a, n in pieces])
            log = heads["log"][mine].astype(np.int64)
            self.by_channel[channel].append(log, size, joined)

    def _places(self, raw: bytes) -> tuple[Ints, Ints]:
        """Where messages start, and how long they are; schemas and channels are taken in."""
        from mcap.data_stream import ReadDataStream
        from mcap.records import Channel, Schema

        starts, lengths = [], []
        at, end = 0, len(raw)
        while at < end:
            kind, length = _RECORD.unpack_from(raw, at)
            at += _RECORD.size
            if kind == _MESSAGE:
                starts.append(at)
                lengths.append(length)
            elif kind in (_SCHEMA, _CHANNEL):
                stream = ReadDataStream(BytesIO(raw[at : at + length]))
                if kind == _SCHEMA:
                    schema = Schema.read(stream)
                    self._schemas[schema.id] = schema.name
                else:
                    channel = Channel.read(stream)
                    name = self._schemas.get(channel.schema_id, "")
                    self.by_channel.setdefault(channel.id, Messages(channel.topic, name))
            at += length
        return np.array(starts, dtype=np.int64), np.array(lengths, dtype=np.int64)


def _gather(data: Bytes, starts: Ints, size: int) -> Bytes:
    """The `size` bytes behind each start, end to end."""
    if not size:
        return np.zeros(0, dtype=np.uint8)
    windows = np.lib.stride_tricks.sliding_window_view(data, size)
    return windows[starts].reshape(-1)
