"""Leaderboards as CSV, Markdown, LaTeX, JSON. Names are other people's words: they are escaped."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from io import StringIO
from typing import Any

from vrbench.digits import significant
from vrbench.results.board import STATISTICS, Board, Entry, Leaderboard, notes

SCHEMA_VERSION = 1
_MARKDOWN = re.compile(r"([\\`*_{}\[\]#|~$])")
# What TeX's plain fonts have beyond ASCII.
_LATIN = frozenset(
    "ÀÁÂÃÄÅÆÇÈÉÊËÌÍÎÏÑÒÓÔÕÖØÙÚÛÜÝßàáâãäåæçèéêëìíîïñòóôõöøùúûüýÿŁłŃńŚśŹźŻżŠšŽžČčŘřĆćŐőŰű"
)
_LATEX = {
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "$": r"\$",
    "&": r"\&",
    "#": r"\#",
    "_": r"\_",
    "%": r"\%",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': "''",
}


def as_csv(found: Leaderboard) -> str:
    """One line an entry, of all boards; numbers to ten digits."""
    text = StringIO()
    table: Any = None
    for board in found.boards:
        for entry in board.entries:
            cells = _flat(board, entry)
            if table is None:
                table = csv.DictWriter(text, list(cells), lineterminator="\n")
                table.writeheader()
            table.writerow({name: _csv_cell(cell) for name, cell in cells.items()})
    return text.getvalue()


def as_json(found: Leaderboard) -> str:
    """Boards, entries, and the runs that stand on none, as the data model has them."""
    boards = []
    for board in found.boards:
        entries = [{"places": e.places, **asdict(e)} for e in board.entries]
        boards.append({**asdict(board), "title": board.title, "entries": entries})
    left_out = [{"run": left.run, "reason": str(left.error)} for left in found.left_out]
    content = {"schema_version": SCHEMA_VERSION, "boards": boards, "left_out": left_out}
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def as_markdown(found: Leaderboard) -> str:
    """A heading, a table and notes for each board."""
    parts = []
    for board in found.boards:
        header = ["rank", "device", "firmware", "logger", "prediction", "lab"]
        header += [f"{_ranked_name(board)} [{board.unit}]", "95 %", "floor"]
        header += ["takes", "mounts", "sittings", "valid [%]", "epochs", "status"]
        if board.change:
            header.insert(-1, "cameras covered")
        lines = [
            "| " + " | ".join(cells) + " |"
            for cells in (
                header,
                ["---"] * len(header),
                *map(_markdown_cells(board), board.entries),
            )
        ]
        told = [f"- {_markdown(note)}" for note in notes(board)]
        heading = f"## {_markdown(board.title)}\n\n{_markdown(_subtitle(board))}"
        parts.append("\n\n".join(filter(None, [heading, "\n".join(lines), "\n".join(told)])))
    left_out = [f"- left out: {_markdown(str(left.error))}" for left in found.left_out]
    return "\n\n".join([*parts, *(["\n".join(left_out)] if left_out else [])]) + "\n"


def as_latex(found: Leaderboard) -> str:
    """The paper's table for each board: RMSE, mean, std and max; plain LaTeX, no package needed."""
    return "\n".join(_latex_table(board) for board in found.boards)


FORMATS: Mapping[str, Callable[[Leaderboard], str]] = {
    "csv": as_csv,
    "md": as_markdown,
    "latex": as_latex,
    "json": as_json,
}


def _flat(board: Board, entry: Entry) -> dict[str, Any]:
    covered, cameras = entry.cameras or (None, None)
    return {
        **asdict(board.key),
        "ranked_by": board.metric,
        **{
            name: getattr(entry, name)
            for name in (
                *("rank", "last_rank", "device", "firmware", "logger", "logger_version"),
                *("prediction", "lab", "value", "unit", "low", "high", "scope"),
            )
        },
        **{name: entry.statistics.get(name) for name in STATISTICS},
        **{
            name: getattr(entry, name)
            for name in (
                *("floor", "takes", "mounts", "sittings", "failed", "invalid", "coverage"),
                *("epochs", "status", "reason", "source"),
            )
        },
        "cameras_covered": covered,
        "cameras": cameras,
        "ranked_among": ";".join(entry.ranked_among),
        "runs": ";".join(entry.runs),
    }


