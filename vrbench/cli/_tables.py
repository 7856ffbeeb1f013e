"""How the terminal shows results; rich is imported when something is shown."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from rich.console import Console

    from vrbench.results.leaderboard import Board
    from vrbench.results.tables import Row


def console(*, err: bool = False) -> Console:
    """The terminal; text that goes to a file or a pipe is given room for whole lines."""
    from rich.console import Console

    plain = Console(stderr=err)
    return plain if plain.is_terminal else Console(stderr=err, width=160)


def show_table(title: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Prints a table; columns whose header ends in a space are aligned to the right."""
    from rich import box
    from rich.table import Table

    table = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False)
    for name in header:
        table.add_column(name.strip(), justify="right" if name.endswith(" ") else "left")
    for row in rows:
        table.add_row(*row)
    console().print(table)


def show_metrics(rows: Sequence[Row]) -> None:
    """The headline numbers: pooled where several takes are, of each take otherwise."""
    wanted = ("rmse", "mean", "max", "value", "median", "count")
    pooled = {(row.case, row.metric, row.point) for row in rows if row.repeat == "all"}
    shown: dict[tuple[str, ...], dict[str, Row]] = {}
    for row in rows:
        if row.variant != "main" or row.band != "all" or row.segment != "all":
            continue
        if row.repeat != "all" and (row.case, row.metric, row.point) in pooled:
            continue
        key = (row.case, row.mount, row.repeat, row.reference, row.metric, row.point)
        shown.setdefault(key, {})[row.statistic] = row
    table = []
    for (case, mount, repeat, _, metric, point), by_statistic in shown.items():
        first = next(iter(by_statistic.values()))
        cells = [_number(by_statistic[s].value) if s in by_statistic else "" for s in wanted]
        table.append(
            [f"{case} m{mount} r{repeat}", metric, point, *cells, first.unit, _state(first)]
        )
    header = ["take", "metric", "at", *(f"{s} " for s in wanted), "unit", "status"]
    show_table("Metrics", header, table)


def show_boards(boards: Sequence[Board]) -> None:
    """Every board, best device first, and why those without a rank have none."""
    for board in boards:
        key = board.key
        title = (
            f"Leaderboard: {key.suite}, {key.case} by {key.motion}, speed {key.speed:g}, "
            f"{board.metric}\nprotocol {key.protocol}, reference {key.reference}, "
            f"suite {key.suite_digest[:8]}, motion {key.motion_digest[:8]}"
        )
        unit = next((entry.unit for entry in board.entries if entry.unit), "")
        header = ["rank ", "device", "lab", "firmware", f"{unit} ", "takes ", "mounts ", "valid % "]
        rows = [
            [
                "-" if e.rank is None else str(e.rank),
                e.device,
                e.lab,
                e.firmware,
                _number(e.value),
                str(e.takes),
                str(e.mounts),
                _number(e.coverage),
                e.status,
                e.reason,
            ]
            for e in board.entries
        ]
        show_table(title, [*header, "status", "why"], rows)


def _state(row: Row) -> str:
    return row.status if row.status == "ok" else f"{row.status}: {row.reason}"


def _number(value: float | None) -> str:
    """Four significant digits, without exponents where people don't expect them."""
    if value is None:
        return ""
    return f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"


@contextmanager
def bar(what: str) -> Iterator[Any]:
    """A progress bar on stderr: call it with a text and the part done, 0..1."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn(what),
        BarColumn(bar_width=30),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=console(err=True), transient=True) as progress:
        task = progress.add_task("", total=1.0)

        def tell(text: str, done: float) -> None:
            progress.update(task, description=text, completed=done)

        yield tell


def exit_code(rows: Sequence[Row]) -> int:
    """1 where a result is invalid or failed, 0 otherwise."""
    bad = any(row.status in ("invalid", "failed") and row.variant == "main" for row in rows)
    return 1 if bad else 0


def show_trouble(rows: Sequence[Row]) -> None:
    """One line on stderr for each take that failed or is invalid."""
    told: dict[tuple[str, ...], None] = {}
    for row in rows:
        if row.status in ("invalid", "failed") and row.variant == "main" and row.repeat != "all":
            told[(row.case, row.mount, row.repeat, row.status, row.reason)] = None
    for case, mount, repeat, status, reason in told:
        click.echo(f"{status}: {case} mount {mount} repeat {repeat}: {reason}", err=True)
