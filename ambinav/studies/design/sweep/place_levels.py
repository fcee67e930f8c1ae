"""Levels at the places of a region for several scanners, as `build_map` computes them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ambinav.ambiguity.feasible_poses import standing_lattice
from ambinav.ambiguity.model import AmbiguityModel
from ambinav.ambiguity.neighbourhoods import points_near
from ambinav.ambiguity.panorama import view_radii
from ambinav.ambiguity.tensor import classify, classify_over_headings
from ambinav.geometry.collision.reach import Reach
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.maps.zones import NOT_FREE
from ambinav.runtime.array_types import Bytes, Floats, Floats32, Indices
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Progress, silent
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.design.explored import explored
from ambinav.studies.design.region import Places, Region
from ambinav.studies.design.views import mask_of, scanner_views

MOST_BYTES: Final = 4e9
"""Most bytes of kept levels and zones."""


@dataclass(frozen=True, eq=False)
class PlaceLevels:
    """Levels of S scanners at K places and H headings of each.

    Attributes:
        x: x of the places, float64, shape (K,), metres, map frame.
        y: y of the places, likewise.
        places: The places with their weights.
        amount: All floor or travel that counts, in the region's unit.
        headings: Radians: of a map or polygon the H headings, of a route those that its places
            refer to.
        level: float32, shape (S, K, H), nan where the robot cannot stand; H is 1 on a route.
        zone: Codes of zones, uint8, shape (S, K, H): of several headings, those in the mean.
        model: The parameters; its tau is that of none of the scanners.
    """

    x: Floats
    y: Floats
    places: Places
    amount: float
    headings: Floats
    level: Floats32
    zone: Bytes
    model: AmbiguityModel


def place_levels(
    env: Environment,
    scanners: Sequence[RangeScanner],
    region: Region,
    headings: Floats,
    *,
    floor_of: RangeScanner,
    floor_headings: int | None = None,
    reach: Reach | None = None,
    spacing: float,
    radius: float,
    map_std: float | None = None,
    most_places: int = 0,
    rng: np.random.Generator,
    order: Sequence[int] | None = None,
    progress: Progress = silent,
) -> PlaceLevels:
    """Compute the levels at the places of a region for several scanners.

    A scanner that looks all around is computed once for all headings, in the robot's centre if it
    sits near it (`RangeScanner.centred`), as a map without headings is.

    Args:
        env: The environment.
        scanners: S of them. Of each as many beams take part as in a map.
        region: The region.
        headings: Headings of the robot, radians, shape (H,).
        floor_of: Scanner whose map defines the explored floor of a map or polygon.
        floor_headings: Headings of that map, as for `build_map`.
        reach: And what the robot reaches of it; None: all. A route counts whole.
        spacing: As for `build_map`, like the next two.
        radius: Radius of the neighbourhoods.
        map_std: Deviation of the walls.
        most_places: Maximum number of evaluated places, evenly spread; 0: all places.
        rng: Chooses them.
        order: Order of the computation: scanners whose beams coincide should follow each
            other, for these are cast once. None: as they come.
        progress: Called with the share done, from 0 to 1.

    Raises:
        InputError: the region is empty, a number is out of its range, or there is too much to keep.
    """
    model = AmbiguityModel(
        radius=radius, map_std=env.map_std if map_std is None else map_std, tau=1.0
    )
    body = RangeScanner.planar(scanners[0].sensors[0], 1, 0.0)
    # In space too the floor of the plan: settings differ in where they can stand on it.
    lattice, _ = standing_lattice(Lattice.over(env.plan, spacing), body, np.zeros(1))
    lattice = replace(lattice, environment=env)
    places = region.places(lattice, headings, reach)
    amount = float(places.weight.sum())
    if region.kind != "route":
        is_explored = explored(lattice, floor_of, places.point, model, floor_headings)
        if not is_explored.any():
            raise InputError(
                f"region {region.title}: none of its floor in {env.name} is explored: with scanner "
                f"{floor_of.name!r} half of the beams or more end in unknown space, or a sensor "
                "stands in a wall; give another region, or check the mounts (metres)."
            )
        places = replace(places.among(is_explored), of=int(is_explored.sum()))
        amount = len(places) * lattice.cell_area
    if most_places:
        places = places.sampled(lattice, most_places, rng)
    on_route = region.kind == "route"
    shape = len(scanners), len(places), 1 if on_route else len(headings)
    if 5.0 * math.prod(shape) > MOST_BYTES:
        raise InputError(
            f"places: {shape[0]} settings at {shape[1]} places and {shape[2]} headings are more "
            "than can be kept; sample fewer places, or vary in wider steps."
        )
    x, y = (axis[places.point] for axis in lattice.points)
    near = points_near(lattice, mask_of(places.point, len(lattice.rows_columns)), radius)
    lattice, point = lattice.among(near), np.searchsorted(np.flatnonzero(near), places.point)
    level = np.full(shape, np.nan, dtype=np.float32)
    zone = np.full(shape, NOT_FREE, dtype=np.uint8)
    done = 0.0
    for here, angles in _groups(places, headings, on_route):
        views, possible = scanner_views(lattice, scanners, order, angles)
        pieces = view_radii(lattice, possible, point[here], [entry.view for entry in views], model)
        for numbers, at, major, minor in pieces:
            levels, zones = (major + minor) / 2, classify(major, minor, model.low, model.high)
            for i in numbers:
                cells = np.ix_(here[at], views[i].headings)
                level[views[i].scanner][cells] = levels[:, None]
                zone[views[i].scanner][cells] = zones[:, None]
            done += len(at) * len(numbers) / (len(places) * len(views))
            progress(min(done, 1.0))
    if shape[2] > 1:
        # As in a map: the zone of a place is one of all its headings.
        of_place = classify_over_headings(zone)[..., None]
        zone = np.where(np.isfinite(level), of_place, np.uint8(NOT_FREE))
    return PlaceLevels(x, y, places, amount, headings, level, zone, model)


def _groups(places: Places, headings: Floats, on_route: bool) -> Iterator[tuple[Indices, Floats]]:
    """Group places that share the same headings: place indices and headings."""
    if not on_route:
        yield np.arange(len(places)), headings
        return
    for heading in np.unique(places.heading):
        yield np.flatnonzero(places.heading == heading), headings[heading : heading + 1]
