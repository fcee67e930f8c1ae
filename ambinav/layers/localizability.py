"""Localizability after Wang and Chen: change of the expected ranges on a probabilistic grid.

Source: after Y. Wang, W. Chen, J. Wang, W. Wang, "Localizability estimation for mobile robots based
on probabilistic grid map and its applications to localization", MFI 2012, and "Active global
localization based on localizability for mobile robots", Robotica 2014. The static localizability
matrix is the Fisher information of the scan with each beam's change of range taken by finite
differences of its expected range on the grid, over the variance of its range, which comes from the
sensor and from the occupancy of the cells that it may end in: sum_i d_i d_i^T / s_i^2, d_i the
differences by x, y and theta. Its determinant is their index, its weak axis the direction.

Our own reading: the grid is made from the walls, and rays are followed smoothly through it
(`occupancy`); differences are central; the beams are those of the map, thinned. The layer is the
radius in metres along the weak axis of the xy block of the inverse, theta marginalised, under the
prior that `fisher` has. Their index, about x, y and theta, is kept beside it as
localizability_determinant: in a corridor it is a product of two large numbers and one that is 0
except for the roughness of the grid, and so differs by orders of magnitude with the angle between
corridor and grid. Where the robot cannot stand a step to one side, the difference is from the pose
itself to the other side. A beam that more likely than not ends in unknown space contributes
nothing. In a building of prisms the grid has levels (`voxels`). A beam with a cone reads the
smallest of its rays' expected ranges; the grid does not model that oblique surfaces return no echo.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.ambiguity.feasible_poses import can_stand
from ambinav.casting.prisms.prisms import Prisms
from ambinav.config import as_number, as_positive
from ambinav.layers.context import LayerContext
from ambinav.layers.marginal import marginal_radii, prior_deviations
from ambinav.layers.occupancy import Occupancy, grid_range, occupancy
from ambinav.layers.registry import Layer
from ambinav.layers.voxels import Voxels, levels, voxel_range, voxels
from ambinav.localization.information import TABLE, BeamNoise, beam_noise
from ambinav.runtime.array_types import Bools, Floats, Floats32
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows
from ambinav.sensing.scanner import RangeScanner

# Cells of the grid are as wide as the walls are uncertain, within these limits (metres), and wider
# where there would be more of them than this.
FINEST, COARSEST = 0.02, 0.1
MOST_CELLS = 25_000_000
# Kernels take it where there are voxels.
NO_PLAN = Occupancy(
    0.0, 0.0, 1.0, np.zeros((1, 1), dtype=np.float32), np.zeros((1, 1), dtype=np.int32)
)
# Half of what ranges are compared over: metres, radians.
STEP, TURN = 0.05, 0.02
# Poses whose matrices are held at a time.
POSES_AT_ONCE = 100_000


def localizability_matrices(
    grid: Occupancy | Voxels,
    scanner: RangeScanner,
    noise: BeamNoise,
    poses: Floats,
    step: float = STEP,
    turn: float = TURN,
    possible: Bools | None = None,
    floor: float = 0.0,
) -> Floats:
    """Compute the static localizability matrix at each pose.

    Args:
        grid: The probabilistic grid map; with levels, in space, the rays look up and down.
        scanner: The scanner.
        noise: Its beams (`beam_noise` with a map_std of 0: the grid holds the map's).
        poses: x, y, theta, shape (N, 3).
        step: Half the difference in x and in y, metres.
        turn: Half the difference in heading, radians.
        possible: Whether the robot can stand half a difference ahead (0) and behind (1) in x, y
            and heading, shape (N, 3, 2); None: everywhere.
        floor: z of the floor of a building in space, metres.

    Returns:
        Shape (N, 3, 3), about x, y (1 / square metres) and theta (1 / square radians), map frame.
    """
    rays = scanner.rays(isinstance(grid, Voxels))
    look = np.column_stack([np.cos(rays.angle), np.sin(rays.angle)])
    space, flat = None, grid
    if isinstance(grid, Voxels):
        look *= np.cos(rays.elevation)[:, None]
        space = grid, np.column_stack([rays.height + floor, np.sin(rays.elevation)])
        flat = NO_PLAN
    out = np.empty((len(poses), 3, 3))
    if possible is None:
        possible = np.ones((len(poses), 3, 2), dtype=np.bool_)
    run_rows(
        _matrices, len(poses), poses, possible, flat, rays.origin, look, space, rays.start,
        noise.near, noise.far, noise.variance, step, turn, out,
    )  # fmt: skip
    return out


def localizability(
    context: LayerContext,
    *,
    cell: float | None = None,
    step: float = STEP,
    turn: float = TURN,
    odometry_std: float | None = None,
    heading_std: float | None = None,
) -> dict[str, Floats32]:
    """Compute the localizability matrix's determinant, and the radius and direction that it leaves.

    Args:
        context: What the map was made of.
        cell: Edge of a cell of the probabilistic grid, metres; None: the deviation of the map's
            walls, from 2 to 10 cm.
        step: Half the difference in x and in y that ranges are compared over, metres.
        turn: Half that in heading, radians.
        odometry_std: As for `fisher`.
        heading_std: As for `fisher`.

    Returns:
        localizability (metres), localizability_direction (radians) and
        localizability_determinant (1 / (m^4 rad^2)).

    Raises:
        InputError: a number is out of its range.
    """
    place, heading = prior_deviations(context, odometry_std, heading_std)
    cell = _usual_cell(context) if cell is None else as_positive(cell, "cell", "metres")
    step, turn = as_positive(step, "step", "metres"), as_number(turn, "turn")
    if not 0.0 < turn < 1.0:
        raise InputError(f"turn is {turn}; give more than 0 and less than 1 radian.")
    grid = _grid(context, cell)
    noise = beam_noise(context.environment, context.scanner, 0.0)
    results = np.empty((3, len(context.points[0]), len(context.headings)))
    for h in range(len(context.headings)):
        poses = context.poses(h)
        for first in range(0, len(poses), POSES_AT_ONCE):
            part = slice(first, first + POSES_AT_ONCE)
            around = _possible_around(context, poses[part], step, turn)
            matrices = localizability_matrices(
                grid, context.scanner, noise, poses[part], step, turn, around,
                context.environment.floor,
            )  # fmt: skip
            radius, _, direction = marginal_radii(matrices, place, heading)
            results[0, part, h], results[1, part, h] = radius, direction
            # Rounding may bring that of a singular matrix below 0.
            results[2, part, h] = np.maximum(np.linalg.det(matrices), 0.0)
    names = ("localizability", "localizability_direction", "localizability_determinant")
    return {name: context.spread(values) for name, values in zip(names, results, strict=True)}


def _possible_around(context: LayerContext, poses: Floats, step: float, turn: float) -> Bools:
    """Return `possible` of `localizability_matrices` at poses of one heading."""
    mask = np.empty((len(poses), 3, 2), dtype=np.bool_)
    x, y, heading = poses[:, 0], poses[:, 1], float(poses[0, 2])
    for side, sign in enumerate((1.0, -1.0)):
        for axis, (dx, dy, dt) in enumerate(((step, 0.0, 0.0), (0.0, step, 0.0), (0.0, 0.0, turn))):
            mask[:, axis, side] = can_stand(
                context.environment, context.full_scanner, x + sign * dx, y + sign * dy,
                heading + sign * dt, context.model.robot_radius,
            )  # fmt: skip
    return mask


@kernel(forceinline=True)
def _range(px, py, ux, uy, space, r, limit, grid, most):
    """Return the range of ray r: `grid_range`, or `voxel_range` where `space` holds voxels."""
    if space is not None:
        cells, steep = space
        return voxel_range(px, py, steep[r, 0], ux, uy, steep[r, 1], limit, cells, most)
    return grid_range(px, py, ux, uy, limit, grid, most)


@kernel
def _expect(x, y, theta, grid, origin, look, space, start, near, far, mean, spread):
    """Write each beam's expected range to `mean`; add its variance to `spread`, nan if unknown."""
    co, si = math.cos(theta), math.sin(theta)
    for b in range(near.size):
        mean[b] = math.inf
        nearest = 0.0
        for r in range(start[b], start[b + 1]):
            px = x + co * origin[r, 0] - si * origin[r, 1]
            py = y + si * origin[r, 0] + co * origin[r, 1]
            ux, uy = co * look[r, 0] - si * look[r, 1], si * look[r, 0] + co * look[r, 1]
            d, variance, unknown = _range(px, py, ux, uy, space, r, far[b], grid, mean[b])
            if d < mean[b]:
                mean[b] = d
                nearest = math.nan if unknown > 0.5 else variance
        mean[b] = max(mean[b], near[b])
        spread[b] += nearest


@kernel
def _matrices(
    begin, end, poses, possible, grid, origin, look, space, start, near, far, variance, step, turn,
    out,
):  # fmt: skip
    beams = near.size
    # A range and its variance are those of the six poses around, in the mean; the pose itself is
    # one of them where a step from it leads to where no robot can stand.
    ahead, behind = np.empty(beams), np.empty(beams)
    mean, spread = np.empty(beams), np.empty(beams)
    change = np.empty((beams, 3))
    for p in range(begin, end):
        mean[:] = 0.0
        spread[:] = 0.0
        x, y, theta = poses[p, 0], poses[p, 1], poses[p, 2]
        for axis in range(3):
            half = turn if axis == 2 else step
            up = half if possible[p, axis, 0] else 0.0
            down = half if possible[p, axis, 1] else 0.0
            for side in range(2):
                move = up if side == 0 else -down
                _expect(
                    x + (move if axis == 0 else 0.0), y + (move if axis == 1 else 0.0),
                    theta + (move if axis == 2 else 0.0), grid, origin, look, space, start, near,
                    far, ahead if side == 0 else behind, spread,
                )  # fmt: skip
            for b in range(beams):
                mean[b] += (ahead[b] + behind[b]) / 6.0
                change[b, axis] = (ahead[b] - behind[b]) / (up + down) if up + down > 0.0 else 0.0
        out[p] = 0.0
        for b in range(beams):
            if math.isnan(spread[b]):
                continue
            place = mean[b] / far[b] * (TABLE - 1)
            low = min(int(place), TABLE - 2)
            share = place - low
            total = variance[b, low] * (1.0 - share) + variance[b, low + 1] * share
            total += spread[b] / 6.0
            for i in range(3):
                for j in range(3):
                    out[p, i, j] += change[b, i] * change[b, j] / total


def _grid(context: LayerContext, cell: float) -> Occupancy | Voxels:
    """Make the probabilistic grid; in space with levels for all rays of the scanner.

    Where that are too many cells they are made wider.
    """
    env, rays = context.environment, context.scanner.rays(True)
    if not isinstance(env.space, Prisms):
        return occupancy(env, cell, context.map_std)
    up = rays.max_range * np.sin(rays.elevation)
    low, high = (
        float(edge) + env.floor
        for edge in (
            (rays.height + np.minimum(up, 0)).min(),
            (rays.height + np.maximum(up, 0)).max(),
        )
    )
    xmin, ymin, xmax, ymax = env.bounds
    while True:
        z = levels(env.space, cell, max(context.map_std, 0.5 * cell), low, high)
        if len(z) == 2 or len(z) * (xmax - xmin) * (ymax - ymin) <= MOST_CELLS * cell**2:
            return voxels(env, env.space, cell, context.map_std, z)
        cell *= 1.1


def _usual_cell(context: LayerContext) -> float:
    xmin, ymin, xmax, ymax = context.environment.bounds
    least = math.sqrt((xmax - xmin) * (ymax - ymin) / MOST_CELLS)
    return max(min(max(context.map_std, FINEST), COARSEST), least)


LAYER = Layer(
    name="localizability",
    title="localizability on a probabilistic grid, major radius",
    unit="m",
    source="after Wang, Chen, Wang and Wang 2012, Localizability estimation (MFI)",
    worse="high",
    compute=localizability,
    companions={
        "localizability_direction": ("localizability, axis of the major radius", "rad"),
        "localizability_determinant": ("determinant of the localizability matrix", "1/(m^4 rad^2)"),
    },
    high_is_good=("localizability_determinant",),
    in_space=True,
    prisms_alone=True,
    lasers_alone=True,
)
