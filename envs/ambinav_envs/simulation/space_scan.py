"""A simulated scan in a building of prisms, from the true pose."""

from __future__ import annotations

import numpy as np

from ambinav.drive.world import unicycle
from ambinav.geometry.raycasting.prism_rays import (
    cast_prism_rays,
    cast_prism_sweep,
    silence_oblique,
)
from ambinav.kernels import kernel


@kernel(forceinline=True)
def sense_in_space(space, cast, scanner, state, settings, scratch):
    """Cast the rays from a robot's true pose if the building is in space; whether it is.

    Which branch is compiled is settled by the type of `space`, see `casting.CastTables`; the
    others are what `scanner_kernel.sense` has. Written: `scratch.cast`, see `casting.cast_rays`.
    """
    if space is not None:
        ux, uy, distance, hit, _ = scratch.cast
        if settings.scan_time > 0.0:
            poses = swept(cast.beam, scanner.moment, state, settings.scan_time)
            cast_prism_sweep(poses, space, ux, uy, distance, hit)
        else:
            x, y, theta = state.truth[0], state.truth[1], state.truth[2]
            cast_prism_rays(x, y, theta, space, ux, uy, distance, hit)
        silence_oblique(space, ux, uy, distance, hit)
        return True
    return False


@kernel
def swept(beam, moment, state, duration):
    """Where the robot was when each ray was taken, shape (R, 3): it drove as in the last step.

    Args:
        beam: Which beam each ray is of, shape (R,).
        moment: See `ScannerArrays`.
        state: See `STATE`.
        duration: Of the scan, seconds.
    """
    poses = np.empty((beam.size, 3))
    for j in range(beam.size):
        poses[j] = unicycle(
            state.truth[0], state.truth[1], state.truth[2], state.speeds[0], state.speeds[1],
            moment[beam[j]] * duration,
        )  # fmt: skip
    return poses
