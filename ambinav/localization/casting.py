"""Expected ranges of a scanner's beams at one pose, computed within a kernel.

In the plane rays walk the triangulation, in a building of prisms its cells. Which of the two is
settled when a kernel is compiled, by the type of `CastTables.space`: no ray asks for it.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ambinav.casting.plane.fan import STACK, cast_fan, counter_clockwise
from ambinav.casting.plane.triangulation import locate
from ambinav.casting.prisms.prisms import Prisms
from ambinav.casting.prisms.rays import PrismRays, cast_prism_rays, silence_oblique
from ambinav.casting.scans import check_rays
from ambinav.geometry.environment import Environment
from ambinav.localization.prism_tables import prism_rays, prisms_of
from ambinav.runtime.array_types import Bools, Floats, Indices, Ints, Ints32
from ambinav.runtime.kernels import kernel
from ambinav.sensing.rays import RayTable
from ambinav.sensing.scanner import RangeScanner

# Gaps between the rays that are always cast, radians: well below half a turn.
APART = 2.0


class CastTables(NamedTuple):
    """Triangles of an environment and rays of some beams: the input of `expected_ranges`.

    Rays with the same origin stand together, counter-clockwise. In a building in space they stand
    in the order of the beams, as one group whatever their origins, and what is written of border
    edges holds for its surfaces.

    Attributes:
        origin: Origin of each group of rays, shape (G, 2), metres, robot frame.
        first: Rays first[g] to first[g + 1] - 1 are those of group g, shape (G + 1,).
        cosine: x of the rays' unit vectors in the robot frame, shape (R,): of level rays the cosine
            of their angles.
        sine: y of them.
        beam: Which beam each ray belongs to, shape (R,).
        limit: Farthest distance that returns an echo, shape (R,), metres.
        incidence: Largest angle to the normal that returns an echo, shape (R,), radians; in space
            inf, for there `space` knows it.
        start: x and y of each ray, shape (R, 2), metres, robot frame.
        reach: The largest of each group's limits, shape (G,), metres.
        plain: Whether ray b is the only one of beam b, for all b, and returns an echo at any
            angle, shape (1,): a laser, which can do without much of what sonars need. Of a mesh
            it is False: there normals are of any direction.
        anchor: Which rays are cast whatever their beam reads, shape (R,): so many that what
            `counter_clockwise` says of neighbours holds for those that are cast.
        inner: Which rays have others of their cone on either side, shape (R,); of a cone's edges
            and of lasers none. Where the nearest echo is of such a ray, see `echo_normal`.
        border: `Environment.border_lines`; in space end points of the walls.
        normal: x and y of the unit normals of the border edges, into the free space, and how far
            along them the edges lie, shape (K, 3); of a mesh without that. Surfaces of prisms are
            upright or level: of the level ones all is 0, for they tell of the height alone.
        up: z of the rays' unit vectors, shape (R,).
        tilt: z of the unit normals, shape (K,); empty in the plane, and 0 of prisms, where the
            normal of what is level is left out.
        twin: See `Triangulation`, as are node, hops and corner.
        space: The rays in space; None in the plane, and of a mesh, in which no kernel casts.
        grid_x: See `Triangulation.index`, as is all that follows.
    """

    origin: Floats
    first: Ints
    cosine: Floats
    sine: Floats
    beam: Ints
    limit: Floats
    incidence: Floats
    start: Floats
    reach: Floats
    plain: Bools
    anchor: Bools
    inner: Bools
    border: Floats
    normal: Floats
    up: Floats
    tilt: Floats
    twin: Ints32
    node: Floats
    hops: Ints32
    corner: Floats
    space: PrismRays | None
    grid_x: float
    grid_y: float
    cell: float
    rows: int
    columns: int
    grid_start: Ints32
    item: Ints32
    triangle: Floats


def cast_tables(environment: Environment, scanner: RangeScanner, beams: Ints) -> CastTables:
    """Build tables of the environment and these beams, which are renumbered from 0.

    Raises:
        InputError: the building is a mesh, or it does not go together with the beams
            (`casting.scans.check_rays`).
    """
    prisms_of(environment)
    return tables_of(environment, scanner, beams)[0]


def tables_of(
    environment: Environment, scanner: RangeScanner, beams: Ints
) -> tuple[CastTables, Indices]:
    """Build tables as `cast_tables` does, and return the scanner's ray of each of their rays.

    In those of a mesh no kernel can cast: see `mesh_rays`.
    """
    check_rays(environment, *scanner.upright[beams].T)
    rays = scanner.rays(environment.space is not None)
    owner = np.repeat(np.arange(scanner.beams), np.diff(rays.start))
    number = np.full(scanner.beams, -1, dtype=np.int64)
    number[beams] = np.arange(len(beams))
    chosen = np.flatnonzero(number[owner] >= 0)
    space, normal, tilt = None, environment.surface_normals, np.empty(0)
    if environment.space is None:
        origin, first, order = _fans(rays, chosen)
        lines = environment.border_lines
        normal = edge_normals(lines)
        incidence = rays.max_incidence[order].astype(np.float64)
        groups = [anchors(rays.angle[order[low:high]]) for low, high in pairwise(first)]
        anchor = np.concatenate([np.empty(0, dtype=np.bool_), *groups])
    else:
        origin, first, order = np.zeros((1, 2)), np.array([0, len(chosen)]), chosen
        lines, tilt = np.empty((0, 4)), np.ascontiguousarray(normal[:, 2])
        normal = np.column_stack([normal[:, :2], np.zeros(len(normal))])
        incidence, anchor = np.full(len(chosen), np.inf), np.ones(len(chosen), dtype=np.bool_)
        if isinstance(environment.space, Prisms):
            prisms = environment.space
            lines, space = prisms.walls.xy, prism_rays(prisms, environment.floor, rays, chosen)
            normal[: len(lines)] = edge_normals(lines)
            tilt = np.zeros(len(normal))
    mesh = environment.triangulation
    limit, beam = rays.max_range[order].astype(np.float64), number[owner[order]]
    plain = np.array_equal(beam, np.arange(len(beams))) and np.isinf(incidence).all()
    level_part = np.cos(rays.elevation[order])
    tables = CastTables(
        np.ascontiguousarray(origin),
        first,
        np.cos(rays.angle[order]) * level_part,
        np.sin(rays.angle[order]) * level_part,
        beam,
        limit,
        incidence,
        np.ascontiguousarray(rays.origin[order]),
        np.maximum.reduceat(limit, first[:-1]),
        np.array([plain and (space is not None or environment.space is None)]),
        anchor,
        ~rays.edge[order],
        lines,
        normal,
        np.sin(rays.elevation[order]),
        tilt,
        mesh.twin,
        mesh.node,
        mesh.hops,
        mesh.corner,
        space,
        *mesh.index,
    )
    return tables, order


def _fans(rays: RayTable, chosen: Indices) -> tuple[Floats, Ints, Indices]:
    """Return each ray group's origin, its start in the order of all rays, and that order."""
    origin, group = np.unique(rays.origin[chosen], axis=0, return_inverse=True)
    parts = [chosen[group.reshape(-1) == g] for g in range(len(origin))]
    order = [part[counter_clockwise(rays.angle[part])] for part in parts]
    return origin, np.cumsum([0, *map(len, parts)]), np.concatenate([chosen[:0], *order])


