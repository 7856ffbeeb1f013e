"""What a take's summary says, without reading the take."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from vrbench.recording.cdr import SAMPLE

# Of a take without a summary, which was cut short: the bytes of file that a pose takes, at least.
PACKED_BYTES = 40


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of a take.

    Attributes:
        name: `/robot/tcp/samples`.
        schema: the name of its messages' type.
        messages: how many there are.
    """

    name: str
    schema: str
    messages: int


def topics_of(path: Path) -> list[Topic]:
    """The topics that have messages; none where the file has no summary, or can't be read."""
    from mcap.reader import make_reader

    try:
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
    except Exception:  # a damaged file can raise anything; who reads it tells
        summary = None
    if summary is None or summary.statistics is None:
        return []
    schemas = {id_: schema.name for id_, schema in summary.schemas.items()}
    counts = summary.statistics.channel_message_counts
    return [
        Topic(channel.topic, schemas.get(channel.schema_id, ""), counts[id_])
        for id_, channel in summary.channels.items()
        if counts.get(id_)
    ]


def poses_in(path: Path) -> int:
    """How many poses a take holds; an estimate where it has no summary."""
    topics = topics_of(path)
    if not topics:
        return path.stat().st_size // PACKED_BYTES
    return sum(topic.messages for topic in topics if topic.schema == SAMPLE)
