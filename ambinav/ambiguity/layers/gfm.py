"""How many rays see no more than one straight wall: the geometric feature metric.

Source: Y. Lin, X. Zhang, Y. Liu, D. Wang and H. Lu, "GFM-Planner: perception-aware trajectory
planning with geometric feature metric", IROS 2025 (arXiv 2507.16233), read in its abstract and its
published program. A ray's hit point moves in the map when the robot does; the rank of that
Jacobian, 2 x 3 (x, y, heading), by central differences between neighbouring cells and neighbouring
rays, is 1 where all hits lie on one straight wall and 2 where they do not: at corners, edges,
doors. The metric is the share of the rays with rank 1. Each of 64 directions of the map is one bit
of a 64-bit number a cell; the metric of any heading and aperture is a count of bits in it
(`rank_masks`, `share`). The program puts the count through a sigmoid, which changes no order and
is left out here.

Our own reading: hits are exact points on segments, not cells of a grid, so "rank" needs a
tolerance, and it is the walls' own deviation `map_std`: second singular value of the differences.
(An exact derivative would be of rank 1 always; the differences see what the robot meets within a
cell and a step of the rays.) Where the neighbouring cell is not free, a wall parts it off, or its
ray meets nothing, the pose's own hit stands in; the program instead gives cells beside walls the
worst value. A ray that meets nothing in range, or the frontier to unknown space, tells nothing
(rank 0) and has its bit set too. Rays start at the robot's centre, whatever its heading, so a
neighbour counts if the robot can stand there at any heading. A scanner sees the directions
that one of its beams looks into, each as far as that beam; a cone has no hit point, so beams wider
than the step of the directions do not count.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambinav.ambiguity.layers.bands import bands
from ambinav.ambiguity.layers.ground import Ground
from ambinav.ambiguity.layers.registry import Layer
from ambinav.geometry.fan import scan_rays
from ambinav.geometry.segments import FRONTIER
from ambinav.kernels import kernel
from ambinav.sensing.scanner import RangeScanner
from ambinav.threads import run_rows

DIRECTIONS = 64
STEP = 2.0 * math.pi / DIRECTIONS
# Casts are in single precision: differences below this are none, metres.
FINEST = 1e-4
# Bits of `Lattice.links` that lead east, north, west and south.
EAST, NORTH, WEST, SOUTH = 0, 2, 4, 6


def gfm(ground: Ground) -> dict[str, NDArray[np.float32]]:
    """Share of the directions in the scanner's view whose rays have not the full rank.

    Args:
        ground: What the map was made of.

    Returns:
        gfm, from 0 (every ray sees a feature) to 1 (none does).
    """
    views = [_view(ground.scanner, float(heading)) for heading in ground.headings]
    counts = np.zeros((len(ground.points[0]), len(views)), dtype=np.int64)
    for limit in np.unique(np.concatenate([view[view > 0.0] for view in views])):
        masks = rank_masks(ground, float(limit))
        for h, view in enumerate(views):
            counts[:, h] += np.bitwise_count(masks & _mask(view == limit))
    seen = np.array([np.count_nonzero(view) for view in views])
    return {"gfm": ground.spread(counts / seen)}


def rank_masks(ground: Ground, max_range: float) -> NDArray[np.uint64]:
    """The 64 directions of the map as bits, at each free cell.

    Args:
        ground: What the map was made of; its scanner plays no part.
        max_range: How far a ray sees, metres.

    Returns:
        uint64, shape (P,): bit k is set if the ray in direction 2 pi k / 64 (map frame) has a hit
        point of rank below 2.
    """
    env, lattice = ground.environment, ground.lattice
    x, y = ground.points
    angles = STEP * np.arange(DIRECTIONS, dtype=np.float64)
    frontier = np.append(env.segments.kind == FRONTIER, False)
    masks = np.empty(len(x), dtype=np.uint64)
    for band in bands(ground, 1):
        here = slice(band.first, band.last)
        distance, segment, _ = scan_rays(
            env, x[here], y[here], np.zeros(band.last - band.first),
            np.zeros((DIRECTIONS, 2)), angles, max_range,
        )  # fmt: skip
        # No segment is -1, the last of the list.
        distance[frontier[segment]] = np.inf
        run_rows(
            _ranks, band.end - band.begin, band.begin, band.first, lattice.rows_columns,
            lattice.index, lattice.links[here], distance, np.cos(angles), np.sin(angles),
            lattice.spacing, max(ground.map_std, FINEST), masks[band.begin : band.end], least=64,
        )  # fmt: skip
    return masks


def share(masks: NDArray[np.uint64], heading: ArrayLike, aperture: float) -> NDArray[np.float64]:
    """Share of the bits set within a field of view, from the masks alone.

    Args:
        masks: See `rank_masks`; broadcasts with `heading`.
        heading: Direction of the middle of the field of view, radians, map frame.
        aperture: Its full angle, radians; it holds at least the direction nearest to its middle.
    """
    middle = np.mod(np.asarray(heading, dtype=np.float64) / STEP, DIRECTIONS)
    apart = np.abs(np.arange(DIRECTIONS) - middle[..., np.newaxis])
    apart = np.minimum(apart, DIRECTIONS - apart)
    seen = apart <= np.maximum(aperture / 2.0 / STEP + 1e-9, apart.min(axis=-1, keepdims=True))
    windows = np.packbits(seen, axis=-1, bitorder="little").view("<u8")[..., 0]
    return np.asarray(np.bitwise_count(masks & windows) / np.bitwise_count(windows))


def _mask(seen: NDArray[np.bool_]) -> np.uint64:
    """64 truth values as bits."""
    packed: np.uint64 = np.packbits(seen, bitorder="little").view("<u8")[0]
    return packed


def _view(scanner: RangeScanner, heading: float) -> NDArray[np.float64]:
    """How far the scanner sees in each direction of the map, metres; 0: not at all."""
    sensors = [scanner.sensors[i] for i in scanner.sensor_of_beam]
    rays = np.array([sensor.aperture <= STEP for sensor in sensors])
    limit = np.array([sensor.max_range for sensor in sensors])[rays]
    yaw = np.mod(scanner.mounts[rays, 2], 2 * math.pi)
    order = np.argsort(yaw)
    yaw, limit = yaw[order], limit[order]
    gap = np.diff(yaw, append=yaw[0] + 2 * math.pi)
    # Within a fan a beam stands for half the way to the next; where none is near, for a step.
    half = np.clip(np.minimum(gap, np.roll(gap, 1)) / 2.0, STEP / 2.0, STEP)
    direction = STEP * np.arange(DIRECTIONS) - heading
    apart = np.abs(np.mod(direction[:, np.newaxis] - yaw + math.pi, 2 * math.pi) - math.pi)
    nearest = apart.argmin(axis=1)
    within = apart[np.arange(DIRECTIONS), nearest] <= half[nearest] + 1e-9
    return np.where(within, limit[nearest], 0.0)


def _why_not(scanner: RangeScanner) -> str | None:
    narrowest = min(sensor.aperture for sensor in scanner.sensors)
    if narrowest <= STEP:
        return None
    return (
        f"all its beams are cones, of {math.degrees(narrowest):g} degrees or more, and the "
        "reading of a cone is no point on a wall."
    )


@kernel
def _ranks(
    low, high, begin, first, rows_columns, index, links, distance, cosine, sine, spacing,
    tolerance, out,
):  # fmt: skip
    count = cosine.size
    for p in range(begin + low, begin + high):
        row, column = rows_columns[p, 0], rows_columns[p, 1]
        i = p - first
        bits = links[i]
        east = index[row, column + 1] - first if bits & (1 << EAST) else -1
        west = index[row, column - 1] - first if bits & (1 << WEST) else -1
        north = index[row + 1, column] - first if bits & (1 << NORTH) else -1
        south = index[row - 1, column] - first if bits & (1 << SOUTH) else -1
        mask = np.uint64(0)
        for k in range(count):
            if (
                not np.isfinite(distance[i, k])
                or full_rank(
                    distance, i, k, east, west, north, south, cosine, sine, spacing, tolerance
                )
                == 0
            ):
                mask |= np.uint64(1) << np.uint64(k)
        out[p - begin] = mask


@kernel(inline="always")
def moved(distance, own, other, k, step):
    """Step to another cell and change of ray k's range on it; none where it has no hit."""
    if other < 0 or not np.isfinite(distance[other, k]):
        return 0.0, 0.0
    return step, distance[other, k] - own


