"""Text and tables on the terminal; nothing in a text is taken for markup."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import typer

if TYPE_CHECKING:
    from pydantic import BaseModel
    from rich.table import Table
    from rich.text import Text

T = TypeVar("T", bound="BaseModel")


def show(*parts: str | Text | Table, width: int | None = None, wrap: bool = True) -> None:
    """Print texts and tables on stdout, one below the other.

    Args:
        parts: What to print; "" is an empty line.
        width: Columns of text where there is no terminal; None: as always.
        wrap: Whether to wrap lines at the width of the terminal.
    """
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False)
    if width is not None and not console.is_terminal:
        console = Console(highlight=False, width=width)
    shown = (Text(part) if isinstance(part, str) else part for part in parts)
    console.print(*shown, sep="\n", soft_wrap=not wrap)


def finish(
    report: T,
    show_text: Callable[[T], None],
    page: Path | str | None = None,
    *,
    as_json: bool,
    quiet: bool = False,
) -> None:
    """Print a report as JSON, or as text with the path of its page.

    Args:
        report: The report.
        show_text: Prints its text.
        page: Its page; None: there is none, or the text names it.
        as_json: Print JSON.
        quiet: Print nothing but JSON.
    """
    if as_json:
        typer.echo(report.model_dump_json(indent=2))
    elif not quiet:
        show_text(report)
        if page is not None:
            show("", f"report: {page}", wrap=False)


def table(
    columns: Iterable[str],
    rows: Iterable[Iterable[str]],
    *,
    left: Collection[str] = (),
    no_wrap: Collection[str] = (),
    fold: bool = False,
    title: str | None = None,
    **options: Any,
) -> Table:
    """Return a plain table.

    Args:
        columns: Titles of the columns.
        rows: Cells of each row.
        left: Columns that are not aligned to the right.
        no_wrap: Columns that are not wrapped.
        fold: Whether words that are wider than their column go on in the next line.
        title: Title above the table.
        options: Further options of `rich.table.Table`.
    """
    from rich.table import Table
    from rich.text import Text

    heading = None if title is None else Text(title)
    made = Table(box=None, pad_edge=False, title=heading, title_justify="left", **options)
    for column in columns:
        justify: Any = "left" if column in left else "right"
        overflow: Any = "fold" if fold else "ellipsis"
        made.add_column(column, justify=justify, no_wrap=column in no_wrap, overflow=overflow)
    for row in rows:
        made.add_row(*map(Text, row))
    return made
