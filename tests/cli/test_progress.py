"""How a run is shown: line by line in a pipe, within the width of a terminal."""

from io import StringIO

from rich.console import Console

from vrbench.cli import _progress
from vrbench.cli._progress import RunDisplay
from vrbench.recording.monitor import Progress, StreamState

STREAMS = [
    StreamState("headset/eye", 720, 72.04, 1, 0.42, 0.0),
    StreamState("mocap/headset", 2400, 240.0, 0, 1.0, 0.0),
    StreamState("robot/tcp", 5000, None, 0, 0.0, 4.2),
]


def shown(monkeypatch, terminal):
    monkeypatch.setattr(_progress, "EVERY_S", 0.0)
    monkeypatch.setattr(_progress, "DRAW_S", 0.0)
    out = StringIO()
    console = Console(file=out, force_terminal=terminal, width=80, markup=False, highlight=False)
    with RunDisplay("record short@1 on quest-2", console) as display:
        display.take("replay.default.m1.r1", 1, 10)
        display.moving(Progress(0.25, 90.0, STREAMS))
        display.notice("the host's clock was stepped by +3.000 s")
        with display.paused():
            display.moving(Progress(0.99, 1.0, STREAMS))
    return out.getvalue()


def test_a_pipe_is_told_line_by_line(monkeypatch):
    assert shown(monkeypatch, terminal=False).splitlines() == [
        "record short@1 on quest-2: take 2 of 10, replay.default.m1.r1",
        "replay.default.m1.r1, take 2 of 10, 25 %, 1:30 left; headset/eye 72.0 Hz, 1 gap, "
        "42 % tracked; mocap/headset 240.0 Hz, 0 gaps, tracked; robot/tcp, 0 gaps, silent for 4 s",
        "the host's clock was stepped by +3.000 s",
    ]


def test_a_terminal_shows_every_stream(monkeypatch):
    text = shown(monkeypatch, terminal=True)
    for words in ("25 %, 1:30 left", "72.0", "42 % tracked", "silent for 4 s"):
        assert words in text
    assert "99 %" not in text  # while the terminal is somebody else's
