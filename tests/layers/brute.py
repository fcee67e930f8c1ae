"""Plain answers to what the layers compute, for their tests; nothing here is fast.

Every ray is cast against every segment of `environment.segments`, derivatives are differences,
what is free is asked of shapely. Of ambinav only data are read: the segments, the free space, where
a scanner's rays start and look. Its casters, kernels and reference are not used.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from ambinav.geometry.environment import Environment
from ambinav.sensing import RangeScanner

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

WALL = 0
FRONTIER = 1
# Rays times segments at a time.
AT_ONCE = 4_000_000
# Ranges are taken to change no faster than at this cosine of the incidence angle (docs/model.md).
GRAZING = 0.05


def cast(
    env: Environment, x: Floats, y: Floats, angle: Floats, reach: float = np.inf
) -> tuple[Floats, Ints]:
    """Distance to the first segment along each ray, and which; inf and -1 for none; (N,).

    What lies farther than `reach` from all the rays' starts may be left out.
    """
    x, y, angle = (np.ravel(part) for part in np.broadcast_arrays(x, y, angle))
    distance, which = np.full(x.size, np.inf), np.full(x.size, -1)
    lines = env.segments.xy
    low, high = np.minimum(lines[:, :2], lines[:, 2:]), np.maximum(lines[:, :2], lines[:, 2:])
    near = np.flatnonzero(
        (high[:, 0] >= x.min() - reach) & (low[:, 0] <= x.max() + reach)
        & (high[:, 1] >= y.min() - reach) & (low[:, 1] <= y.max() + reach)
    )  # fmt: skip
    if near.size == 0:
        return distance, which
    lines = lines[near]
    for rows in _parts(x.size, len(lines)):
        ux, uy = np.cos(angle[rows])[:, None], np.sin(angle[rows])[:, None]
        ax, ay = lines[:, 0] - x[rows, None], lines[:, 1] - y[rows, None]
        ex, ey = lines[:, 2] - lines[:, 0], lines[:, 3] - lines[:, 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            cross = ux * ey - uy * ex
            along = (ax * ey - ay * ex) / cross
            share = (ax * uy - ay * ux) / cross
        met = (along >= 0.0) & (share >= -1e-9) & (share <= 1.0 + 1e-9)
        along = np.where(met, along, np.inf)
        which[rows] = near[along.argmin(axis=1)]
        distance[rows] = along.min(axis=1)
    which[np.isinf(distance)] = -1
    return distance, which


def _parts(rays: int, segments: int) -> Iterator[slice]:
    most = max(AT_ONCE // segments, 1)
    return (slice(low, low + most) for low in range(0, rays, most))


def is_free(env: Environment, x: Floats, y: Floats) -> NDArray[np.bool_]:
    """Whether points lie in the free space."""
    return np.asarray(shapely.contains_xy(env.free, x, y))


def lines_of(env: Environment) -> shapely.Geometry:
    """All segments, walls and frontiers, as one geometry."""
    return shapely.multilinestrings(shapely.linestrings(env.segments.xy.reshape(-1, 2, 2)))


@dataclass(frozen=True)
class Scan:
    """What the beams of a scanner meet, shape (..., B).

    Attributes:
        distance: Metres; inf without an echo.
        ray: Which of the scanner's rays meets it, -1 for none.
        segment: Which segment it meets, -1 for none.
    """

    distance: Floats
    ray: Ints
    segment: Ints


def scan(env: Environment, scanner: RangeScanner, poses: Floats, beyond: float = 0.0) -> Scan:
    """Cast all beams at poses (N, 3), up to `beyond` metres farther than the sensors reach."""
    rays = scanner.rays()
    theta = poses[:, 2:]
    x, y = ray_starts(scanner, poses)
    reach = float(rays.max_range.max()) + beyond
    distance, segment = cast(env, x, y, theta + rays.angle, reach)
    shape = (len(poses), len(rays.angle))
    distance, segment = distance.reshape(shape), segment.reshape(shape)
    line = env.segments.xy[segment]
    wall = np.arctan2(line[..., 3] - line[..., 1], line[..., 2] - line[..., 0])
    # Incidence is measured from the normal.
    oblique = np.arccos(np.abs(np.sin(theta + rays.angle - wall)).clip(max=1.0))
    silent = (distance > rays.max_range + beyond) | (oblique > rays.max_incidence)
    distance, segment = np.where(silent, np.inf, distance), np.where(silent, -1, segment)
    best = np.stack([
        low + distance[:, low:high].argmin(axis=1)
        for low, high in zip(rays.start[:-1], rays.start[1:], strict=True)
    ], axis=1)  # fmt: skip
    found = np.take_along_axis(distance, best, axis=1)
    none = np.isinf(found)
    return Scan(
        found,
        np.where(none, -1, best),
        np.where(none, -1, np.take_along_axis(segment, best, axis=1)),
    )


def ray_starts(scanner: RangeScanner, poses: Floats) -> tuple[Floats, Floats]:
    """Where the rays start at poses (N, 3): x and y in the map, (N, R)."""
    origin = scanner.rays().origin
    c, s = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    return (
        poses[:, :1] + c * origin[:, 0] - s * origin[:, 1],
        poses[:, 1:2] + s * origin[:, 0] + c * origin[:, 1],
    )


def slopes(env: Environment, scanner: RangeScanner, poses: Floats, found: Scan) -> Floats:
    """Change of each range with x, y and theta, (N, B, 3); 0 where there is no echo.

    By central differences, along the line of its segment and no steeper than at `GRAZING`. Within a
    cone, but for its edges, what is nearest stays the point that it is.
    """
    rays = scanner.rays()
    inner = (found.ray > rays.start[:-1]) & (found.ray < rays.start[1:] - 1)
    x, y = _ends(scanner, poses, found)
    out = np.zeros((*found.distance.shape, 3))
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1e-6
        ahead, _ = _to_line(env, scanner, poses + step, found)
        behind, facing = _to_line(env, scanner, poses - step, found)
        slope = (ahead - behind) / 2e-6 * np.minimum(facing / GRAZING, 1.0)
        away = [
            np.hypot(x - sx, y - sy)
            for sx, sy in (_starts(scanner, poses + sign * step, found) for sign in (1.0, -1.0))
        ]
        slope = np.where(inner, (away[0] - away[1]) / 2e-6, slope)
        out[..., axis] = np.where(found.segment >= 0, slope, 0.0)
    return out


def _starts(scanner: RangeScanner, poses: Floats, found: Scan) -> tuple[Floats, Floats]:
    """Where the rays of `found` start, (N, B) each."""
    x, y = ray_starts(scanner, poses)
    return (
        np.take_along_axis(x, found.ray, axis=1), np.take_along_axis(y, found.ray, axis=1)
    )  # fmt: skip


def _ends(scanner: RangeScanner, poses: Floats, found: Scan) -> tuple[Floats, Floats]:
    """What the rays of `found` meet, (N, B) each; nothing of use without an echo."""
    x, y = _starts(scanner, poses, found)
    angle = poses[:, 2:] + scanner.rays().angle[found.ray]
    distance = np.where(np.isfinite(found.distance), found.distance, 0.0)
    return x + distance * np.cos(angle), y + distance * np.sin(angle)


def _to_line(
    env: Environment, scanner: RangeScanner, poses: Floats, found: Scan
) -> tuple[Floats, Floats]:
    """Distance of the beams to the infinite lines of `found`, and the cosine of the incidence."""
    x, y = _starts(scanner, poses, found)
    angle = poses[:, 2:] + scanner.rays().angle[found.ray]
    ax, ay, bx, by = np.moveaxis(env.segments.xy[found.segment], -1, 0)
    nx, ny = ay - by, bx - ax
    length = np.hypot(nx, ny)
    facing = (nx * np.cos(angle) + ny * np.sin(angle)) / length
    with np.errstate(divide="ignore", invalid="ignore"):
        return ((ax - x) * nx + (ay - y) * ny) / length / facing, np.abs(facing)


def laplace(
    here: Floats, there: Floats, slope: Floats, variance: Floats, limit: float, cap: float,
    tau: float, cell: Floats,
) -> tuple[Floats, Floats, Floats]:  # fmt: skip
    """Likeness of a scan with scans of cells, integrated over the offset in them (docs/model.md).

    Args:
        here: Ranges of the one scan, (B,), as seen: at most `limit`.
        there: Ranges of the others, followed beyond the limit, (N, B).
        slope: Their change with x, y and theta, (N, B, 3).
        variance: Mean of the two readings' variances, (N, B); inf where a beam tells nothing.
        limit: Maximum range, metres.
        cap: Most evidence of a beam.
        tau: Beams per independent piece of evidence.
        cell: Variances of x, y and theta within a cell, (3,).

    Returns:
        I, (N,); the best offset, (N, 3); Phi, the evidence per tau there and the offset's own,
        (N,).
    """
    silent = (here >= limit) & (here < there)
    z = np.where(silent, 0.0, here - there)
    # What the cell can move a beam is no disagreement yet.
    moves = (slope**2 * cell).sum(axis=2)
    u = z**2 / (4 * variance) / (1 + moves / (2 * variance))
    weight = np.where(silent, 0.0, 1 / variance / (1 + u / cap) ** 2)
    offset, _, _ = _gaussian(slope, weight, z, tau, cell)
    # At that offset, the quadratic that touches the capped evidence from above.
    z, weight, capped = _capped(here, there, slope, variance, limit, cap, offset)
    moved = (slope * offset[:, None]).sum(axis=2)
    best, gain, spread = _gaussian(slope, weight, z + moved, tau, cell)
    total = (capped + weight * ((z + moved) ** 2 - z**2) / 4).sum(axis=1) / tau
    alike = np.exp(np.minimum(gain - total, 0.0)) * spread
    _, _, capped = _capped(here, there, slope, variance, limit, cap, best)
    phi = capped.sum(axis=1) / tau + (best**2 / cell).sum(axis=1) / 2
    return alike, best, phi


def _gaussian(
    slope: Floats, weight: Floats, z: Floats, tau: float, cell: Floats
) -> tuple[Floats, Floats, Floats]:
    """Best offset, evidence that it takes away, and root of the determinants' ratio."""
    precision = np.einsum("nb,nbi,nbj->nij", weight, slope, slope) / (2 * tau) + np.diag(1 / cell)
    pull = np.einsum("nb,nbi,nb->ni", weight, slope, z) / (2 * tau)
    offset = np.linalg.solve(precision, pull[..., None])[..., 0]
    spread = 1 / np.sqrt(np.linalg.det(precision) * cell.prod())
    return offset, (pull * offset).sum(axis=1) / 2, spread


def _capped(
    here: Floats, there: Floats, slope: Floats, variance: Floats, limit: float, cap: float,
    offset: Floats,
) -> tuple[Floats, Floats, Floats]:  # fmt: skip
    """Difference, weight and capped evidence of each beam at an offset in the cell."""
    seen = there + (slope * offset[:, None]).sum(axis=2)
    silent = seen >= limit
    z = here - np.minimum(seen, limit)
    u = z**2 / (4 * variance)
    root = 1 / np.sqrt(1 + (u / cap) ** 2)
    return z, np.where(silent, 0.0, root**3 / variance), u * root
