"""Floor of a mesh, and its free space for a robot: the 2D environment of a mesh."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy import ndimage

from ambinav.buildings.boundary import environment_from_grid
from ambinav.buildings.coverage import Coverage
from ambinav.buildings.mesh.bands import touched
from ambinav.buildings.mesh.frame import layered, triangle_areas
from ambinav.casting.mesh.mesh import Mesh
from ambinav.geometry.environment import Environment
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from ambinav.runtime.array_types import Bytes, Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.provenance import digest_of

CELL: Final = 0.05
"""Edge of the cells in which what is free is worked out, metres."""
STEP: Final = 0.03
"""Height of steps that a robot drives over, metres above the floor."""

# A face is floor if it is tilted by no more: the cosine of 15 degrees.
_LEVEL: Final = math.cos(math.radians(15.0))
# The floor is looked for in this lower share of the mesh's height, and at least so far up, metres.
_LOWER: Final = 0.4
_LOWER_LEAST: Final = 0.5
# Faces at heights within one layer of this thickness are one floor, metres.
_LAYER: Final = 0.05
_FINE: Final = 0.01
# Thickest slab, metres, and what share of its larger face the other one has at least.
_THICKEST: Final = 0.5
_AS_LARGE: Final = 0.7
# No floor is smaller, square metres, and as a share of the box around the mesh. Undersides of walls
# and furniture alone come to 0.1 (turtlebot3_house, which has no floor), the floor of
# aws_small_house to 0.77.
_SMALLEST: Final = 1.0
_LEAST_SHARE: Final = 0.2
# What is one layer of voxels higher than the floor, and no more, as a share of their edge.
_ONE_LAYER: Final = 1.01
# What hangs so far below everything else, metres, and is a smaller share of all faces, is a stray.
_GAP: Final = 0.2
_STRAYS: Final = 0.01
# What is as large in square metres, and as a share of the floor, is no table.
_SMALLEST_PLATFORM, _PLATFORM = 10.0, 0.5
# Cells around a mesh that hold nothing.
_MARGIN: Final = 2


def find_floor(mesh: Mesh) -> float:
    """Find the height of the largest level surface in the lower part of a mesh, z in metres.

    Raises:
        InputError: there is none, or none that is large enough for one.
    """
    triangles = mesh.triangles
    up = mesh.surface_normal[:, 2]
    # Only voxel meshes are known to be oriented consistently.
    level = (up if mesh.voxel else np.abs(up)) >= _LEVEL
    area = triangle_areas(triangles[level])
    a, b, c = (triangles[level][:, k, 2] for k in range(3))
    z = (a + b + c) / 3.0
    lowest, highest = _lowest(triangles), mesh.bounds[1, 2]
    lower = z >= lowest
    z, area = z[lower], area[lower]
    lower = z <= lowest + max(_LOWER * (highest - lowest), _LOWER_LEAST)
    z, area = z[lower], area[lower]
    # For rough floors count all heights in a layer and its neighbours.
    rough, _ = layered(z - lowest, area, _LAYER)
    best = int(rough.argmax())
    plan = float(np.prod(np.ptp(mesh.bounds[:, :2], axis=0)))
    # Of a scan's voxels the upper side alone is counted.
    share = _LEAST_SHARE / 2.0 if mesh.voxel else _LEAST_SHARE
    if rough[best] < max(_SMALLEST, share * plan):
        raise InputError(
            f"{mesh.source or mesh.name}: no floor is found in it (its largest level surface near "
            f"the bottom has {rough[best]:.2g} m2 of {plan:.3g}); give its height, floor "
            "(--floor), or the axis that is up, up (--up)."
        )
    # A slab has an underside as large as its top.
    near = (z >= lowest + best * _LAYER - _FINE) & (z <= lowest + (best + 2) * _LAYER + _THICKEST)
    z, area = z[near], area[near]
    fine, layer = layered(z - lowest, area, _FINE)
    top = int(np.flatnonzero(fine >= _AS_LARGE * fine.max())[-1])
    mine = (layer == top) | (layer == top + 1)
    return float((z[mine] * area[mine]).sum() / area[mine].sum())


def _lowest(triangles: Floats) -> float:
    """Return the lowest z of a building, without outliers below it, such as reflections."""
    area = triangle_areas(triangles)
    low, high = triangles[..., 2].min(axis=1), triangles[..., 2].max(axis=1)
    order = np.argsort(low)
    low, top, below = low[order], np.maximum.accumulate(high[order]), np.cumsum(area[order])
    # Where nothing stands between two heights, and what lies under them is next to nothing.
    gaps = np.flatnonzero((low[1:] - top[:-1] > _GAP) & (below[:-1] < _STRAYS * below[-1]))
    return float(low[gaps[-1] + 1] if len(gaps) else low[0])


def floor_environment(
    mesh: Mesh,
    height: float,
    radius: float,
    *,
    floor: float | None = None,
    step: float | None = None,
    cell: float = CELL,
) -> Environment:
    """Make a robot's free space on a mesh's floor, with the mesh for the scanner.

    A cell is occupied if anything of the mesh is in it between `step` above the floor and the
    robot's height, free if it holds floor and nothing else, and unknown where there is no floor.
    A `floor` that is given is a plane under all of the mesh, also around the building. Under a
    table that is higher than the robot it is free. Pieces of it where the robot's disc does not
    fit, as within a hollow wall, are left out. The walls of the result are where a robot must stop,
    to a cell or two; the rays of scanners are cast against the mesh (`Environment.space`).

    Args:
        mesh: The mesh.
        height: Height of the robot, metres.
        radius: Radius of the disc that covers it, metres.
        floor: z of the floor, metres; None: `find_floor`.
        step: Height that the robot drives over, metres; None: 0.03, and of a scan's voxels what is
            a layer higher than the floor.
        cell: Edge of a cell, metres.

    Raises:
        InputError: a length is out of its range, there is no floor, or nothing on it is free.
    """
    where = str(mesh.source or mesh.name)
    if step is None:
        step = max(STEP, mesh.voxel * _ONE_LAYER)
    for name, value, least in (
        ("height", height, step), ("radius", radius, 0.0), ("step", step, 0.0), ("cell", cell, 0.0),
    ):  # fmt: skip
        if not least < value < math.inf:
            raise InputError(f"{where}: {name} is {value}; give more than {least:g} metres.")
    z = find_floor(mesh) if floor is None else floor
    low, high = mesh.bounds
    if not low[2] - step <= z <= high[2]:
        raise InputError(
            f"{where}: floor is {z} and the mesh stands from z = {low[2]:.3g} to {high[2]:.3g} m; "
            "give a height within it."
        )
    grid = _cells(mesh, z, height, step, cell, everywhere=floor is not None)
    cells, pieces = _drop_narrow(grid.state, radius / cell)
    if not (grid.state == FREE).any():
        raise InputError(
            f"{where}: a robot of {height:g} m height and {radius:g} m radius fits nowhere on the "
            f"floor at z = {z:.3g} m; give a smaller one, or another floor."
        )
    env = environment_from_grid(grid)
    hollow = f"a robot of {radius:g} m radius fits nowhere in them"
    covered = Coverage(where, expected=(hollow,))
    covered.left_out += [
        (cells * cell**2, pieces, hollow),
        (
            _raised(mesh, z + step, env.free.area) if floor is None else 0.0, 1,
            "it is level and up to a metre above the floor; give its height, floor (--floor), to "
            "have it",
        ),
    ]  # fmt: skip
    env.name, env.source = mesh.name, mesh.source
    # Stored maps tell the floors of two robots apart by it.
    env.checksum = digest_of(mesh.checksum, z, height, radius, step, cell)
    about = f"{where}: floor at z = {z:.3f} m, robot {height:g} m high."
    env.notes = (*env.notes, *mesh.notes, *covered.notes(env.free), about)
    return env.in_space(mesh, z)


def _cells(
    mesh: Mesh, z: float, height: float, step: float, cell: float, everywhere: bool
) -> OccupancyGrid:
    """Compute the states of the cells; `everywhere`: there is floor under all of it."""
    low, high = mesh.bounds[:, :2]
    origin = low - _MARGIN * cell
    columns, rows = (np.ceil((high - low) / cell).astype(int) + 2 * _MARGIN).tolist()
    corner = float(origin[0]), float(origin[1])
    triangles = mesh.triangles
    level = np.abs(mesh.surface_normal[:, 2]) >= _LEVEL
    floor = touched(triangles[level], z - step, z + step, corner, cell, (rows, columns))
    standing = touched(triangles, z + step, z + height, corner, cell, (rows, columns))
    if everywhere:
        floor[_MARGIN:-_MARGIN, _MARGIN:-_MARGIN] = True
    state = np.full((rows, columns), UNKNOWN, dtype=np.uint8)
    state[floor] = FREE
    state[standing] = OCCUPIED
    return OccupancyGrid(state, cell, (*corner, 0.0))


def _drop_narrow(state: Bytes, radius: float) -> tuple[int, int]:
    """Mark pieces of free cells as occupied in which no disc fits; its radius is in cells.

    Returns:
        How many cells, and in how many pieces.
    """
    pieces, count = ndimage.label(state == FREE)
    room = ndimage.distance_transform_edt(state == FREE)
    widest = np.asarray(ndimage.maximum(room, pieces, np.arange(count + 1)))
    narrow = widest < radius
    narrow[0] = False
    state[narrow[pieces]] = OCCUPIED
    cells = np.bincount(pieces.ravel(), minlength=count + 1)
    return int(cells[narrow].sum()), int(narrow.sum())


def _raised(mesh: Mesh, above: float, floor: float) -> float:
    """Return the area of the largest level surface within a metre over `above`.

    It may be a raised part of the floor, a few steps higher. Tables and beds have less than
    `_PLATFORM` of the floor's area. 0: there is no such surface.
    """
    corners = mesh.triangles
    z = corners[..., 2].mean(axis=1)
    up = mesh.surface_normal[:, 2]
    level = ((up if mesh.voxel else np.abs(up)) >= _LEVEL) & (z > above) & (z <= above + 1.0)
    if not level.any():
        return 0.0
    layers, _ = layered(z[level] - above, triangle_areas(corners[level]), _LAYER)
    largest = float(layers.max())
    return largest if largest >= max(_PLATFORM * floor, _SMALLEST_PLATFORM) else 0.0