def _csv_cell(cell: Any) -> str:
    if cell is None:
        return ""
    if isinstance(cell, float):
        return f"{cell:.10g}"
    text = one_line(str(cell))
    # a spreadsheet would carry out a text that begins so
    return f"'{text}" if text.lstrip().startswith(tuple("=+-@")) else text


def _ranked_name(board: Board) -> str:
    return f"change of {_statistic(board)}" if board.change else _statistic(board)


def _statistic(board: Board) -> str:
    return "RMSE" if " rmse " in board.metric else "value"


def _subtitle(board: Board) -> str:
    key = board.key
    return (
        f"Ranked by {board.metric}; protocol {key.protocol}, reference {key.reference}, "
        f"suite {key.suite_digest[:8]}, motion {key.motion_digest[:8]}."
    )


def _markdown_cells(board: Board) -> Callable[[Entry], list[str]]:
    def cells(entry: Entry) -> list[str]:
        epochs = "" if entry.epochs is None else str(entry.epochs)
        covered = "" if entry.cameras is None else "{}/{}".format(*entry.cameras)
        counts = (entry.takes, entry.mounts, entry.sittings)
        names = (entry.name, entry.firmware, _logger(entry), entry.prediction, entry.lab)
        return [
            entry.places,
            *map(_markdown, names),
            significant(entry.value),
            _interval(entry, " to "),
            significant(entry.floor, 3),
            *(str(count) if entry.takes else "" for count in counts),
            significant(entry.coverage),
            epochs,
            *([covered] if board.change else []),
            entry.status,
        ]

    return cells


def _logger(entry: Entry) -> str:
    version = "" if entry.logger_version == "unknown" else f" {entry.logger_version}"
    return f"{entry.logger}{version}"


def _interval(entry: Entry, to: str) -> str:
    if entry.low is None:
        return ""
    return f"{significant(entry.low)}{to}{significant(entry.high)}"


def _markdown(text: str) -> str:
    escaped = _MARKDOWN.sub(r"\\\1", one_line(text))
    return escaped.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def _latex_table(board: Board) -> str:
    numbers = ["RMSE", "Mean", "Std", "Max"]
    header = ["", "Device", *(["Change"] if board.change else []), *numbers, "95\\,\\%", "Floor"]
    lines = [
        r"\begin{table}",
        r"\centering",
        rf"\caption{{{_latex(board.title)}: {_latex(_subtitle(board))}",
        rf"  All numbers in {_latex(board.unit or 'mm')}. A range of ranks: can't be told apart.}}",
        rf"\begin{{tabular}}{{rl{'r' * (len(header) - 2)}}}",
        r"\hline",
        " & ".join(header) + r" \\",
        r"\hline",
        *_latex_rows(board),
        r"\hline",
        r"\end{tabular}",
        r"\end{table}",
        "",
    ]
    return "\n".join(lines)


def _latex_rows(board: Board) -> Iterator[str]:
    labs = {entry.lab for entry in board.entries}
    published = False
    for entry in board.entries:
        if entry.source == "published" and not published:
            published = True
            yield r"\hline"
        name = entry.name if len(labs) == 1 else f"{entry.name}, {entry.lab}"
        change = [_fixed(entry.value)] if board.change else []
        statistics = [_fixed(entry.statistics.get(s)) for s in STATISTICS]
        interval = "" if entry.low is None else f"{_fixed(entry.low)}--{_fixed(entry.high)}"
        places = entry.places.replace("-", "--")
        cells = [places, _latex(name), *change, *statistics, interval, _fixed(entry.floor)]
        yield " & ".join(cells) + r" \\"


def _fixed(value: float | None) -> str:
    """As the paper prints it: hundredths of a millimetre."""
    return "--" if value is None else f"{value:.2f}"


def _latex(text: str) -> str:
    """Text that TeX prints and doesn't obey; letters that plain fonts lack by their number."""
    return "".join(
        _LATEX.get(c, c if c.isascii() or c in _LATIN else f"[U+{ord(c):04X}]")
        for c in one_line(text)
    )


def one_line(text: str) -> str:
    """The text without line breaks and without what steers a terminal."""
    return "".join(c if c.isprintable() else " " for c in text)
