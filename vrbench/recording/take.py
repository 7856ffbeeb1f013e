"""Takes: one recording, one MCAP file, which any MCAP tool opens."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, BinaryIO, Self

from vrbench import __version__
from vrbench.clocks import Exchanges
from vrbench.errors import DataError
from vrbench.recording import cdr
from vrbench.recording.messages import read_messages
from vrbench.recording.summary import topics_of
from vrbench.streams import Columns, Event, Joints, Samples, States

if TYPE_CHECKING:
    from mcap.writer import Writer

METADATA = "vrbench"
CHUNK_BYTES = 512 * 1024
# A chunk is also closed when it is a second old, so that a crash costs no more.
CHUNK_NS = 1_000_000_000
# How often what is written is forced to the disk, against a loss of power [s].
SYNC_S = 5.0
# What isn't read where only poses, events and clocks are wanted.
STATES = (cdr.JOINT_STATE, cdr.ROBOT_STATE)
# The frame that poses of a stream are given in, by the first part of its name.
FRAMES = {"headset": "world", "robot": "base", "mocap": "mocap"}


def pose_topic(stream: str) -> str:
    """`/headset/eye/pose`, `/mocap/<body>/pose`; a robot's are `/robot/tcp`, `/robot/target`."""
    return f"/{stream}" if stream.startswith("robot") else f"/{stream}/pose"


class TakeWriter:
    """Writes a take; the file has its name only once it is whole.

    Until then it is `NAME.mcap.part`. What stands there after a crash can be read up to the last
    complete chunk, which is a second old at most.

    Args:
        path: where the take will be.
        metadata: facts of the take, text by name.
    """

    def __init__(self, path: Path, metadata: Mapping[str, str]) -> None:
        self.path = path
        self._part = path.with_name(path.name + ".part")
        self._metadata = dict(metadata)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._chunk_t: int | None = None
        self._synced = time.monotonic()
        self._file: BinaryIO
        self._writer: Writer

    def __enter__(self) -> Self:
        from mcap.writer import CompressionType, Writer

        if self.path.exists():
            raise DataError("the take is already there", file=self.path)
        self._file = self._part.open("wb")
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library=f"vrbench {__version__}")
        self._writer.add_metadata(METADATA, self._metadata)
        self._file.flush()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            with self._file:
                self._writer.finish()  # type: ignore[no-untyped-call]
                self._file.flush()
                os.fsync(self._file.fileno())
        except OSError:
            # a full disk: what made it end tells more, where something did
            if kind is None:
                raise
        if kind is None:
            self._part.replace(self.path)

    def tell(self, metadata: Mapping[str, str]) -> None:
        """Adds facts of the take that came to be known only now."""
        self._writer.add_metadata(METADATA, dict(metadata))

    def write(self, columns: Columns) -> None:
        """Appends columns of any streams, in order of receive time."""
        rows: list[tuple[int, int, int, bytes]] = []  # log time, publish time, channel, data
        for stream, samples in columns.poses.items():
            rows += self._pose_rows(stream, samples)
        for stream, joints in columns.joints.items():
            channel = self._channel(f"/{stream}", cdr.JOINT_STATE)
            rows += zip(
                joints.receive_t.tolist(),
                joints.t.tolist(),
                [channel] * len(joints),
                cdr.encode_joints(joints),
                strict=True,
            )
        for stream, states in columns.states.items():
            channel = self._channel(f"/{stream}", cdr.ROBOT_STATE)
            rows += zip(
                states.receive_t.tolist(),
                states.t.tolist(),
                [channel] * len(states),
                cdr.encode_states(states),
                strict=True,
            )
        for source, exchanges in columns.clocks.items():
            channel = self._channel(f"/clock/{source}", cdr.CLOCK_EXCHANGE)
            times = exchanges.received.tolist()
            encoded = cdr.encode_exchanges(exchanges)
            rows += zip(times, times, [channel] * len(times), encoded, strict=True)
        for event in columns.events:
            channel = self._channel("/events", cdr.EVENT)
            rows.append((event.t, event.t, channel, cdr.encode_event(event)))
        rows.sort(key=lambda row: row[0])
        if rows and rows[0][0] < 0:
            raise DataError(
                f"a stamp lies {-rows[0][0] / 1e9:.9g} s before 1970",
                file=self.path,
                fix="stamps are nanoseconds since 1970, or since the device's start",
            )
        for log_time, publish_time, channel, data in rows:
            self._writer.add_message(channel, log_time, data, publish_time)
        if rows:
            self._close_chunk(rows[-1][0])

    def _close_chunk(self, t: int) -> None:
        """Hands the chunk to the system where it is old enough at log time t [ns]."""
        if self._chunk_t is None:
            self._chunk_t = t
        elif t - self._chunk_t >= CHUNK_NS:
            self._chunk_t = t
            self._writer.flush()  # type: ignore[no-untyped-call]
            if time.monotonic() - self._synced >= SYNC_S:
                os.fsync(self._file.fileno())
                self._synced = time.monotonic()

    def _pose_rows(self, stream: str, samples: Samples) -> list[tuple[int, int, int, bytes]]:
        if not len(samples):
            return []
        every = self._channel(f"/{stream}/samples", cdr.SAMPLE)
        poses = self._channel(pose_topic(stream), cdr.POSE_STAMPED)
        frame = FRAMES[stream.split("/")[0].split("_")[0]]
        good = samples[samples.good]
        return [
            *zip(
                samples.receive_t.tolist(),
                samples.pose_t.tolist(),
                [every] * len(samples),
                cdr.encode_samples(samples),
                strict=True,
            ),
            *zip(
                good.receive_t.tolist(),
                good.pose_t.tolist(),
                [poses] * len(good),
                cdr.encode_poses(good.pose_t, good.pose, frame),
                strict=True,
            ),
        ]

    def _channel(self, topic: str, schema: str) -> int:
        if topic not in self._channels:
            if schema not in self._schemas:
                self._schemas[schema] = self._writer.register_schema(
                    schema, "ros2msg", cdr.SCHEMAS[schema].encode()
                )
            self._channels[topic] = self._writer.register_channel(
                topic, "cdr", self._schemas[schema]
            )
        return self._channels[topic]


