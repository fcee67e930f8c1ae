"""A furnished room in space, once as prisms and once as a mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely

from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.geometry.environment import Environment
from tests.geometry import scenes


def box(low: tuple[float, ...], high: tuple[float, ...]) -> tuple[Any, Any]:
    """Corners and triangles of an upright box."""
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    vertices = np.array(low) + corners * (np.array(high) - np.array(low))
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return vertices, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


ROOM = (0.0, 0.0, 0.0), (6.0, 4.0, 2.5)
TABLES = [((2.0, 1.0, 0.70), (4.0, 2.0, 0.75)), ((4.6, 2.8, 0.0), (5.4, 3.4, 1.2))]


def furnished() -> tuple[Environment, Environment]:
    """A room with a table and a cupboard as prisms and as a mesh; the same floor."""
    plan = scenes.environment(shapely.box(0, 0, 6, 4) - shapely.box(4.6, 2.8, 5.4, 3.4))
    walls = [(0, 0, 6, 0), (6, 0, 6, 4), (6, 4, 0, 4), (0, 4, 0, 0)]
    solids = [Solid(shapely.box(*a[:2], *b[:2]), a[2], b[2]) for a, b in TABLES]
    prisms = Prisms(walls, [(0.0, 2.5)] * 4, solids=solids, floor=0.0, ceiling=2.5)
    parts = [box(*ROOM), *(box(*table) for table in TABLES)]
    faces = np.concatenate([faces + 8 * k for k, (_, faces) in enumerate(parts)])
    mesh = Mesh(np.concatenate([vertices for vertices, _ in parts]), faces, name="room")
    return plan.in_space(prisms), plan.in_space(mesh)
