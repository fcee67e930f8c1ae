"""Costs of scanners as given by the user: price and power; there are no default values."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ambinav.config import (
    ConfigModel,
    NonNegative,
    as_number,
    check_keys,
    checked,
    nearest,
    parse_yaml,
    read_text,
)
from ambinav.runtime.errors import InputError

NAME: Final = "scanner"
EXAMPLE: Final = "write scanner,price,power in the first line, or rplidar-a1: {price: 99, power: 3}"
"""Example of a file."""


class Cost(ConfigModel):
    """Cost of one scanner; None where it was not given.

    Attributes:
        price: Price in the user's currency, the same for all.
        power: Watts.
    """

    price: NonNegative | None = None
    power: NonNegative | None = None


@dataclass(frozen=True)
class Costs:
    """Costs of several scanners.

    Attributes:
        by_name: By the name of the scanner.
        source: The file that they were read from.
    """

    by_name: Mapping[str, Cost]
    source: str = "costs"

    def of(self, name: str) -> Cost:
        """Return the cost of a scanner; an unlisted scanner has neither price nor power."""
        return self.by_name.get(name, Cost())

    def remarks(self, compared: Iterable[str]) -> tuple[str, ...]:
        """Describe scanners that are listed but not compared, and the reverse, in sentences.

        Raises:
            InputError: none of those compared is listed.
        """
        names = tuple(compared)
        listed = [name for name in names if name in self.by_name]
        if not listed:
            first = next(iter(self.by_name))
            raise InputError(
                f"{self.source}: none of the scanners that are compared is listed ({first!r} is: "
                f"{nearest(first, names)}); name scanners as `ambinav presets` does."
            )
        missing = [name for name in names if name not in self.by_name]
        unused = [name for name in self.by_name if name not in names]
        return tuple(
            f"{self.source}: {text}: {', '.join(affected)}."
            for text, affected in (
                ("no price or power is given for", missing),
                ("listed but not compared", unused),
            )
            if affected
        )


def read_costs(path: str | Path) -> Costs:
    """Read a table of costs.

    `.csv`: a first line with `scanner` and one or both of `price` and `power`, then a line a
    scanner; an empty cell says that nobody knows. `.yaml`: a mapping from names of scanners to
    `{price: ..., power: ...}`, or a file of costs of `ambinav design for`, whose prices of scanners
    are taken.

    Raises:
        InputError: the file cannot be read, has another ending, names a scanner twice, or a value
            is no number from 0 on.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in (".csv", ".yaml", ".yml"):
        raise InputError(f"{path}: {path.suffix!r} is not a format of costs; give .csv or .yaml.")
    text = read_text(path)
    rows = _from_csv(text, path) if ending == ".csv" else _from_yaml(text, path)
    if not rows:
        raise InputError(f"{path}: no scanner is listed; {EXAMPLE}.")
    if not any(cost.price is not None or cost.power is not None for cost in rows.values()):
        raise InputError(f"{path}: no price and no power is given; {EXAMPLE}.")
    return Costs(rows, str(path))


def _from_csv(text: str, path: Path) -> dict[str, Cost]:
    try:
        lines = list(csv.reader(io.StringIO(text), skipinitialspace=True, strict=True))
    except csv.Error as error:
        raise InputError(f"{path}: this is not a CSV table ({error}); {EXAMPLE}.") from error
    if not lines or NAME not in (head := [cell.strip().lower() for cell in lines[0]]):
        raise InputError(f"{path}: line 1 has no column {NAME!r}; {EXAMPLE}.")
    if len(set(head)) < len(head):
        raise InputError(f"{path}: line 1 names a column twice; {EXAMPLE}.")
    try:
        check_keys(dict.fromkeys(head), (NAME, *Cost.model_fields))
    except InputError as error:
        raise InputError(f"{path}: line 1: {error}") from error
    costs: dict[str, Cost] = {}
    for number, line in enumerate(lines[1:], start=2):
        if not any(cell.strip() for cell in line):
            continue
        where = f"{path}: line {number}"
        if len(line) != len(head):
            raise InputError(f"{where} has {len(line)} cells; give {len(head)}: {', '.join(head)}.")
        cells = dict(zip(head, map(str.strip, line), strict=True))
        name = cells.pop(NAME)
        if not name or name in costs:
            fault = f"{name!r} is listed twice" if name else "the scanner has no name"
            raise InputError(f"{where}: {fault}; give each scanner one line.")
        values = {key: as_number(cell, f"{where}: {key}") for key, cell in cells.items() if cell}
        costs[name] = checked(Cost, values, where)
    return costs


def _from_yaml(text: str, path: Path) -> dict[str, Cost]:
    plain = parse_yaml(text, str(path), EXAMPLE)
    if not isinstance(plain, dict):
        raise InputError(f"{path}: this is not a mapping from scanners to costs; {EXAMPLE}.")
    prices = plain.get(NAME)
    if isinstance(prices, dict) and not prices.keys() <= Cost.model_fields.keys():
        # Of `ambinav design for`, with prices of posts and others beside them.
        plain = {name: {"price": price} for name, price in prices.items()}
    return {
        str(name): checked(Cost, {} if row is None else row, f"{path}: {name}")
        for name, row in plain.items()
    }
