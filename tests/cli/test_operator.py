"""The operator at the terminal, and the one that `--yes` puts in their place."""

import pytest

from vrbench.cli._person import ScriptedOperator, TerminalOperator
from vrbench.devices.ports import Occlusion
from vrbench.errors import ConfigError

TWO = Occlusion("two", {3: "lower right", 0: "upper left"}, 0.5)


class Terminal:
    """Someone who presses Enter, or nobody."""

    def __init__(self, answer: str) -> None:
        self.answer = answer

    def readline(self) -> str:
        return self.answer


def test_the_operator_is_told_which_cameras_to_cover(monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", Terminal("\n"))
    operator = TerminalOperator()
    operator.remount(2)
    operator.cover(TWO)
    operator.cover(Occlusion())
    operator.cover(Occlusion("all", {0: "front"}, 1.0))
    told = capsys.readouterr().out
    assert "Fix the headset anew, the 2. time. Enter goes on" in told
    assert "Cover cameras 0 (upper left), 3 (lower right), uncover all others." in told
    assert "Uncover all cameras." in told
    assert "Cover all cameras." in told


def test_a_recentre_waits_for_nobody(monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", Terminal(""))
    TerminalOperator().recentre()
    assert "from outside the robot's reach" in capsys.readouterr().out


def test_where_nobody_is_there_it_is_said(monkeypatch):
    monkeypatch.setattr("sys.stdin", Terminal(""))
    with pytest.raises(ConfigError, match=r"nobody is at the terminal .*Cover cameras 0 .*--yes"):
        TerminalOperator().cover(TWO)


def test_yes_takes_it_for_done_and_says_so(monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", Terminal(""))
    operator = ScriptedOperator()
    operator.remount(2)
    operator.cover(TWO)
    operator.recentre()
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.count("taken for done: ") == 3
