"""A leaderboard as a static site: a page a board, a page a run, one style sheet, one script.

Its pages name runs by their folders' names, never by where those lie on this machine.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vrbench.errors import ConfigError, VrbenchError
from vrbench.results.board import STATISTICS, Board, Entry, Leaderboard, notes
from vrbench.results.bundle import Bundle
from vrbench.results.collection import without_collection
from vrbench.results.report.pages import SCRIPT, STYLE, render, script, style
from vrbench.results.report.run_page import Site, Stand, run_page

HOME, RUNS = "index.html", "runs.html"
# A chart of more intervals than these is no chart any more; the table has them all.
MOST_INTERVALS = 60
# Told of each run: its name, its place, how many there are.
Tell = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True)
class RunLine:
    """A run in the list of runs: its page, and what it is; no page where it can't be read."""

    name: str
    page: str | None
    device: str = ""
    lab: str = ""
    suite: str = ""
    kind: str = ""
    created: str = ""
    trouble: str = ""


def write_site(
    found: Leaderboard, folders: Sequence[Path], protocol: str, out: Path, tell: Tell
) -> None:
    """Writes the site of these runs and their boards.

    Args:
        found: the boards.
        folders: the runs.
        protocol: by which they were scored.
        out: a new or an empty folder.
        tell: told of each run.

    Raises:
        ConfigError: the folder holds files or can't be made, or jinja2 isn't installed.
    """
    _make(out)
    (out / SCRIPT).write_text(script(), encoding="utf-8")
    (out / STYLE).write_text(style(), encoding="utf-8")
    boards = _named([board.key.suite + "-" + board.key.case for board in found.boards], "board")
    pages = dict(zip(map(str, folders), _named([f.name for f in folders], "run"), strict=True))
    stands = _stands(found.boards, boards)
    trouble = {one.run: one.error.what for one in found.left_out}
    lines = []
    for k, folder in enumerate(folders):
        tell(folder.name, k, len(folders))
        site = Site(HOME, stands.get(str(folder), ()))
        with without_collection():
            lines.append(_write_run(folder, protocol, site, out / pages[str(folder)], trouble))
    written = {line.page for line in lines}
    links = {run: page for run, page in pages.items() if page in written}
    for board, page in zip(found.boards, boards, strict=True):
        (out / page).write_text(_board_page(board, links), encoding="utf-8")
    listed = list(zip(found.boards, boards, strict=True))
    (out / HOME).write_text(_home_page(listed, lines), encoding="utf-8")
    (out / RUNS).write_text(
        render("runs.html.j2", shared=True, home=HOME, lines=lines), encoding="utf-8"
    )


def _make(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
        empty = not any(out.iterdir())
    except OSError as error:
        raise ConfigError("can't be made", file=out, field="-o", fix=str(error)) from None
    if not empty:
        raise ConfigError("holds files already", file=out, field="-o", fix="name a new folder")


def _named(names: Iterable[str], kind: str) -> list[str]:
    """A page's file name for each name: safe anywhere, and no two alike."""
    found: list[str] = []
    for k, name in enumerate(names, 1):
        plain = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")[:60]
        found.append(f"{kind}-{k}-{plain}.html" if plain else f"{kind}-{k}.html")
    return found


def _stands(boards: Sequence[Board], pages: Sequence[str]) -> dict[str, list[Stand]]:
    """Where each run stands, by its folder."""
    stands: dict[str, list[Stand]] = defaultdict(list)
    for board, page in zip(boards, pages, strict=True):
        for entry in board.entries:
            if entry.source == "measured":
                for run in entry.runs:
                    stands[run].append(
                        Stand(board.title, page, entry.places, entry.status, entry.reason)
                    )
    return stands


def _write_run(
    folder: Path, protocol: str, site: Site, path: Path, trouble: Mapping[str, str]
) -> RunLine:
    try:
        bundle = Bundle.open(folder)
        path.write_text(run_page(bundle, protocol, site), encoding="utf-8")
    except VrbenchError as error:
        return RunLine(folder.name, None, trouble=trouble.get(str(folder), error.what))
    record = bundle.record
    return RunLine(
        name=folder.name,
        page=path.name,
        device=record.device.headset,
        lab=record.lab,
        suite=record.resolved_suite().label,
        kind=record.kind,
        created=record.created[:10],
        trouble=trouble.get(str(folder), ""),
    )


def _board_page(board: Board, links: Mapping[str, str]) -> str:
    shown = [entry for entry in board.entries if entry.value is not None][:MOST_INTERVALS]
    apart = len({tuple(e.ranked_among) for e in board.entries if e.ranked_among}) > 1
    forest = {
        "title": "Devices with their intervals",
        "note": "95 %; hollow: not ranked; pub.: printed by others"
        + (f"; the first {len(shown)}" if len(board.entries) > len(shown) else ""),
        "label": board.metric,
        "unit": board.unit,
        "rows": [_interval(entry, board, apart) for entry in shown],
    }
    ranked_by = [name for name in STATISTICS if f" {name} " in board.metric]
    return render(
        "board.html.j2",
        shared=True,
        home=HOME,
        board=board,
        apart=apart,
        statistics=[name for name in STATISTICS if board.change or name not in ranked_by],
        rows=[(entry, _links(entry, links)) for entry in board.entries],
        devices=_distinct(entry.device for entry in board.entries),
        labs=_distinct(entry.lab for entry in board.entries),
        statuses=_distinct(entry.status for entry in board.entries),
        notices=[note for note in notes(board) if note.startswith("ranked apart")],
        printed=[note for note in notes(board) if note.startswith("pub.")],
        forests=[forest] if shown else [],
    )


def _interval(entry: Entry, board: Board, apart: bool) -> dict[str, Any]:
    """A line of the chart; where labs are ranked apart, places of several would stand mixed."""
    place = "" if apart else f"{entry.places}  "
    return {
        "name": f"{place}{entry.name}, {entry.lab}",
        "pooled": False,
        "status": "ok" if entry.rank is not None else entry.status,
        "value": entry.value,
        "low": entry.low,
        "high": entry.high,
        # that of a change isn't that of the error
        "floor": None if board.change or entry.unit != board.unit else entry.floor,
    }


def _links(entry: Entry, links: Mapping[str, str]) -> list[tuple[str, str]]:
    """Name and page of each of an entry's runs."""
    return [(Path(run).name, links[run]) for run in entry.runs if run in links]


def _distinct(texts: Iterable[str]) -> list[str]:
    return sorted(set(texts))


def _home_page(boards: Sequence[tuple[Board, str]], lines: Sequence[RunLine]) -> str:
    return render(
        "home.html.j2",
        shared=True,
        home=None,
        boards=[(board, page, _leaders(board)) for board, page in boards],
        suites=_distinct(board.key.suite for board, _ in boards),
        kinds=_distinct(_kind(board) for board, _ in boards),
        run_count=sum(1 for line in lines if line.page),
        left_out=[line for line in lines if line.trouble],
        runs_page=RUNS,
    )


def _kind(board: Board) -> str:
    return "simulated" if board.key.simulated else "recorded"


def _leaders(board: Board) -> str:
    """The devices that may be first, by name; there is none where nothing is ranked."""
    first = [entry for entry in board.entries if entry.rank == 1]
    names = _distinct(entry.device for entry in first)
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
