"""A building as the kernels read it: arrays by name, made once and never written to."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambinav.geometry.segments import FRONTIER
from ambinav.localization.casting import CastTables
from ambinav.localization.information import BeamNoise
from ambinav.service.field import Field
from ambinav_envs.buildings.building import Building
from ambinav_envs.simulation.scanner_kernel import ScannerArrays

Floats = NDArray[np.float64]


class BuildingRecord(NamedTuple):
    """All that is read of a building while robots step through it.

    Attributes:
        cast: Walls and the scanner's rays.
        noise: How the beams read; one row of bias and variance a sensor.
        table: The first of `CollisionChecker.arrays`.
        bound: The second.
        level: Layer of the ambiguity map that rewards and windows show, float32, shape
            (rows, columns, headings), headings 1 if it does not depend on them.
        fisher: The layer `fisher`, likewise.
        free: Free cells of the map, shape (rows, columns).
        map_frame: x and y of the map's cell (0, 0), metres, and cells per metre.
        links: See `ambinav_envs.buildings.geodesic`, uint8, shape (rows, columns) of the lattice
            on which routes are searched.
        lattice_frame: Of that lattice, likewise.
        bounds: Left, lower, right and upper end, metres.
    """

    cast: CastTables
    noise: BeamNoise
    table: Floats
    bound: NDArray[np.float32]
    level: NDArray[np.float32]
    fisher: NDArray[np.float32]
    free: NDArray[np.bool_]
    map_frame: tuple[float, float, float]
    links: NDArray[np.uint8]
    lattice_frame: tuple[float, float, float]
    bounds: tuple[float, float, float, float]


def building_record(
    building: Building,
    cast: CastTables,
    scanner: ScannerArrays,
    noise: tuple[Floats, Floats],
    level: Field,
    fisher: Field,
) -> BuildingRecord:
    """Put a building's arrays together.

    Args:
        building: The building.
        cast: Its walls and all beams of the scanner.
        scanner: The scanner.
        noise: Bias and variance of each sensor, see `BeamNoise`.
        level: The layer that rewards and windows show.
        fisher: The layer `fisher`, on the same lattice.
    """
    environment, lattice = building.environment, building.lattice
    table, bound, _ = building.checker.arrays
    frontier = environment.segments.kind[environment.border_segment] == FRONTIER
    bias, variance = noise
    steady = scanner.reading[:, 6] > 0.0
    return BuildingRecord(
        cast,
        BeamNoise(scanner.near, scanner.far, bias, variance, frontier, scanner.sensor, steady),
        table,
        bound,
        level.values,
        fisher.values,
        level.free,
        (*level.origin, 1.0 / level.spacing),
        lattice.links,
        lattice.frame,
        environment.bounds,
    )
