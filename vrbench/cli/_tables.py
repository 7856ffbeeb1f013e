"""How the terminal shows results; rich is imported when something is shown."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Literal

import click

from vrbench.digits import significant

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from vrbench.results.tables import Row


def console(*, err: bool = False) -> Console:
    """The terminal; text that goes to a file or a pipe is given room for whole lines."""
    from rich.console import Console

    # What users write, `[lab]` say, is text and no markup.
    plain = Console(stderr=err, markup=False, highlight=False)
    if plain.is_terminal or "COLUMNS" in os.environ:
        return plain
    return Console(stderr=err, width=160, markup=False, highlight=False)


# From so many rows on, a table whose cells all fit is laid out here: rich takes 1 ms a row.
_MANY = 50


def show_table(title: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Prints a table.

    A header that ends in a space makes a column of numbers: aligned to the right and never cut.
    """
    from rich import box
    from rich.table import Table

    table = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False)
    for name in header:
        number = name.endswith(" ")
        justify: Literal["left", "right"] = "right" if number else "left"
        table.add_column(name.strip(), justify=justify, no_wrap=number, overflow="fold")
    every = list(rows)
    terminal = console()
    lines = _fitting(table, every, terminal.width) if len(every) >= _MANY else None
    for row in every if lines is None else every[:1]:
        table.add_row(*row)
    if lines is None:
        terminal.print(table)
        return
    with terminal.capture() as shown:
        terminal.print(table)
    # title, header, rule and the first row; last the blank line below a table
    head, below = shown.get().rstrip("\n").rsplit("\n", 1)
    click.echo("\n".join([head, *lines[1:], below]))


def _fitting(table: Table, rows: Sequence[Sequence[str]], width: int) -> list[str] | None:
    """The rows as rich would lay them out, in a fiftieth of its time; None if a cell must fold.

    Sets the widths of the table's columns.
    """
    from rich.cells import cell_len

    widths = [
        max(cell_len(str(column.header)), *(cell_len(row[i]) for row in rows))
        for i, column in enumerate(table.columns)
    ]
    # a blank at both edges, three between columns
    if sum(widths) + 3 * len(widths) - 1 > width:
        return None
    for column, n in zip(table.columns, widths, strict=True):
        column.min_width = n
    right = [column.justify == "right" for column in table.columns]
    lines = []
    for row in rows:
        blanks = [" " * (n - cell_len(cell)) for n, cell in zip(widths, row, strict=True)]
        cells = (b + c if r else c + b for b, c, r in zip(blanks, row, right, strict=True))
        lines.append(f" {'   '.join(cells)} ")
    return lines


# The headline numbers of a take: column, metric, point, statistic; the first five fit anywhere.
_NARROW = 120
_HEADLINES = (
    ("ape eye mm ", "ape.translation.aligned", "eye", "rmse"),
    ("ape tcp mm ", "ape.translation.aligned", "tcp", "rmse"),
    ("ape deg ", "ape.rotation.aligned", "eye", "rmse"),
    ("offset ms ", "clock.offset", "", "value"),
    ("valid % ", "coverage.valid", "", "value"),
    ("max mm ", "ape.translation.aligned", "eye", "max"),
    ("rpe 1 s mm ", "rpe.translation@1s", "eye", "rmse"),
    ("scale ", "scale", "eye", "value"),
    ("rate Hz ", "timing.rate", "", "value"),
)
# Those of suites that look at something else; shown where a take has them.
_SPECIAL = (
    ("jitter mm ", "jitter.position", "eye", "rmse"),
    ("recovery s ", "recovery.time", "eye", "max"),
    ("left mm ", "recovery.offset", "eye", "max"),
    ("drift mm/h ", "drift.translation", "eye", "slope"),
)


def show_metrics(rows: Sequence[Row], table: str) -> None:
    """The headline numbers of each take and of all together; `table` is the file with the rest."""
    from vrbench.results.tables import STATUSES

    takes: dict[tuple[str, str, str, str, str], dict[tuple[str, ...], Row]] = {}
    for row in rows:
        if row.variant == "main" and row.band == "all" and row.segment == "all":
            place = (row.reference, row.case, row.condition, row.mount, row.repeat)
            take = takes.setdefault(place, {})
            take[row.metric, row.point, row.statistic] = row
    headlines: Sequence[tuple[str, str, str, str]]
    headlines = _HEADLINES if console().width >= _NARROW else _HEADLINES[:5]
    had = {key for take in takes.values() for key, row in take.items() if row.value is not None}
    headlines = (*headlines, *(special for special in _SPECIAL if special[1:] in had))
    lines = []
    errors = any(row.metric == _HEADLINES[0][1] for row in rows)
    several = len({row.reference for row in rows}) > 1
    for (reference, case, condition, mount, repeat), numbers in takes.items():
        cells = [numbers.get((metric, at, statistic)) for _, metric, at, statistic in headlines]
        if not any(cells):
            continue
        named = case if condition == "default" else f"{case} {condition}"
        named += f" by {reference}" if several else ""
        line = [named, "all" if mount == repeat == "all" else f"m{mount} r{repeat}"]
        shown = ["" if row is None else significant(row.value) for row in cells]
        status = min((r.status for r in numbers.values()), key=STATUSES.index)
        # A take that lacks some metric is ok; one that lacks the error asked for isn't scored.
        if status == "skipped" and (shown[0] if errors else any(shown)):
            status = "ok"
        lines.append([*line, *shown, status])
    header = ["case", "take", *(name for name, *_ in headlines), "status"]
    show_table("Metrics", header, lines)
    _show_compared(rows)
    click.echo(f"all {len(rows)} numbers: {table}")


def _show_compared(rows: Sequence[Row]) -> None:
    """By how much errors under each condition are above those under the baseline."""
    several = len({row.reference for row in rows}) > 1
    lines = [
        [
            f"{row.case} {row.condition}" + (f" by {row.reference}" if several else ""),
            f"{row.metric} {row.point}",
            significant(row.value),
            ""
            if row.ci_low is None
            else f"{significant(row.ci_low)} to {significant(row.ci_high)}",
            row.unit,
            row.status,
            row.reason,
        ]
        for row in rows
        if row.variant == "vs-baseline"
    ]
    if lines:
        header = ["case", "rmse of", "more by ", "95 % ", "", "status", ""]
        show_table("Against the baseline", header, lines)


@contextmanager
def bar(what: str) -> Iterator[Any]:
    """A progress bar on stderr: call it with a text and the part done, 0..1."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn(what.replace("{", "{{").replace("}", "}}"), markup=False),
        BarColumn(bar_width=30),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
        TextColumn("{task.description}", markup=False),
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
    """One line on stderr for each take that failed, is invalid, or was skipped as a whole."""
    told: dict[tuple[str, ...], None] = {}
    takes: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        if row.variant == "main" and row.repeat != "all":
            takes.setdefault((row.case, row.condition, row.mount, row.repeat), []).append(row)
    for take, mine in takes.items():
        skipped = all(row.status == "skipped" for row in mine)
        for row in mine:
            if skipped or row.status in ("invalid", "failed"):
                told[(*take, row.status, row.reason)] = None
    for case, condition, mount, repeat, status, reason in told:
        named = case if condition == "default" else f"{case} {condition}"
        click.echo(f"{status}: {named} mount {mount} repeat {repeat}: {reason}", err=True)
