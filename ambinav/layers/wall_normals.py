"""Spread of the directions of walls in range: the smallest eigenvalue of their summed normals.

Our own. The point-to-line form of the information of a scan is sum n n^T over the normals of the
surface that the scan sees (Gelfand, Ikemoto, Rusinkiewicz, Levoy 2003, "Geometrically stable
sampling for the ICP algorithm", 3DIM; its smallest eigenvalue is what Zhang, Kaess, Singh 2016, "On
degeneracy of optimization-based state estimation problems", ICRA, call the degeneracy factor). Here
the sum is over every wall of the map within range, seen or not, which is a convolution of the walls
with a disc and needs no ray. That is another quantity: between it and the eigenvalue over what a
scan sees the rank correlation was -0.07 and 0.33 on two maps (docs/layers.md). Cheap, and blind to
what hides what: it is here to show what visibility is worth.

Each metre of wall counts once, so the unit is metres of wall; a wall's metres lie
in the cells of the map's lattice that their middles fall into; both faces of a thin wall count
where the map has both; frontiers do not count. The range is the largest of the scanner's lasers.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import oaconvolve

from ambinav.config import as_positive
from ambinav.geometry.principal_axes import principal_axes
from ambinav.layers.context import LayerContext
from ambinav.layers.registry import Layer
from ambinav.runtime.array_types import Floats, Floats32
from ambinav.sensing.scanner import RangeScanner

# Metres of wall.
TINY = 1e-9


def wall_normals(context: LayerContext, *, reach: float | None = None) -> dict[str, Floats32]:
    """Compute the eigenvalues of the summed normals of walls within range of each free cell.

    Args:
        context: What the map was made of.
        reach: How far walls count, metres; None: the largest range of the scanner's lasers.

    Returns:
        wall_normals, the smaller eigenvalue, and wall_normals_strong, the larger (metres of
        wall); wall_normals_direction, the axis of the smaller (radians): the direction that
        the fewest walls face.

    Raises:
        InputError: the reach is not a positive number.
    """
    lasers = [sensor.max_range for sensor in context.scanner.sensors if sensor.aperture == 0.0]
    reach = as_positive(max(lasers) if reach is None else reach, "reach", "metres")
    steps = math.floor(reach / context.spacing + 1e-9)
    tensors = wall_tensors(context, steps)
    along = np.arange(-steps, steps + 1) * context.spacing
    disc = (along[:, None] ** 2 + along**2 <= reach**2 * (1 + 1e-9)).astype(np.float64)
    xx, xy, yy = (oaconvolve(component, disc, mode="valid")[context.free] for component in tensors)
    # Values that the convolution leaves by rounding count as 0.
    dark = xx + yy < TINY
    strong, weak, facing = principal_axes(
        *(np.where(dark, 0.0, component) for component in (xx, xy, yy))
    )
    across = np.mod(facing + np.pi / 2, np.pi)
    return {
        "wall_normals": context.spread(weak**2),
        "wall_normals_strong": context.spread(strong**2),
        "wall_normals_direction": context.spread(
            np.where(across.astype("f4") < np.pi, across, 0.0)
        ),
    }


def wall_tensors(context: LayerContext, margin: int) -> Floats:
    """Sum metres of wall times n n^T in each cell of the lattice and `margin` cells around it.

    Returns:
        Entries xx, xy, yy; shape (3, ny + 2 margin, nx + 2 margin), metres.
    """
    segments = context.environment.segments
    xy, lengths = segments.xy[segments.walls], segments.lengths[segments.walls]
    normals = context.environment.normals(np.flatnonzero(segments.walls))
    # Pieces of half a cell at most.
    pieces = np.maximum(np.ceil(2 * lengths / context.spacing).astype(np.intp), 1)
    wall = np.repeat(np.arange(len(xy)), pieces)
    first = np.repeat(np.cumsum(pieces) - pieces, pieces)
    share = (np.arange(len(wall)) - first + 0.5) / pieces[wall]
    middle = xy[wall, :2] + share[:, None] * (xy[wall, 2:] - xy[wall, :2])
    column = np.rint((middle[:, 0] - context.lattice.x[0]) / context.spacing).astype(int) + margin
    row = np.rint((middle[:, 1] - context.lattice.y[0]) / context.spacing).astype(int) + margin
    ny, nx = context.free.shape
    out = np.zeros((3, ny + 2 * margin, nx + 2 * margin))
    near = (row >= 0) & (column >= 0) & (row < out.shape[1]) & (column < out.shape[2])
    metres, n = (lengths / pieces)[wall], normals[wall]
    for entry, (i, j) in enumerate(((0, 0), (0, 1), (1, 1))):
        amount = metres * n[:, i] * n[:, j]
        np.add.at(out[entry], (row[near], column[near]), amount[near])
    return out


def _why_not(scanner: RangeScanner) -> str | None:
    if any(sensor.aperture == 0.0 for sensor in scanner.sensors):
        return None
    return (
        "wall normals need a laser beam, which meets a wall at one point with one normal; the "
        "range of a cone is that of the nearest point in it, wherever that is."
    )


LAYER = Layer(
    name="wall_normals",
    title="walls in range, smallest eigenvalue of their normals",
    unit="m",
    source="own: normals of all walls in range, seen or not; docs/layers.md",
    worse="low",
    compute=wall_normals,
    why_not=_why_not,
    not_in_space="the layer counts metres of the walls of a plan, seen or not, which walls with "
    "heights are not; leave it out, or ask it of environment.plan.",
    high_is_good=("wall_normals_strong",),
    companions={
        "wall_normals_strong": ("walls in range, largest eigenvalue of their normals", "m"),
        "wall_normals_direction": ("walls in range, axis that the fewest of them face", "rad"),
    },
)