def anchors(angles: Floats) -> Bools:
    """Mark rays, in the order of `counter_clockwise`, with gaps between them below `APART`.

    But for gaps that neighbours have anyhow.
    """
    turned = np.cumsum(np.mod(np.diff(angles, prepend=angles[:1]), 2.0 * math.pi))
    chosen = np.zeros(len(angles), dtype=np.bool_)
    chosen[0] = True
    last = 0.0
    for k in range(len(angles) - 1):
        if turned[k + 1] - last > APART:
            chosen[k], last = True, turned[k]
    return chosen


def edge_normals(lines: Floats) -> Floats:
    """Return unit normals n left of lines a (K, 4), start to end, and n . a, (K, 3)."""
    ex, ey = lines[:, 2] - lines[:, 0], lines[:, 3] - lines[:, 1]
    length = np.sqrt(ex * ex + ey * ey)
    nx, ny = -ey / length, ex / length
    return np.stack([nx, ny, nx * lines[:, 0] + ny * lines[:, 1]], axis=1)


@kernel(inline="always")
def echo_normal(inner, ux, uy, nx, ny):
    """Return the normal of the surface an echo behaves as if it came from, as the robot moves.

    A laser's ray, and that at the edge of a cone, turns with the robot and slides along the wall:
    it is the wall's. Within a cone the nearest echo comes from a point that is nearer than what is
    beside it, the foot of a perpendicular or the end of a wall, and which of the rays meets it
    changes as the robot turns: by the envelope theorem its range changes with the distance to that
    point alone, as that of a surface across the ray does. (Taken for the wall's, the end of a wall
    that is seen 25 degrees aslant would tell the heading, which it does not.)

    Args:
        inner: See `CastTables`, of the ray that the range is of.
        ux: Its direction, map frame.
        uy: Likewise.
        nx: Unit normal of the wall that it meets, map frame.
        ny: Likewise.
    """
    return (-ux, -uy) if inner else (nx, ny)