def read_take(path: Path, *, joints: bool = True) -> Columns:
    """What a take holds; of a `.part`, which may be cut short, all of its complete chunks.

    Args:
        path: the take.
        joints: whether joint and controller states are wanted too, most of what a robot sends.

    Raises:
        DataError: no such file, not MCAP, or cut short.
    """
    unwanted = _unwanted(path, joints=joints)
    messages, metadata = read_messages(path, METADATA, lambda topic: topic not in unwanted)
    poses: dict[str, Samples] = {}
    moved: dict[str, Joints] = {}
    events: list[Event] = []
    clocks: dict[str, Exchanges] = {}
    states: dict[str, States] = {}
    sampled = {m.topic.removesuffix("/samples") for m in messages if m.schema == cdr.SAMPLE}
    for topic in messages:
        if topic.topic in unwanted or (topic.schema in STATES and not joints):
            continue
        stream = topic.topic.removeprefix("/")
        if topic.schema == cdr.SAMPLE:
            poses[stream.removesuffix("/samples")] = cdr.decode_samples(topic)
        elif topic.schema == cdr.POSE_STAMPED:
            # where samples are there too, they say more
            if topic.topic.removesuffix("/pose") not in sampled:
                poses[stream.removesuffix("/pose")] = cdr.decode_poses(topic)
        elif topic.schema == cdr.JOINT_STATE:
            moved[stream] = cdr.decode_joints(topic)
        elif topic.schema == cdr.CLOCK_EXCHANGE:
            clocks[stream.removeprefix("clock/")] = cdr.decode_exchanges(topic)
        elif topic.schema == cdr.ROBOT_STATE:
            states[stream] = cdr.decode_states(topic)
        elif topic.schema == cdr.EVENT:
            events += map(cdr.decode_event, topic)
    events.sort(key=lambda event: event.t)
    return Columns(poses, moved, events, clocks, metadata, states)


def _unwanted(path: Path, *, joints: bool) -> set[str]:
    """Topics that needn't be read, by the take's summary: poses of which samples say more, and
    joint and controller states where nobody wants them.
    """
    topics = topics_of(path)
    found = set() if joints else {t.name for t in topics if t.schema in STATES}
    samples = {t.name.removesuffix("/samples") for t in topics if t.schema == cdr.SAMPLE}
    return found | {
        t.name
        for t in topics
        if t.schema == cdr.POSE_STAMPED and t.name.removesuffix("/pose") in samples
    }
