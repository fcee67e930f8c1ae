"""A building for the kernels: named arrays, computed once and never written to."""

from __future__ import annotations

from typing import NamedTuple

from ambinav.geometry.segments import FRONTIER
from ambinav.localization.casting import CastTables
from ambinav.localization.information import BeamNoise
from ambinav.localization.prism_tables import edge_kinds
from ambinav.runtime.array_types import Bools, Floats, Floats32
from ambinav.service.field import Field
from ambinav_envs.buildings.building import Building
from ambinav_envs.simulation.scanner_kernel import ScannerArrays


class Walls(NamedTuple):
    """The geometry of collision checks: the first two of `CollisionChecker.arrays`."""

    table: Floats
    bound: Floats32


class MapLayers(NamedTuple):
    """Layers of the ambiguity map.

    Attributes:
        level: The layer that rewards and windows show, float32, shape (rows, columns, headings),
            headings 1 if it does not depend on them.
        fisher: The layer `fisher`, likewise.
        free: Free cells, shape (rows, columns).
        frame: x and y of cell (0, 0), metres, map frame, and cells per metre.
    """

    level: Floats32
    fisher: Floats32
    free: Bools
    frame: tuple[float, float, float]


class BuildingRecord(NamedTuple):
    """All data of a building that a simulation step reads.

    Attributes:
        cast: Walls and the scanner's rays.
        noise: Noise of the beams; one row of bias and variance a sensor.
        walls: Geometry of the collision checks.
        layers: Layers of the ambiguity map.
        bounds: Left, lower, right and upper end, metres, map frame.
    """

    cast: CastTables
    noise: BeamNoise
    walls: Walls
    layers: MapLayers
    bounds: tuple[float, float, float, float]


def building_record(
    building: Building,
    cast: CastTables,
    scanner: ScannerArrays,
    noise: tuple[Floats, Floats],
    level: Field,
    fisher: Field,
) -> BuildingRecord:
    """Collect a building's arrays.

    Args:
        building: The building.
        cast: Its walls and all beams of the scanner.
        scanner: The scanner.
        noise: Bias and variance of each sensor, see `BeamNoise`.
        level: The layer that rewards and windows show.
        fisher: The layer `fisher`, on the same lattice.
    """
    environment = building.environment
    table, bound, _ = building.checker.arrays
    frontier = edge_kinds(environment) == FRONTIER
    bias, variance = noise
    steady = scanner.reading[:, 6] > 0.0
    return BuildingRecord(
        cast,
        BeamNoise(scanner.near, scanner.far, bias, variance, frontier, scanner.sensor, steady),
        Walls(table, bound),
        MapLayers(level.values, fisher.values, level.free, (*level.origin, 1.0 / level.spacing)),
        environment.bounds,
    )
