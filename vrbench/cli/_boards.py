"""How the terminal shows leaderboards."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, log10
from pathlib import Path
from typing import TYPE_CHECKING

import click

from vrbench.cli._tables import console, show_table
from vrbench.digits import significant
from vrbench.results.board import Board, Entry, notes
from vrbench.results.board_formats import one_line

if TYPE_CHECKING:
    from vrbench.results.comparison import Comparison

# Of a cell, in characters.
LONGEST = 60
# From this width on there is room for all columns.
WIDE = 120


def show_boards(boards: Sequence[Board]) -> None:
    """Every board, best device first; below it why entries have no rank, and what else to know."""
    wide = console().width >= WIDE
    for board in boards:
        header = ["rank ", "device", "lab", f"{board.unit} ", "95 % ", "floor "]
        header += ["takes ", "valid "]
        if wide:
            header[2:2] = ["firmware", "logger", "prediction"]
            header += ["epochs ", "status"]
        if board.change:
            header += ["cams "]
        rows = [_cells(entry, wide=wide, change=board.change) for entry in board.entries]
        title = f"{one_line(board.title)}\n{one_line(_subtitle(board))}"
        show_table(title, header, rows)
        for note in notes(board):
            click.echo(one_line(note))
        click.echo()


def _subtitle(board: Board) -> str:
    key = board.key
    return (
        f"{board.metric}, protocol {key.protocol}, reference {key.reference}, "
        f"suite {key.suite_digest[:8]}, motion {key.motion_digest[:8]}"
    )


def _cells(entry: Entry, *, wide: bool, change: bool) -> list[str]:
    cells = [
        entry.places,
        entry.name,
        entry.lab,
        significant(entry.value),
        _interval(entry),
        significant(entry.floor, 3),
        f"{entry.takes}/{entry.mounts}/{entry.sittings}" if entry.takes else "",
        significant(entry.coverage, 3),
    ]
    if wide:
        logger = entry.logger
        if entry.logger_version != "unknown":
            logger += f" {entry.logger_version}"
        cells[2:2] = [entry.firmware, logger, entry.prediction]
        cells += ["" if entry.epochs is None else str(entry.epochs), entry.status]
    if change:
        cells += ["" if entry.cameras is None else "{}/{}".format(*entry.cameras)]
    # names are other people's words, and some words steer a terminal
    return [_short(one_line(cell)) for cell in cells]


def _short(cell: str) -> str:
    """The cell, its end cut where its row would fill the terminal; files have it all."""
    return cell if len(cell) <= LONGEST else f"{cell[: LONGEST - 1]}…"


def _interval(entry: Entry) -> str:
    """With as many decimals at both ends as its width asks for."""
    if entry.low is None or entry.high is None:
        return ""
    width = entry.high - entry.low
    decimals = max(0, 1 - floor(log10(width))) if width > 0 else 3
    return f"{entry.low:.{decimals}f}-{entry.high:.{decimals}f}"


def show_comparisons(first: Path, second: Path, found: Sequence[Comparison]) -> None:
    """A line a case and condition, and below it what each verdict rests on."""
    metrics = dict.fromkeys(comparison.metric for comparison in found)
    lines = (f"A: {first}", f"B: {second}")
    title = "\n".join(one_line(line) for line in lines)
    title += f"\n{one_line('; '.join(metrics))}, protocol {found[0].key.protocol}"
    rows = []
    for one in found:
        interval = (
            "" if one.low is None else f"{significant(one.low, 3)} to {significant(one.high, 3)}"
        )
        numbers = [significant(n) for n in (one.first, one.second, one.difference)]
        rows.append([_case(one), *numbers, interval, one.verdict])
    unit = next((one.unit for one in found if one.unit), "")
    header = ["case", f"A {unit} ", f"B {unit} ", "A - B ", "95 % ", "verdict"]
    show_table(title, header, rows)
    for one in found:
        paired = "paired by phase" if one.paired else "not paired"
        scope = f", speaks for {one.scope}s" if one.scope else ""
        click.echo(one_line(f"{_case(one)}: {one.verdict}: {one.reason} ({paired}{scope})"))


def _case(comparison: Comparison) -> str:
    key = comparison.key
    return one_line(key.case if key.condition == "default" else f"{key.case} {key.condition}")
