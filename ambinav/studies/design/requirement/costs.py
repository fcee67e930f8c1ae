"""Costs of changes, from the user's file: there are no default values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Final, TypeAlias

from pydantic import Field

from ambinav.config import ConfigModel, checked, nearest, number, parse_yaml, read_text
from ambinav.runtime.errors import InputError
from ambinav.studies.design.place.candidates import KINDS, Kind

OPTION: Final = "--may"
EXAMPLE: Final = {
    "post": "post: 40", "panel": "panel: 60", "tag": "tag: 15", "mount": "mount: 200",
    "scanner": "scanner: {rplidar-a1: 99}",
}  # fmt: skip
SWITCHES: Final = ("scanner", "mount", "second-scanner")


DEAREST: Final = 1e9
Amount: TypeAlias = Annotated[float, number(least=0, most=DEAREST)]
Price: TypeAlias = Annotated[float, number(above=0, most=DEAREST)]


class Costs(ConfigModel):
    """Costs of changes in the user's currency; None where the file gives none.

    Attributes:
        post: Of a post, put up; so are the next two.
        panel: Of a panel.
        tag: Of a tag.
        mount: Of mounting the scanner elsewhere.
        scanner: Of another or a second scanner, by preset or file.
    """

    post: Price | None = None
    panel: Price | None = None
    tag: Price | None = None
    mount: Amount | None = None
    scanner: dict[str, Amount] = Field(default_factory=dict)

    def prices(self) -> dict[Kind, float]:
        """Return the prices of obstacles by kind, of those that have one."""
        every = {kind: getattr(self, kind) for kind in KINDS}
        return {kind: price for kind, price in every.items() if price is not None}


def read_costs(path: str | Path) -> Costs:
    """Read a file of costs.

    Raises:
        InputError: it cannot be read, has an unknown key, or a value that is no cost.
    """
    path = Path(path)
    example = f"write a line such as {EXAMPLE['post']}"
    return checked(Costs, parse_yaml(read_text(path), str(path), example), str(path))


@dataclass(frozen=True)
class Allowed:
    """Changes that are allowed.

    Attributes:
        most: Largest number of obstacles of each allowed kind.
        scanner: Whether another scanner is allowed.
        mount: Whether another mount is.
        second_scanner: Whether a second scanner is.
    """

    most: Mapping[Kind, int] = field(default_factory=dict)
    scanner: bool = False
    mount: bool = False
    second_scanner: bool = False

    @classmethod
    def parse(cls, text: str) -> Allowed:
        """Read a list such as "posts=8,panels=4,tags=6,scanner,mount,second-scanner".

        Raises:
            InputError: a change is unknown or named twice, or a number is missing or not one.
        """
        kind_of = {f"{kind}s": kind for kind in KINDS}
        most: dict[Kind, int] = {}
        switches: set[str] = set()
        for entry in (part.strip() for part in text.split(",")):
            name, equals, number = (part.strip() for part in entry.partition("="))
            if name not in kind_of and name not in SWITCHES:
                offer = nearest(name, (*kind_of, *SWITCHES))
                raise InputError(f"{OPTION}: {name!r} is not a change; {offer}.")
            if name in switches or kind_of.get(name) in most:
                raise InputError(f"{OPTION}: {name} is named twice; name it once.")
            if name in SWITCHES:
                if equals:
                    raise InputError(f"{OPTION}: {entry!r}: {name} has no number; write {name}.")
                switches.add(name)
                continue
            if not number.isdecimal() or int(number) < 1:
                fault = f"is {number!r}, not a whole number from 1 on" if equals else "is missing"
                raise InputError(
                    f"{OPTION}: {entry!r}: the number of {name} {fault}; write {name}=4."
                )
            most[kind_of[name]] = int(number)
        return cls(most, *(name in switches for name in SWITCHES))

    def check(self, costs: Costs, source: str) -> None:
        """Check that each allowed change has a cost.

        Raises:
            InputError: one has none; the message names the file, the key and an example.
        """
        needed = [*self.most, *(["mount"] if self.mount else [])]
        if self.scanner or self.second_scanner:
            needed.append("scanner")
        for key in needed:
            if getattr(costs, key) in (None, {}):
                raise InputError(
                    f"{source}: {OPTION} allows a {key} but the key {key!r} gives no cost; add "
                    f"e.g. `{EXAMPLE[key]}`."
                )
