"""Obstacles as the faces that rays meet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from ambinav.casting.added import AddedWalls
from ambinav.geometry.edit_in_space import bodies_of, top_of
from ambinav.geometry.environment import Environment
from ambinav.geometry.obstacle import Obstacle
from ambinav.geometry.segments import REFLECTOR, WALL, edges_of


def walls_of(obstacles: Sequence[Obstacle], environment: Environment) -> AddedWalls:
    """Return the faces of obstacles in a building, in space with their heights."""
    space = environment.space
    if space is not None:
        solids, sheets = bodies_of(obstacles, environment, environment.floor, top_of(space))
        return AddedWalls.of(
            [*(edges_of(solid.outline) for solid in solids), *sheets.xy[:, None]],
            [*(solid.kind for solid in solids), *sheets.kind],
            [*((solid.bottom, solid.top) for solid in solids), *sheets.z],
            [True] * len(solids) + [False] * len(sheets.xy),
        )
    edges = []
    for obstacle in obstacles:
        if obstacle.solid:
            edges.append(edges_of(obstacle.outline))
        else:
            corners = shapely.get_coordinates(obstacle.outline)
            edges.append(np.hstack([corners[:-1], corners[1:]]))
    return AddedWalls.of(
        edges, [REFLECTOR if obstacle.reflective else WALL for obstacle in obstacles]
    )