@kernel(inline="always")
def vertical_part(inner, ux, uy, up, tilt):
    """Return n_z u_z of a ray in space and the normal that `echo_normal` gives.

    Args:
        inner: As `echo_normal`.
        ux: Direction of the ray, map frame.
        uy: Likewise.
        up: z of it.
        tilt: z of the unit normal of the surface that it meets.
    """
    return ux * ux + uy * uy - 1.0 if inner else up * tilt


@kernel
def work_space(rays):
    """Return work arrays of `expected_ranges`, for scans of `rays` rays."""
    size = rays + STACK
    stack = (
        np.empty(size, dtype=np.int32),
        np.empty(size, dtype=np.int32),
        np.empty(size, dtype=np.int32),
    )
    return np.empty(rays), np.empty(rays), np.empty(rays), np.empty(rays, dtype=np.int32), stack


@kernel(forceinline=True)
def expected_ranges(x, y, theta, tables, work, ranges, ray, edge):
    """Compute each beam's true range at one pose, as `RangeScanner.scan` does.

    Args:
        x: Metres, map frame.
        y: Metres, map frame.
        theta: Radians.
        tables: See `CastTables`.
        work: See `work_space`.
        ranges: Written, shape (B,), metres: inf without an echo, nan where a sensor of the beam
            is outside the free space.
        ray: Written, int32, shape (B,): the ray that the range is of, -1 for none.
        edge: Written, int32, shape (B,): the border edge that it meets, -1 for none.
    """
    cast_rays(x, y, theta, tables, work)
    nearest_echoes(tables, work, ranges, ray, edge)


@kernel(forceinline=True)
def cast_rays(x, y, theta, tables, work):
    """Run the first half of `expected_ranges`: each ray's hit on the border, with or without echo.

    Written to `work`: directions, shape (R,) each; distances, shape (R,), metres, nan where the
    ray starts outside of the free space; border edges, int32, shape (R,). A ray that meets nothing
    within its limit has some distance beyond.
    """
    if _in_space(x, y, theta, tables.space, work, None, None):
        return
    ux, uy, distance, hit, stack = work
    co, si = math.cos(theta), math.sin(theta)
    for g in range(tables.origin.shape[0]):
        px = x + co * tables.origin[g, 0] - si * tables.origin[g, 1]
        py = y + si * tables.origin[g, 0] + co * tables.origin[g, 1]
        low, high = tables.first[g], tables.first[g + 1]
        t = locate(
            px, py, tables.grid_x, tables.grid_y, tables.cell, tables.rows, tables.columns,
            tables.grid_start, tables.item, tables.triangle,
        )  # fmt: skip
        # Indices from 0 on: of others numba asks whether they count from the end.
        vx, vy, bx, by = ux[low:high], uy[low:high], tables.cosine[low:high], tables.sine[low:high]
        for j in range(bx.size):
            vx[j] = co * bx[j] - si * by[j]
            vy[j] = si * bx[j] + co * by[j]
        if t < 0:
            distance[low:high] = math.nan
            hit[low:high] = -1
            continue
        cast_fan(
            px, py, vx, vy, high - low, t, tables.reach[g], tables.corner, tables.twin,
            tables.node, tables.hops, tables.border, stack, distance[low:high], hit[low:high],
        )  # fmt: skip


@kernel(forceinline=True)
def _in_space(x, y, theta, space, work, beam, reading):
    """Cast the rays if they are in space; return whether they are.

    Which of the two branches is compiled is settled by the type of `space`. The tables themselves
    are not handed on, which would count references to all of them: a fifth of an update.
    """
    if space is not None:
        ux, uy, distance, hit, _ = work
        cast_prism_rays(x, y, theta, space, ux, uy, distance, hit, beam, reading)
        silence_oblique(space, ux, uy, distance, hit)
        return True
    return False


