"""Geometric feature metric: the number of rays that see no more than one straight wall.

Source: after Y. Lin, X. Zhang, Y. Liu, D. Wang and H. Lu, "GFM-Planner: perception-aware trajectory
planning with geometric feature metric", IROS 2025 (arXiv 2507.16233), read in its abstract and its
published program. A ray's hit point moves in the map when the robot does; the rank of that
Jacobian, 2 x 3 (x, y, heading), by central differences between poses a step apart and neighbouring
rays, is 1 where all hits lie on one straight wall and 2 where they do not: at corners, edges,
doors. The metric is the share of the rays with rank 1. Each of 64 directions of the map is one bit
of a 64-bit number a cell; the metric of any heading and aperture is a count of bits in it
(`rank_masks`, `share`). The program puts the count through a sigmoid, which changes no order and
is left out here.

Our own reading: hits are exact points on segments, not cells of a grid, so "rank" needs a
tolerance, and it is the walls' own deviation `map_std`: second singular value of the differences.
(An exact derivative would be of rank 1 always; the differences see what the robot meets within a
step of its own and of the rays.) So the metric depends on the step. The program's is a cell of its
grid, which is its tolerance too; here it is an option, and the poses a step away are cast where
they are, whatever the spacing of the map. Where a wall parts such a pose off, it is outside the
free space, or its ray meets nothing, the pose's own hit stands in; the program instead gives cells
beside walls the worst value. A ray that meets nothing in range, or the frontier to unknown space,
tells nothing (rank 0) and has its bit set too. Rays start at the robot's centre, and whether its
body would fit a step away does not matter. A scanner sees the directions that one of its beams
looks into, each as far as that beam; a cone has no hit point, so beams wider than the step of the
directions do not count.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ambinav.casting.scans import scan_rays
from ambinav.config import as_positive
from ambinav.geometry.segments import FRONTIER
from ambinav.layers.context import LayerContext
from ambinav.layers.registry import Layer
from ambinav.runtime.array_types import Bools, Floats, Floats32, UInts
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows
from ambinav.sensing.scanner import RangeScanner

DIRECTIONS = 64
TURN = 2.0 * math.pi / DIRECTIONS
STEP = 0.1
"""Metres between a pose and those that its hit points are compared with, by default."""
# Casts are in single precision: differences below this are none, metres.
FINEST = 1e-4
# Where the compared poses are, in steps; the rays of `DIRECTIONS` towards them.
AXES = ((1, 0), (-1, 0), (0, 1), (0, -1))
TOWARDS = (0, DIRECTIONS // 2, DIRECTIONS // 4, 3 * DIRECTIONS // 4)
# Poses cast at a time, five scans of 64 rays each.
BATCH = 65536
# Coordinates are rounded to so many decimals, so that maps of any spacing cast from the same poses.
DECIMALS = 9


def gfm(context: LayerContext, *, step: float = STEP) -> dict[str, Floats32]:
    """Compute the share of directions in the scanner's view whose rays lack full rank.

    Args:
        context: What the map was made of.
        step: Distance to the poses that hit points are compared with, metres.

    Returns:
        gfm, from 0 (every ray sees a feature) to 1 (none does).

    Raises:
        InputError: the step is not a positive number.
    """
    in_space = context.environment.space is not None
    views = [_view(context.scanner, float(heading), in_space) for heading in context.headings]
    counts = np.zeros((len(context.points[0]), len(views)), dtype=np.int64)
    kinds = np.unique(np.concatenate([view[view[:, 0] > 0.0] for view in views]), axis=0)
    for limit, height in kinds.tolist():
        masks = rank_masks(context, limit, step, height)
        for h, view in enumerate(views):
            counts[:, h] += np.bitwise_count(masks & _mask((view == (limit, height)).all(axis=1)))
    seen = np.array([np.count_nonzero(view[:, 0]) for view in views])
    return {"gfm": context.spread(counts / seen)}


def rank_masks(
    context: LayerContext, max_range: float, step: float = STEP, height: float = 0.0
) -> UInts:
    """Return the 64 directions of the map as bits, at each free cell.

    Args:
        context: What the map was made of; its scanner plays no part.
        max_range: How far a ray sees, metres.
        step: Distance to the poses that hit points are compared with, metres.
        height: Height of the rays above the floor of a building in space, metres.

    Returns:
        uint64, shape (P,): bit k is set if the ray in direction 2 pi k / 64 (map frame) has a hit
        point of rank below 2.

    Raises:
        InputError: the step is not a positive number.
    """
    step = as_positive(step, "step", "metres")
    x, y = (values.round(DECIMALS) for values in context.points)
    angles = TURN * np.arange(DIRECTIONS, dtype=np.float64)
    tolerance = max(context.map_std, FINEST)
    masks = np.empty(len(x), dtype=np.uint64)
    for low in range(0, len(x), BATCH):
        part = slice(low, low + BATCH)
        # A wall within a step counts even where it is out of the rays' range.
        ranges, bare = _cast(context, x[part], y[part], max(max_range, step), height)
        beside = []
        for (i, j), rays in zip(AXES, TOWARDS, strict=True):
            neighbour, _ = _cast(context, x[part] + i * step, y[part] + j * step, max_range, height)
            neighbour[~(bare[:, rays] > step)] = np.inf
            beside.append(neighbour)
        ranges[ranges > max_range] = np.inf
        run_rows(
            _ranks, len(ranges), ranges, *beside, np.cos(angles), np.sin(angles), step, tolerance,
            masks[part], least=64,
        )  # fmt: skip
    return masks


def _cast(
    context: LayerContext, x: Floats, y: Floats, reach: float, height: float
) -> tuple[Floats32, Floats32]:
    """Return the distance to the wall in each direction, inf for none, and to a segment, (N, 64).

    Both are inf or nan where (x, y) is outside the free space, and beyond `reach`.
    """
    angles = TURN * np.arange(DIRECTIONS, dtype=np.float64)
    bare, segment, _ = scan_rays(
        context.environment, x, y, np.zeros(len(x)), np.zeros((DIRECTIONS, 2)), angles, reach,
        height=np.full(DIRECTIONS, height), elevation=np.zeros(DIRECTIONS), incidence=False,
    )  # fmt: skip
    # No segment is -1, the last of the list.
    frontier = np.append(context.environment.surface_kind == FRONTIER, False)
    return np.where(frontier[segment], np.float32(np.inf), bare), bare


def share(masks: UInts, heading: ArrayLike, aperture: float) -> Floats:
    """Return the share of the bits set within a field of view, from the masks alone.

    Args:
        masks: See `rank_masks`; broadcasts with `heading`.
        heading: Direction of the middle of the field of view, radians, map frame.
        aperture: Its full angle, radians; it holds at least the direction nearest to its middle.
    """
    middle = np.mod(np.asarray(heading, dtype=np.float64) / TURN, DIRECTIONS)
    delta = np.abs(np.arange(DIRECTIONS) - middle[..., np.newaxis])
    delta = np.minimum(delta, DIRECTIONS - delta)
    seen = delta <= np.maximum(aperture / 2.0 / TURN + 1e-9, delta.min(axis=-1, keepdims=True))
    windows = np.packbits(seen, axis=-1, bitorder="little").view("<u8")[..., 0]
    return np.asarray(np.bitwise_count(masks & windows) / np.bitwise_count(windows))


def _mask(seen: Bools) -> np.uint64:
    """Pack 64 truth values into bits."""
    packed: np.uint64 = np.packbits(seen, bitorder="little").view("<u8")[0]
    return packed


def _view(scanner: RangeScanner, heading: float, in_space: bool) -> Floats:
    """Return the range and the height of view in each direction of the map; range 0: no view.

    Shape (64, 2), metres; in a plan heights mean nothing and are 0.
    """
    sensors = [scanner.sensors[i] for i in scanner.sensor_of_beam]
    rays = np.array([sensor.aperture <= TURN for sensor in sensors])
    limit = np.array([sensor.max_range for sensor in sensors])[rays]
    height = scanner.upright[rays, 0] if in_space else np.zeros(len(limit))
    yaw = np.mod(scanner.mounts[rays, 2], 2 * math.pi)
    order = np.argsort(yaw)
    yaw, limit, height = yaw[order], limit[order], height[order]
    gap = np.diff(yaw, append=yaw[0] + 2 * math.pi)
    # Within a fan a beam stands for half the angle to the next; where none is near, for a step.
    half = np.clip(np.minimum(gap, np.roll(gap, 1)) / 2.0, TURN / 2.0, TURN)
    direction = TURN * np.arange(DIRECTIONS) - heading
    offset = np.abs(np.mod(direction[:, np.newaxis] - yaw + math.pi, 2 * math.pi) - math.pi)
    nearest = offset.argmin(axis=1)
    within = offset[np.arange(DIRECTIONS), nearest] <= half[nearest] + 1e-9
    return np.where(within[:, None], np.column_stack([limit, height])[nearest], 0.0)


def _why_not(scanner: RangeScanner) -> str | None:
    if not scanner.level:
        return (
            "it looks up and down, and hit points on floor, ceiling and tables move with the robot "
            "in two directions though they tell nothing of where it is."
        )
    narrowest = min(sensor.aperture for sensor in scanner.sensors)
    if narrowest <= TURN:
        return None
    return (
        f"all its beams are cones, of {math.degrees(narrowest):g} degrees or more, and the "
        "reading of a cone is not a point on a wall."
    )


@kernel
def _ranks(low, high, own, east, west, north, south, cosine, sine, step, tolerance, out):
    for i in range(low, high):
        mask = np.uint64(0)
        for k in range(cosine.size):
            if not np.isfinite(own[i, k]) or not full_rank(
                own[i], k, east[i, k], west[i, k], north[i, k], south[i, k], cosine, sine, step,
                tolerance,
            ):  # fmt: skip
                mask |= np.uint64(1) << np.uint64(k)
        out[i] = mask


@kernel(inline="always")
def moved(own, there, step):
    """Return the step to another pose and the change of the ray's range; zeros without a hit."""
    if not np.isfinite(there):
        return 0.0, 0.0
    return step, there - own


