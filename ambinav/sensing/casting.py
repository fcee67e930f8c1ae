"""True ranges of a scanner's rays at many poses, in pieces that bound the memory."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import as_flat
from ambinav.config.numbers import shown
from ambinav.runtime.array_types import Bools, Floats, Floats32
from ambinav.runtime.errors import InputError
from ambinav.sensing.rays import RayTable

if TYPE_CHECKING:
    from ambinav.geometry.environment import Environment

# Rays cast in one go; three arrays of this size are held at a time (48 MB).
RAYS_AT_ONCE = 4_000_000


def is_in_space(env: Environment) -> bool:
    """Return whether rays are cast in three dimensions; raise `InputError` for other objects."""
    if not hasattr(env, "space"):
        raise InputError(f"env is {shown(env)}; give what `load_environment` returns.")
    return env.space is not None


def cast_beams(
    env: Environment, rays: RayTable, max_range: float, x: ArrayLike, y: ArrayLike, theta: ArrayLike
) -> Floats32:
    """Return the nearest echo of each beam at each pose.

    Args:
        env: The environment to cast in.
        rays: The rays of B beams.
        max_range: How far to cast, metres.
        x: Metres in the map frame; x, y and theta (radians) broadcast.
        y: As x.
        theta: As x.

    Returns:
        float32, shape (broadcast shape, B), metres; inf where nothing returns an echo,
        nan where the sensor is outside the free space.

    Raises:
        InputError: a pose is not finite, or the building and the scanner do not go together
            (`casting.scans.check_rays`).
    """
    from ambinav.casting import scans  # brings in numba: only when something is cast

    shape, flat = _poses(x, y, theta)
    beams = len(rays.start) - 1
    ranges = np.empty((len(flat[0]), beams), dtype=np.float32)
    step = max(1, RAYS_AT_ONCE // len(rays))
    # Where every angle echoes and all rays reach as far as is cast, every hit is an echo.
    specular = rays.specular
    sifted = specular or bool((rays.max_range < np.float32(max_range)).any())
    for i in range(0, len(ranges), step):
        px, py, heading = (values[i : i + step] for values in flat)
        distance, _, incidence = scans.scan_rays(
            env, px, py, heading, rays.origin, rays.angle, max_range, height=rays.height,
            elevation=rays.elevation, incidence=specular,
        )  # fmt: skip
        echo = rays.echoes(distance, incidence) if sifted else distance
        ranges[i : i + step] = rays.nearest(echo)
    return ranges.reshape(*shape, beams)


def cast_reflectors(
    env: Environment, rays: RayTable, max_range: float, x: ArrayLike, y: ArrayLike, theta: ArrayLike
) -> Bools:
    """Return whether a reflector stops the ray of each beam, its first ray where it has several.

    Args:
        env: As in `cast_beams`, like all others.
        rays: See there.
        max_range: See there.
        x: See there.
        y: See there.
        theta: See there.

    Returns:
        bool, shape (broadcast shape, B).

    Raises:
        InputError: a pose is not finite.
    """
    from ambinav.casting import scans
    from ambinav.geometry.segments import REFLECTOR

    shape, flat = _poses(x, y, theta)
    first = rays.start[:-1]
    reflects = np.empty((len(flat[0]), len(first)), dtype=np.bool_)
    step = max(1, RAYS_AT_ONCE // len(rays))
    for i in range(0, len(reflects), step):
        px, py, heading = (values[i : i + step] for values in flat)
        _, surface, _ = scans.scan_rays(
            env, px, py, heading, rays.origin[first], rays.angle[first], max_range,
            height=rays.height[first], elevation=rays.elevation[first],
        )  # fmt: skip
        reflects[i : i + step] = (env.surface_kind == REFLECTOR)[surface] & (surface >= 0)
    return reflects.reshape(*shape, len(first))


def _poses(x: ArrayLike, y: ArrayLike, theta: ArrayLike) -> tuple[tuple[int, ...], list[Floats]]:
    """Return the broadcast shape, and the three arguments flattened."""
    shape, flat = as_flat(x=x, y=y, theta=theta)
    for axis, values in zip(("x", "y", "theta"), flat, strict=True):
        finite = np.isfinite(values)
        if not finite.all():
            raise InputError(
                f"pose: {axis} is {values[~finite][0]}; give finite metres and radians."
            )
    return shape, flat
