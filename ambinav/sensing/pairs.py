"""Measured pairs of true range and reading, from a CSV file or an array."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import read_text
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError

COLUMNS = ("true_range", "reading")


def load_pairs(pairs: str | Path | ArrayLike) -> tuple[Floats, str, list[str]]:
    """Return measured pairs.

    Args:
        pairs: A CSV file with a header that names true_range and reading, or without a header
            and with these two columns; empty lines and lines from # on are skipped. Or an array
            of shape (n, 2). Metres.

    Returns:
        The pairs, float64 of shape (n, 2); what to call their origin; the name of each row's
        place for messages.

    Raises:
        InputError: the file cannot be read, a cell is not a finite number, or a true range is
            negative.
    """
    if isinstance(pairs, str | Path):
        origin = str(pairs)
        rows = list(_rows(read_text(Path(pairs)), origin))
        places = [f"{origin}: line {line}" for line, _ in rows]
        values = np.array([row for _, row in rows], dtype=np.float64).reshape(-1, 2)
    else:
        origin = "an array of pairs"
        try:
            values = np.asarray(pairs, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(
                f"pairs cannot be read as numbers ({error}); give an array of shape (n, 2)."
            ) from error
        if values.ndim != 2 or values.shape[1] != 2:
            raise InputError(
                f"pairs have the shape {values.shape}; give (n, 2) with the columns "
                "true_range and reading."
            )
        places = [f"pairs: row {i}" for i in range(len(values))]
    for place, (true_range, reading) in zip(places, values.tolist(), strict=True):
        for column, value in zip(COLUMNS, (true_range, reading), strict=True):
            if not math.isfinite(value):
                raise InputError(
                    f"{place}: {column} is {value}; give metres, and leave out pairs without echo."
                )
        if true_range < 0:
            raise InputError(f"{place}: true_range is {true_range}; give at least 0 metres.")
    return values, origin, places


def _rows(text: str, origin: str) -> Iterator[tuple[int, tuple[float, float]]]:
    """Yield line number and the two numbers of each row."""
    reader = csv.reader(io.StringIO(text))
    order: tuple[int, int] | None = None
    try:
        for cells in reader:
            cells = [cell.strip() for cell in cells]
            if not any(cells) or cells[0].startswith("#"):
                continue
            if order is None:
                header = _header(cells, f"{origin}: line {reader.line_num}")
                order = header or (0, 1)
                if header:
                    continue
            yield reader.line_num, _numbers(cells, order, f"{origin}: line {reader.line_num}")
    except csv.Error as error:
        raise InputError(
            f"{origin}: line {reader.line_num}: not CSV ({error}); save the table as CSV."
        ) from error


def _header(cells: list[str], place: str) -> tuple[int, int] | None:
    """Return where a header names the two columns; None where the line holds numbers."""
    names = [cell.lower() for cell in cells]
    if all(name in names for name in COLUMNS):
        return names.index(COLUMNS[0]), names.index(COLUMNS[1])
    if any(_is_number(cell) for cell in cells):
        return None
    raise InputError(
        f"{place}: the header is {','.join(cells)!r}; name the columns true_range,reading."
    )


def _numbers(cells: list[str], order: tuple[int, int], place: str) -> tuple[float, float]:
    if len(cells) <= max(order):
        raise InputError(
            f"{place}: {','.join(cells)!r} has too few cells; give true_range,reading separated "
            "by a comma."
        )
    for column, i in zip(COLUMNS, order, strict=True):
        if not _is_number(cells[i]):
            raise InputError(
                f"{place}: {column} is {cells[i]!r}, not a number; correct or remove the line."
            )
    return float(cells[order[0]]), float(cells[order[1]])


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
