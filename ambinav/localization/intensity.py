"""Intensities in Monte Carlo localization: each beam hits a wall or a reflector.

A reading i of a beam speaks for a reflector with the share

    s = N(i; reflector) / (N(i; wall) + N(i; reflector)),

N the normal densities of the sensor's `Intensity`, and for a wall with 1 - s. A beam that
ought to meet a wall fits by it with f_w = ODD + (1 - ODD) (1 - s), one that ought to meet a
reflector with f_r = ODD + (1 - ODD) s: ODD is for surfaces that are brighter or darker than the map
says. With the hit h of the beam, exp(-d^2 / (2 sigma_hit^2)),

    f = h f_k + (1 - h) f_w

in the ray model, k the kind of what the beam meets there, and d what the range is off; in the
likelihood field h f_k is the better of walls and reflectors, each with its own distance d from the
end point. What is not on the map, people say, reads as a wall; where nothing is read f is 1. The
weight of a pose is multiplied by the product of all f to the power `importance_factor`, for
neighbouring beams err together: in the sums of cubes of AMCL as well, where a few beams of sixty
would hardly count.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import REFLECTOR
from ambinav.localization.filter_state import BEAM_SUM, FilterModel
from ambinav.localization.likelihood_field import LikelihoodField
from ambinav.localization.parameters import MclParameters
from ambinav.localization.prism_tables import edge_kinds
from ambinav.runtime.array_types import Bools, Floats, Floats32
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel
from ambinav.sensing.scanner import RangeScanner

ODD: Final = 0.05
"""Share of intensities that are of another surface than the map says."""


class IntensityModel(NamedTuple):
    """Intensity channel for the kernels, of the U beams that a filter uses.

    Attributes:
        wall: Mean reading of walls, shape (U,).
        reflector: Mean reading of reflectors, shape (U,).
        per_square: 1 / (2 std^2) of a reading, shape (U,); 0 for a beam without the channel.
        nearest: Nearest range from which a reading counts, shape (U,), metres.
        walls: `LikelihoodField.hits` of the walls that are no reflectors; (1, 1) for rays.
        reflectors: The same of the reflectors.
        reflects: Whether each border edge is one, shape (K,); see `prism_tables.edge_kinds`.
    """

    wall: Floats
    reflector: Floats
    per_square: Floats
    nearest: Floats
    walls: Floats32
    reflectors: Floats32
    reflects: Bools


def intensity_model(
    environment: Environment,
    scanner: RangeScanner,
    parameters: MclParameters,
    model: FilterModel,
    field: LikelihoodField | None,
) -> IntensityModel | None:
    """Build the kernels' model; None without a channel or without reflectors.

    Args:
        environment: The map.
        scanner: The scanner.
        parameters: Parameters of the filter.
        model: Model of the filter.
        field: The likelihood field that it was made with, if it was made with one.
    """
    if not len(scanner.intensity_beams) or not environment.has_reflectors:
        return None
    p = parameters
    channels = [scanner.sensors[k].intensity for k in scanner.sensor_of_beam[model.beam]]
    rows = np.array(
        [
            (0.0, 0.0, 0.0, math.inf)
            if channel is None
            else (channel.wall, channel.reflector, 0.5 / channel.std**2, channel.min_range)
            for channel in channels
        ]
    )
    bright = environment.segments.reflectors
    # Stored side by side, as both are read together.
    hits = np.zeros((*model.hits.shape, 2), dtype=np.float32)
    if model.kind < BEAM_SUM:
        step, reach = p.likelihood_resolution, p.laser_likelihood_max_dist
        if field is not None:
            step, reach = field.resolution, field.max_distance
        for k, which in enumerate((environment.segments.walls & ~bright, bright)):
            if which.any():
                surface_field = LikelihoodField.of(environment, step, reach, only=which)
                hits[..., k] = surface_field.hits(p.sigma_hit)
    wall, reflector, per_square, nearest = np.ascontiguousarray(rows.T)
    reflects = edge_kinds(environment) == REFLECTOR
    return IntensityModel(
        wall, reflector, per_square, nearest, hits[..., 0], hits[..., 1], reflects
    )


def beside_ranges(
    channel: object, intensities: ArrayLike | None, ranges: NDArray[Any]
) -> NDArray[Any]:
    """Return intensities in the dtype of ranges, (R, B); without a channel (None) (R, 0).

    Raises:
        InputError: the shape is not that of the ranges.
    """
    shape = np.atleast_2d(ranges).shape
    if channel is None:
        return np.empty((shape[0], 0), dtype=ranges.dtype)
    read = np.atleast_2d(np.ascontiguousarray(intensities, dtype=ranges.dtype))
    if read.shape != shape:
        raise InputError(
            f"intensities have the shape {read.shape}; give that of the ranges, {shape}."
        )
    return read


@kernel
def surface_fits(ranges, intensities, beam, channel, fits):
    """Write f_w and f_r of each beam, shape (U, 2); see the module.

    Args:
        ranges: Readings of all beams of the scanner, metres.
        intensities: Beside them; nan where there is none.
        beam: Which of them are used, shape (U,).
        channel: See `IntensityModel`.
        fits: Written.
    """
    for b in range(beam.size):
        z, i = ranges[beam[b]], intensities[beam[b]]
        fits[b, 0] = fits[b, 1] = 1.0
        if math.isnan(i) or not (z >= channel.nearest[b] and z < math.inf):
            continue
        dark, light = i - channel.wall[b], i - channel.reflector[b]
        share = 1.0 / (1.0 + math.exp(channel.per_square[b] * (light * light - dark * dark)))
        fits[b, 0] = ODD + (1.0 - ODD) * (1.0 - share)
        fits[b, 1] = ODD + (1.0 - ODD) * share
