"""Whatever way an MCAP file is laid out: the messages that mcap's own reader finds."""

from __future__ import annotations

import random
import struct
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader
from mcap.writer import CompressionType, IndexType, Writer

from vrbench.errors import DataError
from vrbench.recording import messages
from vrbench.recording.messages import read_messages

LAYOUTS = {
    "zstd": {"compression": CompressionType.ZSTD},
    "lz4": {"compression": CompressionType.LZ4},
    "uncompressed": {"compression": CompressionType.NONE},
    "without chunks": {"use_chunking": False},
    "without indexes": {"index_types": IndexType.NONE},
    "without message indexes": {"index_types": IndexType.CHUNK},
    "without checksums": {"enable_crcs": False},
    "without a summary": {
        "index_types": IndexType.NONE,
        "repeat_channels": False,
        "repeat_schemas": False,
        "use_statistics": False,
        "use_summary_offsets": False,
    },
}


def write(path: Path, layout: dict[str, object], seed: int = 0, count: int = 400) -> Path:
    """Topics with messages of one size and of many, one of them in two channels, in disorder."""
    rng = random.Random(seed)
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=3000, **layout)  # type: ignore[arg-type]
        writer.start(profile="other", library="test")
        poses = writer.register_schema("made/msg/Pose", "ros2msg", b"float64 x")
        told = writer.register_schema("made/msg/Text", "ros2msg", b"string data")
        channels = [writer.register_channel(f"/topic/{i}", "cdr", poses) for i in range(3)]
        channels.append(writer.register_channel("/topic/0", "cdr", poses, {"again": "1"}))
        writer.register_channel("/silent", "cdr", poses)
        for i in range(count):
            if i == count // 2:
                channels.append(writer.register_channel("/late", "json", told))
            channel = rng.choice(channels)
            size = 24 if channel in channels[:4] else rng.randrange(60)
            t = rng.randrange(10**18)
            writer.add_message(channel, t, rng.randbytes(size), t - 5, i)
            if i % 150 == 149:
                writer.add_metadata("facts", {f"at {i}": "true"})
                writer.add_attachment(0, 0, "picture", "image/png", rng.randbytes(50))
        writer.finish()
    return path


def by_mcap(path: Path) -> dict[tuple[str, str], list[tuple[int, bytes]]]:
    found = defaultdict(list)
    with path.open("rb") as file:
        try:
            for schema, channel, message in NonSeekingReader(file).iter_messages(
                log_time_order=False
            ):
                assert schema is not None
                found[channel.topic, schema.name].append((message.log_time, message.data))
        except (EndOfFile, struct.error):
            pass
    return dict(found)


def by_us(path: Path, wanted=lambda _: True) -> dict[tuple[str, str], list[tuple[int, bytes]]]:
    found, _ = read_messages(path, "facts", wanted)
    return {
        (m.topic, m.schema): list(zip(m.log_t.tolist(), m, strict=True)) for m in found if len(m)
    }


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
@pytest.mark.parametrize("batch", [1, 5000, 1 << 22])
def test_every_layout_gives_the_same_messages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, layout: dict[str, object], batch: int
) -> None:
    monkeypatch.setattr(messages, "BATCH_BYTES", batch)
    path = write(tmp_path / "a.mcap", layout)
    expected = by_mcap(path)
    assert sum(map(len, expected.values())) == 400
    assert by_us(path) == expected
    _, facts = read_messages(path, "facts")
    assert facts == {"at 149": "true", "at 299": "true"}


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_of_topics_that_are_not_wanted_only_the_count_is_told(
    tmp_path: Path, layout: dict[str, object]
) -> None:
    path = write(tmp_path / "a.mcap", layout)
    expected = by_mcap(path)
    kept = ("/topic/1", "made/msg/Pose")
    assert by_us(path, "/topic/1".__eq__) == {kept: expected[kept]}
    found, _ = read_messages(path, "facts", "/topic/1".__eq__)
    assert {(m.topic, m.schema): m.counted for m in found} == {
        name: len(rows) for name, rows in expected.items()
    }


@pytest.mark.parametrize("layout", [LAYOUTS["zstd"], LAYOUTS["uncompressed"]], ids=["zstd", "none"])
def test_a_part_that_was_cut_gives_its_complete_chunks(
    tmp_path: Path, layout: dict[str, object]
) -> None:
    content = write(tmp_path / "a.mcap", layout).read_bytes()
    part = tmp_path / "a.mcap.part"
    for size in range(40, len(content), 997):
        part.write_bytes(content[:size])
        expected = {name: rows for name, rows in by_mcap(part).items() if rows}
        assert by_us(part) == expected, size
        with pytest.raises(DataError, match="not a whole MCAP file"):
            cut = tmp_path / "b.mcap"
            cut.write_bytes(content[:size])
            read_messages(cut, "facts")


@pytest.mark.parametrize("lie", ["shifted", "doubled", "far", "odd"])
def test_an_index_that_lies_is_not_believed(tmp_path: Path, lie: str) -> None:
    path = write(tmp_path / "a.mcap", LAYOUTS["zstd"])
    expected = by_mcap(path)
    content, at = bytearray(path.read_bytes()), 8
    while at < len(content) - 8:
        kind, length = struct.unpack_from("<BQ", content, at)
        if kind == 7 and length > 6:
            first = at + 9 + 6 + 8
            (offset,) = struct.unpack_from("<Q", content, first)
            other = {"shifted": offset + 9, "doubled": 0, "far": 2**63, "odd": offset}[lie]
            struct.pack_into("<Q", content, first, other)
            if lie == "odd":  # says that it is longer than it is
                struct.pack_into("<I", content, at + 9 + 2, length)
        at += 9 + length
    path.write_bytes(content)
    assert by_us(path) == expected


def test_a_message_of_a_channel_that_is_not_told_of_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start()
        writer.add_message(7, 1, b"1234", 1)
        writer.finish()
    with pytest.raises(DataError, match="a message of a channel that isn't told of"):
        read_messages(path, "facts")


def test_a_record_that_runs_over_its_chunk_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", {**LAYOUTS["uncompressed"], "enable_crcs": False})
    content = bytearray(path.read_bytes())
    at = content.index(b"made/msg/Pose") - 4 - 2 - 8  # the length of the first schema
    struct.pack_into("<Q", content, at, 10**6)
    path.write_bytes(content)
    with pytest.raises(DataError, match="not a whole MCAP file"):
        read_messages(path, "facts")


def test_the_columns_of_a_topic_are_those_of_its_bytes(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", LAYOUTS["lz4"])
    found, _ = read_messages(path, "facts")
    one = next(m for m in found if m.topic == "/topic/1")
    layout = np.dtype([("head", "V8"), ("values", "<u8", 2)])
    values = np.frombuffer(b"".join(one), layout)["values"]
    np.testing.assert_array_equal(one.rows(layout)["values"], values)
    with pytest.raises(DataError, match="messages of 24 bytes among those of 16"):
        one.rows(np.dtype([("values", "<u8", 2)]))