@kernel
def full_rank(distance, k, east, west, north, south, cosine, sine, step, tolerance):
    """Return whether the hit of ray k moves in two directions with x, y and heading.

    Args:
        distance: Distance of all rays at the pose itself, (64,), metres; inf without a hit.
        k: Which ray; it has a hit.
        east: The ray's distance a step to the east of the pose; not finite without a hit.
        west: Likewise.
        north: Likewise.
        south: Likewise.
        cosine: Cosine of the rays' directions, (64,).
        sine: Likewise.
        step: Metres.
        tolerance: A singular value up to this is none, metres.
    """
    count = cosine.size
    own = np.float64(distance[k])
    ux, uy = cosine[k], sine[k]
    se, de = moved(own, east, step)
    sw, dw = moved(own, west, -step)
    sn, dn = moved(own, north, step)
    ss, ds = moved(own, south, -step)
    ax, ay = se - sw + (de - dw) * ux, (de - dw) * uy
    bx, by = (dn - ds) * ux, sn - ss + (dn - ds) * uy
    left, right = (k + 1) % count, (k + count - 1) % count
    lx, ly = own * ux, own * uy
    rx, ry = lx, ly
    if np.isfinite(distance[left]):
        lx, ly = distance[left] * cosine[left], distance[left] * sine[left]
    if np.isfinite(distance[right]):
        rx, ry = distance[right] * cosine[right], distance[right] * sine[right]
    cx, cy = lx - rx, ly - ry
    xx = ax * ax + bx * bx + cx * cx
    xy = ax * ay + bx * by + cx * cy
    yy = ay * ay + by * by + cy * cy
    largest = 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)
    if largest <= tolerance * tolerance:
        return False
    # Product of the squared singular values, as a sum of squares: nothing cancels.
    ab, ac, bc = ax * by - ay * bx, ax * cy - ay * cx, bx * cy - by * cx
    return (ab * ab + ac * ac + bc * bc) / largest > tolerance * tolerance


def _reach(context: LayerContext, step: float = STEP) -> float:
    """Return the distance at which a change affects the layer: rays from a step away count."""
    return context.sight + 2.0 * step


LAYER = Layer(
    name="gfm",
    title="share of rays whose hit point moves along one straight wall",
    unit="1",
    source="after Lin et al. 2025, GFM-Planner (IROS): hit-point Jacobians of rank 1",
    worse="high",
    compute=gfm,
    reach=_reach,
    in_space=True,
    why_not=_why_not,
)
