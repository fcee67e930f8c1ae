"""Sources of an environment's buildings: a suite, or one map."""

from __future__ import annotations

from collections import OrderedDict
from pathlib import Path
from typing import Any, Final

import numpy as np

from ambinav.buildings.load import load_environment
from ambinav.config import as_count
from ambinav.geometry.environment import Environment
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav_envs.buildings.building import Building
from ambinav_envs.buildings.suites import suite

# Numbers of buildings end below this, so that each has one as a 32-bit integer.
_END: Final = 2**31


class BuildingSource:
    """Buildings of a suite by number, or the building of one map.

    Two sources of a suite share no building if their ranges of numbers do not meet: train on
    `first=0, count=1000`, test on `first=1000, count=100`.

    Args:
        source: Name of a suite, an environment file, or an environment.
        scanner: The robot's scanner.
        robot_radius: Radius of the robot's disc, metres.
        count: How many buildings of the suite there are; None: any number, so that hardly one is
            met twice, and no map is kept on disk. Messages call it `buildings`, and the next
            `first_building`, as the environments do.
        first: Number of the first one.
        spacing: Spacing of the ambiguity maps' lattices, metres.
        held: How many buildings are held in memory, those used last; each takes
            about a megabyte.
        layers: Layers of their maps beside those of `Building`.

    Raises:
        InputError: there is no such suite or file, or a number makes no sense.
    """

    def __init__(
        self,
        source: str | Path | Environment,
        scanner: RangeScanner,
        robot_radius: float,
        *,
        count: int | None = None,
        first: int = 0,
        spacing: float = 0.2,
        held: int = 512,
        layers: tuple[str, ...] = (),
    ) -> None:
        self._scanner = scanner
        self._radius = float(robot_radius)
        self._spacing = float(spacing)
        self._held = as_count(held, "held")
        self._layers = layers
        self._buildings: OrderedDict[int, Building] = OrderedDict()
        self._map: Environment | None = None
        if not isinstance(source, str | Path | Environment):
            raise InputError(
                f"the buildings are of the type {type(source).__name__}; name a suite, or give an "
                "environment file or an Environment."
            )
        if isinstance(source, str) and not Path(source).suffix and Path(source).name == source:
            self.name = suite(source).name
        else:
            self._map = source if isinstance(source, Environment) else load_environment(source)
            self.name = self._map.name
        if self._map is not None and (count not in (None, 1) or first != 0):
            raise InputError(
                f"{self.name} is one building, but buildings is {count!r} and first_building "
                f"{first!r}; leave them out, or name a suite."
            )
        is_integer = isinstance(first, int | np.integer) and not isinstance(first, bool)
        if not is_integer or not 0 <= first < _END:
            raise InputError(
                f"first_building is {first!r}; give the number of a building, from 0 on."
            )
        self.first = int(first)
        self.count = None if count is None else as_count(count, "buildings")
        if self.count is not None and self.first + self.count > _END:
            raise InputError(
                f"buildings is {count} from first_building {first} on; numbers end at {_END - 1}."
            )
        if self._map is not None:
            self.count = 1

    def __repr__(self) -> str:
        """Return name and range."""
        last = "" if self.count is None else self.first + self.count - 1
        return f"BuildingSource({self.name!r}, {self.first}..{last})"

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the buildings, which are drawn again where they are needed."""
        return self.__dict__ | {"_buildings": OrderedDict()}

    @property
    def environment(self) -> Environment | None:
        """The building of a map; None: it is a suite."""
        return self._map

    def at(self, share: float) -> Building:
        """Return the building at a fraction from [0, 1) of all; a uniform fraction draws evenly."""
        count = _END - self.first if self.count is None else self.count
        return self.get(self.first + int(share * count))

    def get(self, which: int | str) -> Building:
        """Return the building with this number or key.

        The same object is given out as long as it is held.

        Args:
            which: Its number, from `first` on, or its key: "office-3" is number 3 of the suite.

        Raises:
            InputError: there is none.
        """
        number = self._number(which)
        if number in self._buildings:
            self._buildings.move_to_end(number)
            return self._buildings[number]
        if self._map is None:
            environment, keep = suite(self.name).building(number), self.count is not None
        else:
            environment, keep = self._map, True
        building = Building.of(
            environment, self._scanner, self._radius, self._spacing, keep=keep, layers=self._layers
        )
        self._buildings[number] = building
        while len(self._buildings) > self._held:
            self._buildings.popitem(last=False)
        return building

    def _number(self, which: int | str) -> int:
        number: int | None = None
        if isinstance(which, str):
            name, _, digits = which.rpartition("-")
            if self._map is not None:
                number = 0 if which == self.name else None
            elif name == self.name and digits.isascii() and digits.isdigit():
                number = int(digits)
        elif isinstance(which, int | np.integer) and not isinstance(which, bool):
            number = int(which)
        end = _END if self.count is None else self.first + self.count
        if number is None or not self.first <= number < end:
            keys = repr(self.name)
            if self._map is None:
                keys = f"'{self.name}-{self.first}' to '{self.name}-{end - 1}'"
            raise InputError(
                f"there is no building {which!r}; give a number from {self.first} to {end - 1}, or "
                f"a key: {keys}."
            )
        return number
