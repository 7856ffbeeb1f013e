"""The messages of an MCAP file, by topic, as whole columns of bytes: no object per message."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import SEEK_CUR, BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
import numpy.typing as npt

from vrbench.errors import DataError
from vrbench.geometry import Ints
from vrbench.recording.caps import Unpacking

if TYPE_CHECKING:
    from mcap.records import Channel

Bytes = npt.NDArray[np.uint8]

_RECORD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQII")
# Where in a message's record its length, its channel, its log time and its data are.
_LENGTH, _OF_CHANNEL, _LOG, _DATA = 1, 9, 15, 31
# What a message's length counts besides its data.
_OVERHEAD = _DATA - _RECORD.size
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _INDEX, _METADATA = 2, 3, 4, 5, 6, 7, 12
_LOOSE = (_SCHEMA, _CHANNEL, _MESSAGE)
MAGIC = b"\x89MCAP0\r\n"
# What ends the name of a file that is still written, or that nothing could end.
PART = ".part"
# Chunks are sorted into topics together, up to so many bytes of them.
BATCH_BYTES = 1 << 22


@dataclass(slots=True)
class Messages:
    """The messages of one topic, in the order of the file.

    Attributes:
        topic: the topic,
        schema: and the name of its type.
        counted: how many there are, where they weren't wanted too.
    """

    topic: str
    schema: str
    counted: int = 0
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

    def rows(self, layout: np.dtype[Any]) -> Rows:
        """All messages as columns.

        Raises:
            DataError: a message has another size than the layout.
        """
        odd = [
            int(n[n != layout.itemsize][0]) for n in self._lengths if (n != layout.itemsize).any()
        ]
        if odd:
            raise DataError(
                f"messages of {odd[0]} bytes among those of {layout.itemsize}",
                field=self.topic,
                fix="names and frame of a topic stay the same throughout a take",
            )
        return Rows([part.view(layout) for part in self._data])

    def __iter__(self) -> Iterator[bytes]:
        for lengths, data in zip(self._lengths, self._data, strict=True):
            raw, at = data.tobytes(), 0
            for length in lengths.tolist():
                yield raw[at : at + length]
                at += length


@dataclass(frozen=True, slots=True)
class Rows:
    """Messages of one size, in pieces of structured arrays: whole columns come of them by name."""

    parts: list[npt.NDArray[Any]]

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        """A column of its own (n, ...)."""
        return np.concatenate([part[name] for part in self.parts])


def read_messages(
    path: Path, metadata: str, wanted: Callable[[str], bool] = lambda _: True
) -> tuple[list[Messages], dict[str, str]]:
    """All messages by topic, and the metadata records of one name as one mapping.

    A file called `.part` may end anywhere: its complete chunks are read.

    Args:
        path: the file.
        metadata: the records' name.
        wanted: which topics to read; of others it is told that they are there, without a message.

    Raises:
        DataError: no such file, or not a whole MCAP file.
    """
    reading = _Reading(metadata, wanted)
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
    return [m for m in reading.topics.values() if m.counted], reading.facts


def _damaged(path: Path, why: str) -> DataError:
    return DataError("is not a whole MCAP file", file=path, fix=f"record or import it again; {why}")


Batch = list[tuple[bytes, list[bytes]]]


class _Reading:
    """What has been read so far."""

    def __init__(self, metadata: str, wanted: Callable[[str], bool]) -> None:
        self.topics: dict[tuple[str, str], Messages] = {}
        self.facts: dict[str, str] = {}
        self.begun = False
        self._metadata = metadata
        self._wanted = wanted
        self._unpack = Unpacking()
        self._schemas: dict[int, str] = {}
        # the topic of each channel by its place among them, -1 where there is none
        self._place = np.full(1 << 16, -1, dtype=np.int16)
        self._loose = bytearray()
        # runs of records, chunks mostly, and what indexes tell of them
        self._batch: Batch = []
        self._batched = 0

    def file(self, file: BinaryIO) -> bool:
        """Reads chunks and metadata, in order; whether the file is there to its end.

        What follows the data, the summary above all, is stepped over.
        """
        if file.read(len(MAGIC)) != MAGIC:
            return False
        self.begun = True
        try:
            return self._records(file)
        finally:  # what came before any damage counts
            self._end_loose()
            self._sort_batch()

    def _records(self, file: BinaryIO) -> bool:
        from mcap.data_stream import ReadDataStream
        from mcap.records import Metadata

        while len(head := file.read(_RECORD.size)) == _RECORD.size:
            kind, length = _RECORD.unpack(head)
            if kind == _FOOTER:
                return len(file.read(length)) == length and file.read() == MAGIC
            if kind not in (_CHUNK, _INDEX, _METADATA, *_LOOSE):
                file.seek(length, SEEK_CUR)
                continue
            content = file.read(length)
            if len(content) < length:
                return False
            if kind == _INDEX:
                if self._batch:
                    self._batch[-1][1].append(content)
            elif kind in _LOOSE:
                self._loose += head + content
                if len(self._loose) > BATCH_BYTES:
                    self._end_loose()
            elif kind == _CHUNK:
                self._end_loose()
                if self._batched > BATCH_BYTES:
                    self._sort_batch()
                self._add(self._unpack(*_chunk(content)))
            else:
                metadata = Metadata.read(ReadDataStream(BytesIO(content)))
                if metadata.name == self._metadata:
                    self.facts |= metadata.metadata
        return False

    def _add(self, records: bytes) -> None:
        self._batch.append((records, []))
        self._batched += len(records)

    def _end_loose(self) -> None:
        """Takes in records that lie in no chunk."""
        if self._loose:
            self._add(bytes(self._loose))
            self._loose.clear()
            self._sort_batch()

    def _starts(self, data: Bytes, batch: Batch) -> Ints:
        """Where the records of messages start (n,); schemas and channels are taken in.

        An index is a hint, which saves a step for each message. It holds if records follow each
        other from the first byte of each run to its last.
        """
        begins = np.cumsum([0, *(len(records) for records, _ in batch)])
        hints = [b"".join(index[6:] for index in indexes) for _, indexes in batch]
        found = [np.frombuffer(h[: len(h) // 16 * 16], "<u8")[1::2] for h in hints]
        starts = np.concatenate(
            [
                np.where(f < len(data), f, 0).astype(np.int64) + at
                for f, at in zip(found, begins, strict=False)
            ]
        )
        starts = np.sort(starts)
        if not len(starts) or starts[-1] + _DATA > len(data) or (data[starts] != _MESSAGE).any():
            return self._walked(data, batch)
        lengths = _fields(data, "<u8", starts + _LENGTH)
        if lengths.min() < _OVERHEAD or lengths.max() > len(data):
            return self._walked(data, batch)
        ends = starts + lengths.astype(np.int64) + _RECORD.size
        # where a run begins one ends: in the chain it is a record without length
        borders = np.searchsorted(starts, begins)
        before = np.append(np.insert(ends, borders, begins), begins[-1])
        after = np.append(np.insert(starts, borders, begins), begins[-1])
        holes = np.flatnonzero(before[:-1] != after[1:]).tolist()
        between = [self._walk(data, int(before[k]), int(after[k + 1])) for k in holes]
        if None in between:
            return self._walked(data, batch)
        more = [start for some in between if some for start in some]
        return np.sort(np.append(starts, np.array(more, dtype=np.int64))) if more else starts

    def _walked(self, data: Bytes, batch: Batch) -> Ints:
        """The same without any hint."""
        starts: list[int] = []
        at = 0
        for records, _ in batch:
            walked = self._walk(data, at, at + len(records))
            if walked is None:
                raise ValueError("a record runs over the end of its chunk")
            starts += walked
            at += len(records)
        return np.array(starts, dtype=np.int64)

    def _walk(self, data: Bytes, at: int, end: int) -> list[int] | None:
        """Steps from record to record: where messages start; None where they don't end with it."""
        from mcap.data_stream import ReadDataStream
        from mcap.records import Channel, Schema

        raw, starts = data.data, []
        while at + _RECORD.size <= end:
            kind, length = _RECORD.unpack_from(raw, at)
            content = at + _RECORD.size
            if kind == _MESSAGE:
                if length < _OVERHEAD:
                    return None
                starts.append(at)
            elif kind in (_SCHEMA, _CHANNEL):
                stream = ReadDataStream(BytesIO(raw[content : content + length]))
                if kind == _SCHEMA:
                    schema = Schema.read(stream)
                    self._schemas[schema.id] = schema.name
                else:
                    self._enter(Channel.read(stream))
            at = content + length
        return starts if at == end else None

    def _enter(self, channel: Channel) -> None:
        """Channels of one topic and type are one topic."""
        name = channel.topic, self._schemas.get(channel.schema_id, "")
        self.topics.setdefault(name, Messages(*name))
        self._place[channel.id] = list(self.topics).index(name)

    def _sort_batch(self) -> None:
        """Sorts the messages of a batch into their topics."""
        batch, self._batch, self._batched = self._batch, [], 0
        data = np.frombuffer(b"".join(records for records, _ in batch), dtype=np.uint8)
        if not len(data):
            return
        starts = self._starts(data, batch)
        if not len(starts):
            return
        places = self._place[_fields(data, "<u2", starts + _OF_CHANNEL)]
        if places.min() < 0:
            raise ValueError("a message of a channel that isn't told of")
        order = np.argsort(places, kind="stable")
        ends = np.cumsum(np.bincount(places, minlength=len(self.topics)))
        for topic, mine in zip(self.topics.values(), np.split(order, ends[:-1]), strict=True):
            topic.counted += len(mine)
            if not len(mine) or not self._wanted(topic.topic):
                continue
            own = starts[mine]
            size = _fields(data, "<u8", own + _LENGTH).astype(np.int64) - _OVERHEAD
            if (size == size[0]).all():
                joined = _gather(data, own + _DATA, int(size[0]))
            else:
                pieces = zip((own + _DATA).tolist(), size.tolist(), strict=True)
                joined = np.concatenate([data[a : a + n] for a, n in pieces])
            topic.append(_fields(data, "<u8", own + _LOG).astype(np.int64), size, joined)


def _chunk(content: bytes) -> tuple[str, bytes, int, int]:
    """A chunk's compression, its packed records, their size unpacked and their checksum."""
    _, _, size, checksum, letters = _CHUNK_HEAD.unpack_from(content)
    at = _CHUNK_HEAD.size + letters
    (packed,) = struct.unpack_from("<Q", content, at)
    records = content[at + 8 : at + 8 + packed]
    if len(records) < packed:
        raise ValueError("a chunk is shorter than it says")
    return content[_CHUNK_HEAD.size : at].decode(), records, size, checksum


def _fields(data: Bytes, kind: str, at: Ints) -> npt.NDArray[Any]:
    """Values (n,) of a type that stand at places (n,), aligned or not."""
    windows: npt.NDArray[Any]
    windows = np.ndarray(len(data) - np.dtype(kind).itemsize + 1, kind, data, strides=(1,))
    return windows[at]


def _gather(data: Bytes, starts: Ints, size: int) -> Bytes:
    """The `size` bytes behind each start, end to end."""
    if not size:
        return np.zeros(0, dtype=np.uint8)
    return _fields(data, f"V{size}", starts).view(np.uint8)
