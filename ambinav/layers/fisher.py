"""Censi's bound: the best precision with which a scan can fix the pose.

Source: A. Censi, "On achievable accuracy for range-finder localization", ICRA 2007. A ray at
whose end the surface's normal has the direction a, b = a - the ray's direction, tells of x, y and
theta by g g^T / sigma^2 with g = [cos a / cos b, sin a / cos b, r tan b]; a scan by the sum, and
no unbiased localizer has a covariance below its inverse (Cramer, Rao). `localization.information`
works g out; the layer is what the sum leaves of a prior from odometry.

All beams of the scanner take part, not those alone that the ambiguity was thinned to: at 720 beams
a turn a bound from 60 of them would be 3.5 times too large, and no bound. With `tau` at 1 and the
same prior the layer is what `localization.expected.expected_covariance(..., source="fisher")` says.

Our own reading: the prior (`marginal.prior_deviations`), without which the bound is infinite in a
corridor; the radius as the measure, in metres, where Censi shows the covariance; sigma holds the
sensor, the rounding to a bin and the map. A beam with a cone counts as its nearest ray, and
within the cone tells the distance to what it meets alone (`casting.echo_normal`). Where b is
near to 90 degrees the 1 / cos b is held at 20 (`information.GRAZING`). `incidence=False` leaves
1 / cos b out, g = [cos a, sin a, r sin b]: the information of point-to-line scan matching, which
measures what a scan is off by across the surface and so is not drawn by grazing rays.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import as_number
from ambinav.geometry.environment import Environment
from ambinav.layers.context import LayerContext
from ambinav.layers.marginal import marginal_radii, prior_deviations
from ambinav.layers.registry import Layer
from ambinav.localization.casting import CastTables, cast_tables, work_space
from ambinav.localization.information import (
    BeamNoise,
    as_map_std,
    as_poses,
    beam_lines,
    beam_noise,
    informations,
    ray_caster,
)
from ambinav.localization.mesh_rays import MeshRays
from ambinav.runtime.array_types import Floats, Floats32
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows
from ambinav.sensing.scanner import RangeScanner

# Beams whose gradients are held at a time.
BEAMS_AT_ONCE = 1_000_000
# Poses computed at a time.
POSES_AT_ONCE = 100_000


def ray_information(
    environment: Environment,
    scanner: RangeScanner,
    poses: ArrayLike,
    map_std: float | None = None,
    *,
    incidence: bool = True,
) -> Floats:
    """Compute the Fisher information that each beam of a scan gives about its pose.

    Their sum over the beams is the scan's (`information.scan_information`).

    Args:
        environment: The environment.
        scanner: The scanner.
        poses: x, y, theta, shape (N, 3) or (3,).
        map_std: Standard deviation of the walls' position, metres; None: the environment's.
        incidence: With the factor 1 / cos b.

    Returns:
        Shape (N, B, 3, 3), about x, y (1 / square metres) and theta (1 / square radians), map
        frame; 0 for beams without an echo and those that end in unknown space.

    Raises:
        InputError: the poses have no such shape or are not finite, or map_std is negative.
    """
    rows = as_poses(poses, "poses")
    cast = cast_tables(environment, scanner, np.arange(scanner.beams))
    noise = beam_noise(environment, scanner, as_map_std(environment, map_std))
    gradient, weight = _gradients(rows, cast, noise, incidence)
    outer: Floats = gradient[..., :, None] * gradient[..., None, :] * weight[..., None, None]
    return outer


def fisher(
    context: LayerContext,
    *,
    odometry_std: float | None = None,
    heading_std: float | None = None,
    incidence: bool = True,
    tau: float = 1.0,
) -> dict[str, Floats32]:
    """Compute the radii of the bound's covariance of x and y, with the heading marginalised.

    Both are at most `odometry_std`: what is known beforehand takes part in the bound.

    Args:
        context: What the map was made of; all beams of its scanner are taken.
        odometry_std: How well x and y are known beforehand, metres; None: half the radius of the
            map's neighbourhood.
        heading_std: How well the heading is, radians; None: the map's sigma_theta.
        incidence: With the factor 1 / cos b.
        tau: How many beams carry one independent piece of evidence, at least 1.

    Returns:
        fisher and fisher_minor (metres) and fisher_direction (radians).

    Raises:
        InputError: a number is out of its range, or `incidence` is left out of a building in space.
    """
    place, turn = prior_deviations(context, odometry_std, heading_std)
    tau = checked_tau(tau)
    if context.environment.space is not None and not incidence:
        raise InputError(
            f"{context.environment.name}: fisher without incidence is known for plans alone; "
            "leave the option out."
        )
    radii = np.empty((3, len(context.points[0]), len(context.headings)))
    for h, part, information in scan_informations(context, incidence):
        radii[:, part, h] = marginal_radii(information / tau, place, turn)
    major, minor, direction = (context.spread(values) for values in radii)
    return {"fisher": major, "fisher_minor": minor, "fisher_direction": direction}


def checked_tau(tau: float) -> float:
    """Return how many beams carry one independent piece of evidence.

    Raises:
        InputError: fewer than one.
    """
    number = as_number(tau, "tau")
    if number < 1.0:
        raise InputError(f"tau is {number}; give at least 1.")
    return number


def scan_informations(
    context: LayerContext, incidence: bool = True
) -> Iterator[tuple[int, slice, Floats]]:
    """Yield the Fisher information of a scan at the poses of a map, piece by piece.

    All beams of the scanner count.

    Yields:
        Number of the heading; which of the poses; and the information there, shape (M, 3, 3).
    """
    scanner = context.full_scanner
    cast = ray_caster(context.environment, scanner, np.arange(scanner.beams))
    noise = beam_noise(context.environment, scanner, context.map_std)
    for h in range(len(context.headings)):
        poses = context.poses(h)
        for first in range(0, len(poses), POSES_AT_ONCE):
            part = slice(first, first + POSES_AT_ONCE)
            yield h, part, _information(poses[part], cast, noise, incidence)


def _information(
    poses: Floats, cast: CastTables | MeshRays, noise: BeamNoise, incidence: bool
) -> Floats:
    """Compute the Fisher information of a scan at each pose, shape (N, 3, 3)."""
    out = np.empty((len(poses), 3, 3))
    if incidence or isinstance(cast, MeshRays):
        # Summed beam by beam, so that memory does not grow with the number of beams.
        informations(poses, cast, noise, out)
        return out
    count = max(BEAMS_AT_ONCE // len(noise.far), 1)
    for first in range(0, len(poses), count):
        part = slice(first, first + count)
        gradient, weight = _gradients(poses[part], cast, noise, incidence)
        out[part] = np.matmul(gradient.transpose(0, 2, 1), gradient * weight[..., None])
    return out


def _gradients(
    poses: Floats, cast: CastTables, noise: BeamNoise, incidence: bool
) -> tuple[Floats, Floats]:
    """Return each reading's gradient by the pose, shape (N, B, 3), and 1 / variance, (N, B)."""
    lines = np.zeros((len(poses), len(noise.far), 5))
    run_rows(_lines, len(poses), poses, cast, noise, lines, least=16)
    gradient = lines[:, :, 1:4]
    if not incidence:
        # Along x and y it is the unit normal times 1 / cos b.
        length = np.hypot(gradient[..., 0], gradient[..., 1])
        gradient = gradient / np.where(length > 0.0, length, 1.0)[..., None]
    return gradient, 1.0 / lines[:, :, 4]


@kernel
def _lines(low, high, poses, cast, noise, out):
    """Write `information.beam_lines` at each pose (N, 3) to `out` (N, B, 5), which is zero."""
    beams = noise.far.size
    ranges = np.empty(beams)
    ray = np.empty(beams, dtype=np.int32)
    edge = np.empty(beams, dtype=np.int32)
    work = work_space(cast.cosine.size)
    for p in range(low, high):
        beam_lines(
            poses[p, 0], poses[p, 1], poses[p, 2], cast, noise, work, ranges, ray, edge, out[p]
        )


def _reach(context: LayerContext, **_: object) -> float:
    """Return the distance at which a change affects the layer: a pose's own scan counts."""
    return context.sight


LAYER = Layer(
    name="fisher",
    title="Fisher bound, major radius",
    unit="m",
    source="Censi 2007, On achievable accuracy for range-finder localization (ICRA)",
    worse="high",
    compute=fisher,
    in_space=True,
    reach=_reach,
    companions={
        "fisher_minor": ("Fisher bound, minor radius", "m"),
        "fisher_direction": ("Fisher bound, axis of the major radius", "rad"),
    },
)