@kernel(forceinline=True)
def cast_observed(x, y, theta, reading, tables, work, picked):
    """Cast only the rays of beams whose `reading` is finite, and of `anchor`; see `cast_rays`.

    What is written to `work` stands at the front: entry m is of ray picked[m]. In space all rays
    are picked, and those of columns without such a beam meet nothing.

    Args:
        x: Metres, map frame.
        y: Metres, map frame.
        theta: Radians.
        reading: Shape (B,).
        tables: See `CastTables`.
        work: See `work_space`.
        picked: Written, int32, shape (R,); rising.

    Returns:
        How many rays were cast.
    """
    if _in_space(x, y, theta, tables.space, work, tables.beam, reading):
        for j in range(picked.size):
            picked[j] = j
        return picked.size
    ux, uy, distance, hit, stack = work
    co, si = math.cos(theta), math.sin(theta)
    count = 0
    for g in range(tables.origin.shape[0]):
        low = count
        for j in range(tables.first[g], tables.first[g + 1]):
            # Without a branch, which the processor would mispredict every other time.
            picked[count] = j
            count += math.isfinite(reading[tables.beam[j]]) | tables.anchor[j]
        px = x + co * tables.origin[g, 0] - si * tables.origin[g, 1]
        py = y + si * tables.origin[g, 0] + co * tables.origin[g, 1]
        t = locate(
            px, py, tables.grid_x, tables.grid_y, tables.cell, tables.rows, tables.columns,
            tables.grid_start, tables.item, tables.triangle,
        )  # fmt: skip
        if t < 0:
            distance[low:count] = math.nan
            hit[low:count] = -1
            continue
        vx, vy, mine = ux[low:count], uy[low:count], picked[low:count]
        for m in range(mine.size):
            j = np.uint64(mine[m])
            bx, by = tables.cosine[j], tables.sine[j]
            vx[m] = co * bx - si * by
            vy[m] = si * bx + co * by
        cast_fan(
            px, py, vx, vy, count - low, t, tables.reach[g], tables.corner, tables.twin,
            tables.node, tables.hops, tables.border, stack, distance[low:count], hit[low:count],
        )  # fmt: skip
    return count


@kernel(forceinline=True)
def spread_observed(count, work, picked):
    """Move the results of `cast_observed` to their places in the results of `cast_rays`.

    Rays that were not cast have met nothing.
    """
    ux, uy, distance, hit, _ = work
    m = count - 1
    # Loop backwards, so that no entry is overwritten before it is read.
    for j in range(distance.size - 1, -1, -1):
        if m >= 0 and picked[m] == j:
            ux[j], uy[j], distance[j], hit[j] = ux[m], uy[m], distance[m], hit[m]
            m -= 1
        else:
            distance[j], hit[j] = math.inf, -1


@kernel(forceinline=True)
def nearest_echoes(tables, work, ranges, ray, edge):
    """Run the second half of `expected_ranges`: the nearest echo of each beam's rays.

    A ray without an edge (-1) within its limit has met something else than a wall, which returns
    an echo at any angle.
    """
    ux, uy, distance, hit, _ = work
    if tables.plain[0]:
        # Whole loops without a branch: an echo or none is guessed wrong every other time. Two of
        # them: each has so few arrays that the compiler takes several beams at a time.
        for b in range(ranges.size):
            ranges[b] = math.inf if distance[b] > tables.limit[b] else distance[b]
        for b in range(ranges.size):
            echo = ranges[b] < math.inf
            ray[b] = b if echo else -1
            edge[b] = hit[b] if echo else -1
        return
    border = tables.border
    ranges[:] = math.inf
    ray[:] = -1
    edge[:] = -1
    for j in range(distance.size):
        b, d, k = tables.beam[j], distance[j], hit[j]
        if math.isnan(d):
            ranges[b] = math.nan
            continue
        # A range of nan stays: no comparison with it is true.
        if d > tables.limit[j] or not d < ranges[b]:
            continue
        if tables.incidence[j] < math.inf and k >= 0:
            ex, ey = border[k, 2] - border[k, 0], border[k, 3] - border[k, 1]
            along = abs(ux[j] * ex + uy[j] * ey)
            across = abs(ux[j] * ey - uy[j] * ex)
            if math.atan2(along, across) > tables.incidence[j]:
                continue
        ranges[b] = d
        ray[b] = j
        edge[b] = k
