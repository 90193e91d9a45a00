"""A report on the terminal: the verdict, facts as lines, tables; figures are on the page only."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rendering.plain import PIPE_WIDTH, UNBROKEN_WORD_CHARACTERS, PlainText, plain_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console
    from rich.table import Table as Grid

    from rendering.report import Report, Section, Table

NAME = 13
"""Width, in characters, of the names of facts."""


def show(report: Report, to: Console | PlainText) -> None:
    """Show a report."""
    if report.refusal:
        to.print(report.refusal, style="bold")
    for line in report.verdict.splitlines():
        to.print(line, style="bold")
    for section in report.sections:
        if not section.detail and (section.table is not None or section.figure is None):
            _show(section, to)


def _show(section: Section, to: Console | PlainText) -> None:
    table = section.table
    if table is None:
        _facts([(section.title.lower(), section.text)], to)
    elif any(table.head):
        for line in (section.title, *section.text.splitlines()):
            to.print(line)
        _print_table(table, to)
    else:
        _facts(table.rows, to)


def _facts(rows: Sequence[Sequence[str]], to: Console | PlainText) -> None:
    for name, text in rows:
        for number, line in enumerate(text.splitlines()):
            to.print(f"{'' if number else name:<{NAME - 1}} {line}")


def _print_table(table: Table, to: Console | PlainText) -> None:
    if not isinstance(to, PlainText):
        to.print(_grid(table, to))
    elif (text := plain_table(table, PIPE_WIDTH)) is not None and to.in_unicode:
        to.print(text)
    else:
        to.rich.print(_grid(table, to.rich))


def _grid(table: Table, to: Console) -> Grid:
    from rich import box
    from rich.table import Table as Grid

    grid = Grid(box=box.SIMPLE, padding=(0, 1, 0, 0))
    for name, *cells in zip(table.head, *table.rows, strict=True):
        longest = max(len(word) for cell in (name, *cells) for word in [*cell.split(), ""])
        grid.add_column(name, overflow="fold", min_width=min(longest, UNBROKEN_WORD_CHARACTERS))
    for row in table.rows:
        grid.add_row(*row)
    options = to.options.update(width=to.width if to.is_terminal else PIPE_WIDTH)
    grid.width = to.measure(grid, options=options).maximum
    return grid
