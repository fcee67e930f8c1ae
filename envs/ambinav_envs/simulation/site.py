"""A building made ready for the kernels."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER
from ambinav.localization.casting import CastTables, cast_tables
from ambinav.localization.information import as_map_std, beam_noise
from ambinav.localization.likelihood_field import LikelihoodField
from ambinav.service.service import AmbiguityService
from ambinav_envs.buildings.building import Building
from ambinav_envs.buildings.free_space import Places
from ambinav_envs.buildings.goals import Goals
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.simulation.layout import GROUND
from ambinav_envs.simulation.pointers import address
from ambinav_envs.simulation.scanner_kernel import Eyes, eyes_of

# So many buildings are kept ready; those that robots are in stay anyway.
KEPT = 512


class Site:
    """A building made ready: all arrays that kernels look at, and where they are.

    Args:
        building: The building.
        parameters: Scanner and layer.
        noise: Bias and variance of each sensor, see `BeamNoise`.

    Attributes:
        building: As given.
        places: Where the robot fits.
        goals: Where episodes lead to.
        tables: For casting rays.
        address: Of its `GROUND`, valid as long as the site lives.
    """

    def __init__(
        self,
        building: Building,
        parameters: NavigationParameters,
        noise: tuple[NDArray[np.float64], NDArray[np.float64]],
    ) -> None:
        environment = building.environment
        self.building = building
        self.places: Places = building.places
        beams = np.arange(parameters.scanner.beams)
        self.tables: CastTables = cast_tables(environment, parameters.scanner, beams)
        # The service refuses layers that are no amount of ambiguity.
        level = AmbiguityService(building.amap, parameters.cost_layer, 1.0).ambiguity
        weight = parameters.way_weight
        prices = self.places.prices(level, weight) if weight > 0.0 else None
        self.goals = Goals(self.places, prices)
        fisher = AmbiguityService(building.amap, "fisher", 1.0).ambiguity
        kinds = environment.segments.kind[environment.border_segment]
        self._kept: list[NDArray[Any]] = []
        self._ground = np.zeros(1, dtype=GROUND)
        tables, places = self.tables, self.places
        table, bound, _ = building.checker.arrays
        self._put(
            grid_x=tables.grid_x, grid_y=tables.grid_y, cell=tables.cell, rows=tables.rows,
            columns=tables.columns, half_edges=len(tables.corner), edges=len(tables.border),
            items=len(tables.item), numbers=table.size, bound_rows=bound.shape[0],
            bound_columns=bound.shape[1], level_headings=level.values.shape[2],
            fisher_headings=fisher.values.shape[2], map_rows=level.values.shape[0],
            map_columns=level.values.shape[1], left=level.origin[0], low=level.origin[1],
            inverse=1.0 / level.spacing, field_rows=places.room.shape[0],
            field_columns=places.room.shape[1], field_x=places.origin[0],
            field_y=places.origin[1], field_inverse=1.0 / places.spacing,
            bounds=environment.bounds,
        )  # fmt: skip
        self._point(
            border_segment=(tables.border_segment, np.int32), border=(tables.border, np.float64),
            twin=(tables.twin, np.int32), node=(tables.node, np.float64),
            corner=(tables.corner, np.float64), grid_start=(tables.grid_start, np.int32),
            item=(tables.item, np.int32), triangle=(tables.triangle, np.float64),
            normal=(tables.normal, np.float64),
            frontier=(kinds == FRONTIER, np.bool_), bias=(noise[0], np.float64),
            variance=(noise[1], np.float64), table=(table, np.float64),
            bound=(bound, np.float32), level=(level.values, np.float32),
            fisher=(fisher.values, np.float32), free=(level.free, np.bool_),
            links=(places.links, np.uint8),
        )  # fmt: skip
        self.address = address(self._ground, GROUND)
        self._likelihood: dict[tuple[float, float], LikelihoodField] = {}

    def likelihood(self, resolution: float, reach: float) -> LikelihoodField:
        """The field that particle filters share, see `LikelihoodField.of`."""
        key = resolution, reach
        if key not in self._likelihood:
            environment = self.building.environment
            self._likelihood[key] = LikelihoodField.of(environment, resolution, reach)
        return self._likelihood[key]

    def _put(self, **numbers: float | tuple[float, ...]) -> None:
        for name, number in numbers.items():
            self._ground[name] = number

    def _point(self, **arrays: tuple[NDArray[Any], Any]) -> None:
        for name, (array, dtype) in arrays.items():
            self._kept.append(array)
            self._ground[name] = address(array, dtype)


class Sites:
    """Buildings made ready, the latest ones kept.

    Args:
        parameters: Robot, scanner and layer.
    """

    def __init__(self, parameters: NavigationParameters) -> None:
        self._parameters = parameters
        self._sites: OrderedDict[str, Site] = OrderedDict()
        self._noise: dict[float, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}

    def of(self, building: Building) -> Site:
        """The site of a building."""
        site = self._sites.get(building.key)
        if site is None or site.building is not building:
            site = Site(building, self._parameters, self._noise_in(building.environment))
            self._sites[building.key] = site
        self._sites.move_to_end(building.key)
        while len(self._sites) > KEPT:
            self._sites.popitem(last=False)
        return site

    def _noise_in(
        self, environment: Environment
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Bias and variance of the sensors; maps differ in the walls' deviation alone."""
        std = as_map_std(environment, self._parameters.map_std)
        if std not in self._noise:
            scanner = self._parameters.scanner
            noise = beam_noise(environment, scanner, std)
            # One row a sensor.
            _, first = np.unique(scanner.sensor_of_beam, return_index=True)
            self._noise[std] = noise.bias[first], noise.variance[first]
        return self._noise[std]


def eyes_for(parameters: NavigationParameters, site: Site) -> Eyes:
    """The scanner's own arrays, which any site has."""
    return eyes_of(parameters.scanner, site.tables)
