"""The suites: families of buildings by name, and the buildings of each by number."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ambinav.config import nearest
from ambinav.geometry.environment import Environment
from ambinav.runtime.errors import InputError
from ambinav_envs.buildings import drawn
from ambinav_envs.buildings.cluttered import cluttered_building
from ambinav_envs.buildings.plan import Plan
from ambinav_envs.buildings.plan_sampler import PlanSampler
from ambinav_envs.buildings.procedural import procedural_building

# Buildings of the drawn families are turned by up to this, degrees, so that their walls do not lie
# along the axes; the plain one is not.
TURN = 20.0
# Joins the names of the suites of a mixture.
MIX = "+"


@dataclass(frozen=True)
class Suite:
    """A family of buildings.

    Attributes:
        name: Lower-case.
        title: What makes it hard, in a few words.
        draw: The building of a number from 0 on and with a name; the same one in every process.
            Of the drawn families number 0 is the plain building.
    """

    name: str
    title: str
    draw: Callable[[int, str], Environment]

    def building(self, variant: int) -> Environment:
        """Return the building with this number; its name consists of suite and number."""
        return self.draw(variant, f"{self.name}-{variant}")


def suite(name: str) -> Suite:
    """Return the suite of this name, or a mixture of suites whose names are joined by a plus.

    Number k of a mixture of n suites is building k of the suite at position k modulo n: as often as
    a suite is named, as much of it there is, and a range of numbers is the same range in each.

    Raises:
        InputError: there is none; the nearest names are offered.
    """
    if MIX in name:
        members = [suite(part) for part in name.split(MIX)]
        return Suite(
            name,
            f"a mixture of {', '.join(dict.fromkeys(member.name for member in members))}",
            lambda variant, called: members[variant % len(members)].draw(variant, called),
        )
    if name not in _suites:
        raise InputError(f"there is no suite {name!r} of buildings; {nearest(name, _suites)}.")
    return _suites[name]


def suite_names() -> tuple[str, ...]:
    """Return the names of all suites."""
    return tuple(_suites)


def register_suite(new: Suite) -> Suite:
    """Register a suite.

    Raises:
        InputError: another one has the name.
    """
    if _suites.setdefault(new.name, new) is not new:
        raise InputError(
            f"there is a suite {new.name!r} of buildings already; choose another name."
        )
    return new


def _rng(name: str, variant: int) -> np.random.Generator:
    return np.random.default_rng([zlib.crc32(name.encode()), variant])


def _family(name: str, title: str, draw: Callable[[PlanSampler], Plan]) -> None:
    def of_variant(variant: int, called: str) -> Environment:
        sampler = PlanSampler(None if variant == 0 else _rng(name, variant))
        return draw(sampler).environment(called, sampler.between(-TURN, TURN))

    register_suite(Suite(name, title, of_variant))


_suites: dict[str, Suite] = {}
_family("hall", "a hall wider than the range, bare in its middle", drawn.hall)
_family("corridor", "a long bare corridor beside a row of furnished rooms", drawn.corridor)
_family("office", "furnished rooms on both sides of a corridor", drawn.office)
_family("warehouse", "rows of equal racks", drawn.warehouse)
_family("loop", "a ring of corridors, bare on some sides", drawn.loop)
register_suite(
    Suite(
        "procedural",
        "rooms, corridors at odd angles, halls and racks, drawn from a generator",
        lambda variant, called: procedural_building(_rng("procedural", variant), name=called),
    )
)
register_suite(
    Suite(
        "cluttered",
        "as recorded maps are: ragged walls, narrow doors, furniture and legs of tables and chairs",
        lambda variant, called: cluttered_building(_rng("cluttered", variant), name=called),
    )
)
