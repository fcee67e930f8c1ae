"""The suites: sets of buildings and of what the leaderboard does there, by name."""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

import numpy as np

from ambinav.geometry.environment import Environment
from ambinav.plugins import Registry
from ambinav.runtime.errors import InputError
from ambinav_envs.buildings import drawn
from ambinav_envs.buildings.cluttered import cluttered_building
from ambinav_envs.buildings.plan import Plan
from ambinav_envs.buildings.plan_sampler import PlanSampler
from ambinav_envs.buildings.procedural import procedural_building
from ambinav_envs.buildings.twin_rooms import twin_rooms

# Buildings of the drawn families are turned by up to this, degrees, so that their walls do not lie
# along the axes; the plain one is not.
TURN = 20.0
# Joins the names of the suites of a mixture.
MIX = "+"

CONDITIONS: Final[Mapping[str, Mapping[str, Any]]] = {
    "as mapped": {},
    "disturbed": {"obstacles": 6, "people": 3, "odometry_scale": 2.0},
}
"""Arguments of the environment beside the common ones. Disturbed: boxes that the map lacks, people
who walk about, and odometry that errs twice as much as the localizer assumes."""
STANDARD: Final = "standard"
"""The suite of a leaderboard for which nobody names another."""


@dataclass(frozen=True)
class Suite:
    """An entry of the registry: buildings, and settings and methods of a leaderboard there.

    Attributes:
        name: Lower-case.
        title: What makes it hard, in a few words.
        draw: The building of a number from 0 on and with a name; the same one in every process.
            Of the drawn families number 0 is the plain building. None: those of `members`.
        members: Names of other suites. Building k is that of the suite at position k modulo their
            number: as often as a suite is named, as much of it there is, and a range of numbers is
            the same range in each. A leaderboard has each member apart.
        conditions: Arguments of the environment in each setting of a leaderboard, by its name.
        planners: Planners of a leaderboard, each NAME or NAME:WEIGHT; none: the usual ones.
        policies: Policies of a leaderboard, as `load_policy` takes them; None: the reactive
            baselines.

    Raises:
        InputError: the name has other characters than letters, digits, - and _, or there are no
            buildings.
    """

    name: str
    title: str
    draw: Callable[[int, str], Environment] | None = None
    members: tuple[str, ...] = ()
    conditions: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: CONDITIONS)
    planners: tuple[str, ...] = ()
    policies: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        """Check the name, and that there are buildings and conditions."""
        if not re.fullmatch(r"[\w-]+", self.name):
            raise InputError(
                f"suite {self.name!r}: the name has other characters than letters, digits, - and "
                "_; choose another name."
            )
        if (self.draw is None) is not bool(self.members):
            raise InputError(f"suite {self.name!r}: give either draw or members.")
        if not self.conditions:
            raise InputError(f"suite {self.name!r}: conditions are none; give at least one.")
        for condition, arguments in self.conditions.items():
            if not isinstance(arguments, Mapping):
                raise InputError(
                    f"suite {self.name!r}: condition {condition!r} is {arguments!r}; give "
                    "arguments of the environment by their names, or {} for none."
                )

    def building(self, variant: int) -> Environment:
        """Return the building with this number; its name consists of suite and number."""
        return self._draw(variant, f"{self.name}-{variant}")

    def functions(self) -> list[Callable[[int, str], Environment]]:
        """Return the functions that draw its buildings."""
        if self.draw is not None:
            return [self.draw]
        return [function for member in self.members for function in suite(member).functions()]

    def leaves(self) -> set[str]:
        """Return the names of the suites that draw its buildings: its own, or those of members."""
        if self.draw is not None:
            return {self.name}
        return set[str]().union(*(suite(member).leaves() for member in self.members))

    def _draw(self, variant: int, called: str) -> Environment:
        if self.draw is None:
            return suite(self.members[variant % len(self.members)])._draw(variant, called)
        with SUITES.calling(self.name):
            environment = self.draw(variant, called)
            if not isinstance(environment, Environment):
                raise TypeError(f"it is not an Environment but {environment!r}")
            if environment.name != called:
                raise ValueError(f"it is called {environment.name!r}, not {called!r}")
        return environment


class _Mixture(Suite):
    """Suites by their joined names, which no entry of the registry may have."""

    def __post_init__(self) -> None:
        """Check nothing: the members are checked."""


def suite(name: str, above: tuple[str, ...] = ()) -> Suite:
    """Return the suite of this name, or a mixture of suites whose names are joined by a plus.

    Args:
        name: The name.
        above: Names of the suites that it is a member of.

    Raises:
        InputError: there is none, and the nearest names are offered; or it is a member of itself.
    """
    path = (*above, name)
    if name in above:
        raise InputError(
            f"suite {name!r} is a member of itself ({' > '.join(path)}); leave out one of them."
        )
    if MIX not in name:
        entry = SUITES.get(name)
        for member in entry.members:
            suite(member, path)
        return entry
    members = [suite(part, path).name for part in name.split(MIX)]
    return _Mixture(name, f"a mixture of {', '.join(dict.fromkeys(members))}", members=(*members,))


def _rng(name: str, variant: int) -> np.random.Generator:
    return np.random.default_rng([zlib.crc32(name.encode()), variant])


def _family(name: str, title: str, draw: Callable[[PlanSampler], Plan]) -> Suite:
    def of_variant(variant: int, called: str) -> Environment:
        sampler = PlanSampler(None if variant == 0 else _rng(name, variant))
        return draw(sampler).environment(called, sampler.between(-TURN, TURN))

    return Suite(name, title, of_variant)


def _itself(entry: Suite) -> Suite:
    return entry


_SHIPPED = (
    _family("hall", "a hall wider than the range, bare in its middle", drawn.hall),
    _family("corridor", "a long bare corridor beside a row of furnished rooms", drawn.corridor),
    _family("office", "furnished rooms on both sides of a corridor", drawn.office),
    _family("warehouse", "rows of equal racks", drawn.warehouse),
    _family("loop", "a ring of corridors, bare on some sides", drawn.loop),
    _family(
        "twin-rooms-seen",
        "two equal wings, and a post that tells them apart is seen in passing",
        partial(twin_rooms, wings=2, depths=(0.0, 0.0)),
    ),
    _family(
        "twin-rooms",
        "two equal wings, and a post behind a passage of 1 to 6 m that tells them apart",
        partial(twin_rooms, wings=2, depths=(1.0, 6.0)),
    ),
    _family(
        "triple-rooms",
        "three equal wings, one of which has a post behind a passage of 1 to 6 m",
        partial(twin_rooms, wings=3, depths=(1.0, 6.0)),
    ),
    Suite(
        "procedural",
        "rooms, corridors at odd angles, halls and racks, drawn from a generator",
        lambda variant, called: procedural_building(_rng("procedural", variant), name=called),
    ),
    Suite(
        "cluttered",
        "as recorded maps are: ragged walls, narrow doors, furniture and legs of tables and chairs",
        lambda variant, called: cluttered_building(_rng("cluttered", variant), name=called),
    ),
    # In halls a path around the open middle is what helps.
    Suite(STANDARD, "procedural buildings and halls", members=("procedural", "hall")),
)
SUITES: Final = Registry(
    "suite", Suite, "ambinav.suites", {entry.name: partial(_itself, entry) for entry in _SHIPPED}
)
"""The suites: ours, and those of plug-ins."""