@kernel
def full_rank(distance, i, k, east, west, north, south, cosine, sine, spacing, tolerance):
    """1 if the hit of ray k moves in two directions with x, y and heading, else 0."""
    count = cosine.size
    own = np.float64(distance[i, k])
    ux, uy = cosine[k], sine[k]
    se, de = moved(distance, own, east, k, spacing)
    sw, dw = moved(distance, own, west, k, -spacing)
    sn, dn = moved(distance, own, north, k, spacing)
    ss, ds = moved(distance, own, south, k, -spacing)
    ax, ay = se - sw + (de - dw) * ux, (de - dw) * uy
    bx, by = (dn - ds) * ux, sn - ss + (dn - ds) * uy
    left, right = (k + 1) % count, (k + count - 1) % count
    lx, ly = own * ux, own * uy
    rx, ry = lx, ly
    if np.isfinite(distance[i, left]):
        lx, ly = distance[i, left] * cosine[left], distance[i, left] * sine[left]
    if np.isfinite(distance[i, right]):
        rx, ry = distance[i, right] * cosine[right], distance[i, right] * sine[right]
    cx, cy = lx - rx, ly - ry
    xx = ax * ax + bx * bx + cx * cx
    xy = ax * ay + bx * by + cx * cy
    yy = ay * ay + by * by + cy * cy
    largest = 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)
    if largest <= tolerance * tolerance:
        return 0
    # Product of the squared singular values, as a sum of squares: nothing cancels.
    ab, ac, bc = ax * by - ay * bx, ax * cy - ay * cx, bx * cy - by * cx
    return 1 if (ab * ab + ac * ac + bc * bc) / largest > tolerance * tolerance else 0


LAYER = Layer(
    name="gfm",
    title="share of rays whose hit point moves along one straight wall",
    unit="1",
    source="Lin et al. 2025, GFM-Planner (IROS): share of rays with a hit-point Jacobian of rank 1",
    worse="high",
    compute=gfm,
    why_not=_why_not,
)
