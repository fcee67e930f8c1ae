"""Free space of a flying robot at several heights of a building: one environment a height."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from scipy import ndimage

from ambinav.buildings.boundary import environment_from_grid
from ambinav.buildings.mesh.bands import touched
from ambinav.buildings.mesh.floor import CELL, STEP
from ambinav.casting.prisms.prisms import Prisms
from ambinav.casting.triangles import triangles_of
from ambinav.geometry.environment import Environment
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, OccupancyGrid
from ambinav.runtime.array_types import Bools
from ambinav.runtime.errors import InputError
from ambinav.runtime.provenance import digest_of

# Cells around the building's plan.
_MARGIN: Final = 2


def flight_levels(
    env: Environment, heights: Sequence[float], radius: float, *, drop: float = 0.0
) -> list[Environment]:
    """Make the free space of a robot that hovers, at each of several heights of a building.

    A cell is occupied at z if any surface is in it between z - radius and z + radius. Free is what
    a robot reaches from the building's floor by flying through cells in which nothing is, and
    rising where no surface is between two heights. So what is closed on all sides, as are
    furniture and walls, is not free unless the plan has floor in it; what lies above a table is.
    The box around the building's plan is the limit.

    Args:
        env: A building in space (`Environment.in_space`), of prisms or a mesh.
        heights: z of the robot's frame in the map frame, ascending, metres.
        radius: Radius of the sphere that covers the robot, metres.
        drop: How far below the height the floor of its environment is: there the mount of a
            scanner counts from, metres.

    Returns:
        An environment a height.

    Raises:
        InputError: the building is a plan, the heights do not rise, the robot would touch the
            floor or the ceiling, or nothing can be reached at a height.
    """
    space = env.space
    if space is None:
        raise InputError(
            f"{env.name}: it is a plan, without heights; give a building in space, in Python "
            "environment.in_space(extruded(environment, height))."
        )
    if not len(heights) or any(upper <= lower for lower, upper in pairwise(heights)):
        raise InputError(f"heights is {list(heights)}; give one or more, each above the last.")
    ceiling = space.ceiling if isinstance(space, Prisms) else np.inf
    for z in heights:
        if not env.floor + radius < z < ceiling - radius:
            lid = f" and the ceiling at {ceiling:g} m" if ceiling < np.inf else ""
            raise InputError(
                f"{env.name}: z = {z:g} m leaves no room for a robot of radius {radius:g} m: the "
                f"floor is at z = {env.floor:g} m{lid}; give other heights."
            )
    bounds = np.array(env.bounds)
    corner = bounds[:2] - _MARGIN * CELL
    columns, rows = (np.ceil((bounds[2:] - bounds[:2]) / CELL).astype(int) + 2 * _MARGIN).tolist()
    origin = float(corner[0]), float(corner[1])
    triangles = triangles_of(space)

    def clear(low: float, high: float) -> Bools:
        return ~touched(triangles, low, high, origin, CELL, (rows, columns))

    x, y = (corner[k] + (np.arange(n) + 0.5) * CELL for k, n in enumerate((columns, rows)))
    plan = env.triangulation.contains(*(part.ravel() for part in np.meshgrid(x, y)))
    # Rising to each height from the one below, and the height itself, in turn.
    layers = [plan.reshape(rows, columns) & clear(env.floor + STEP, heights[0] + radius)]
    layers.append(clear(heights[0] - radius, heights[0] + radius))
    for below, above in pairwise(heights):
        layers += [clear(below - radius, above + radius), clear(above - radius, above + radius)]
    pieces, _ = ndimage.label(np.stack(layers))
    reached = np.isin(pieces, np.setdiff1d(np.unique(pieces[0]), [0]))
    made = []
    for z, free in zip(heights, reached[1::2], strict=True):
        if not free.any():
            raise InputError(
                f"{env.name}: a robot of radius {radius:g} m reaches nothing at z = {z:g} m; give "
                "other heights, or a smaller radius."
            )
        state = np.where(free, FREE, OCCUPIED).astype(np.uint8)
        level = environment_from_grid(OccupancyGrid(state, CELL, (*origin, 0.0)))
        level.name, level.source = f"{env.name} at z = {z:g} m", env.source
        level.checksum = digest_of(space.checksum, env.checksum, list(heights), z, radius, CELL)
        made.append(level.in_space(space, z - drop))
    return made
