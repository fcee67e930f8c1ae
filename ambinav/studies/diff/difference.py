"""The difference of two ambiguity maps."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.judged_floor import JudgedFloor
from ambinav.runtime.array_types import Floats
from ambinav.studies.diff.provenance import ParameterPart, differing_parameters, same_content
from ambinav.studies.diff.regions import RegionPart, changed_regions
from ambinav.studies.diff.registration import CommonLattice, ReadMap, common_lattice, read_on
from ambinav.studies.diff.walls import missing_walls, tolerance


@dataclass(frozen=True, eq=False)
class Difference:
    """Two maps on one lattice.

    Attributes:
        first: The map before.
        second: The map after.
        lattice: Cells that cover both.
        before: The first map, read there.
        after: The second.
        parts: Masks of the floor that counts, in both maps.
        regions: Regions that differ, the most important first.
        new_walls: Stretches that only the second has, ax, ay, bx, by, metres, shape (N, 4).
        gone_walls: Walls that only the first map has.
        wall_tolerance: Metres that a wall may be off and still be the same.
        parameters: Parameters and inputs that differ.
        identical: Whether nothing differs at all, bit for bit.
    """

    first: AmbiguityMap
    second: AmbiguityMap
    lattice: CommonLattice
    before: ReadMap
    after: ReadMap
    parts: tuple[JudgedFloor, JudgedFloor]
    regions: tuple[RegionPart, ...]
    new_walls: Floats
    gone_walls: Floats
    wall_tolerance: float
    parameters: tuple[ParameterPart, ...]
    identical: bool

    @property
    def rise(self) -> Floats:
        """Level after less level before, shape (ny, nx); nan where floor counts in one or none."""
        return self.after.level - self.before.level

    @property
    def layers(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Layers that only the first map has, and those that only the second has."""
        ours, theirs = set(self.first.layers), set(self.second.layers)
        return tuple(sorted(ours - theirs)), tuple(sorted(theirs - ours))


def difference(
    first: AmbiguityMap, second: AmbiguityMap, *, wall_tolerance: float | None = None
) -> Difference:
    """Compare two maps; they are registered by their frame.

    Floor counts that is judged in both (`AmbiguityMap.judged`).

    Args:
        first: The map before.
        second: The map after.
        wall_tolerance: Metres that a wall may be off and still be the same, above zero; None: two
            cells of the occupancy map, at least 0.1.

    Raises:
        InputError: the maps are in different frames, or do not overlap.
    """
    lattice = common_lattice(first, second)
    parts = first.judged, second.judged
    before, after = read_on(lattice, first, parts[0]), read_on(lattice, second, parts[1])
    close = wall_tolerance or tolerance(*(_resolution(amap) for amap in (first, second)))
    parameters = differing_parameters(first, second)
    return Difference(
        first=first,
        second=second,
        lattice=lattice,
        before=before,
        after=after,
        parts=parts,
        regions=changed_regions(lattice, before, after),
        new_walls=missing_walls(second.segments, first.segments, close),
        gone_walls=missing_walls(first.segments, second.segments, close),
        wall_tolerance=close,
        parameters=parameters,
        identical=not parameters
        and np.array_equal(before.state, after.state)
        and same_content(first, second),
    )


def _resolution(amap: AmbiguityMap) -> float | None:
    """Return the cell size of the occupancy map behind a map, metres; None for a drawn plan."""
    resolution = json.loads(amap.dataset.attrs.get("environment_resolution", "null"))
    return None if resolution is None else float(resolution)
