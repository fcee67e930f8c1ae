"""Buildings prepared for the robots of a simulation."""

from __future__ import annotations

from collections import OrderedDict
from functools import cached_property

import numpy as np

from ambinav.casting.mesh.mesh import Mesh
from ambinav.geometry.environment import Environment
from ambinav.localization.casting import CastTables, cast_tables
from ambinav.localization.information import as_map_std, beam_noise
from ambinav.runtime.array_types import Floats
from ambinav.service.service import AmbiguityService
from ambinav_envs.buildings.aliases import Aliases
from ambinav_envs.buildings.building import Building
from ambinav_envs.buildings.free_space import MARGIN, FreeSpaceArrays, FreeSpaceLattice
from ambinav_envs.buildings.goals import Goals
from ambinav_envs.buildings.world import World
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.simulation.building_record import BuildingRecord, Walls, building_record
from ambinav_envs.simulation.cost_to_go import CostToGoTable
from ambinav_envs.simulation.layout import EKF, LOCALIZERS, MCL
from ambinav_envs.simulation.mesh_scan import MeshScan
from ambinav_envs.simulation.particles import ParticleMap, particle_map
from ambinav_envs.simulation.scanner_kernel import ScannerArrays

# Number of cached buildings; those with robots are always kept.
KEPT = 512

Noise = tuple[Floats, Floats]


class Site:
    """A prepared building: all arrays that kernels read.

    Args:
        building: The building.
        number: Unique number within the simulation.
        cast: Its walls and the scanner's rays.
        scanner: The scanner.
        noise: Bias and variance of each sensor, see `BeamNoise`.
        parameters: Layer and price of ambiguity.

    Attributes:
        building: The given value.
        number: The given value.
        lattice: Lattice of the map.
        world: The true building.
        goals: Goals of the episodes.
        record: The kernels' data of the map.
        truth: The kernels' data of the world; None where that is the map.
        mesh_scan: Simulated scanner in a mesh; None elsewhere, where kernels simulate it.
        costs_to_go: Costs to go of the goals that robots drive to.
        particles: Data of the particle filters; None without them.
    """

    def __init__(
        self,
        building: Building,
        number: int,
        cast: CastTables,
        scanner: ScannerArrays,
        noise: Noise,
        parameters: NavigationParameters,
    ) -> None:
        self.building, self.number = building, number
        self._alias_count = parameters.start_aliases
        self.lattice: FreeSpaceLattice = building.lattice
        # The service refuses layers that do not measure ambiguity.
        level = AmbiguityService(building.amap, parameters.cost_layer, 1.0).ambiguity
        weight = parameters.ambiguity_weight
        prices = self.lattice.prices(level, weight) if weight > 0.0 else None
        self.world = World.of(building, parameters.walls_std, parameters.furniture_std)
        self.goals = Goals(self.lattice, prices, self.world.lattice)
        fisher = AmbiguityService(building.amap, "fisher", 1.0).ambiguity
        self.record: BuildingRecord = building_record(building, cast, scanner, noise, level, fisher)
        self.truth: BuildingRecord | None = None
        if self.world.lattice is not self.lattice:
            self.truth = _true_record(self.record, self.world, parameters)
        self.mesh_scan: MeshScan | None = None
        space = building.environment.space
        if isinstance(space, Mesh):
            self.mesh_scan = MeshScan(building.environment, space, parameters.scanner, scanner)
        self.costs_to_go = CostToGoTable(self.world.lattice)
        self.particles: ParticleMap | None = None
        if parameters.localizer == LOCALIZERS[MCL]:
            self.particles = particle_map(building.environment, parameters)

    @cached_property
    def aliases(self) -> Aliases:
        """Aliased poses of its map, as many of each as the parameters ask for."""
        return Aliases.of(self.building, self._alias_count)

    @property
    def table(self) -> FreeSpaceArrays:
        """`FreeSpaceLattice.table` with the clearance on the map and in the world."""
        if self.truth is None:
            return self.lattice.table
        room = np.minimum(self.lattice.room, self.world.lattice.room)
        return self.lattice.table._replace(room=room, standing=np.flatnonzero(room >= MARGIN))


def _true_record(
    record: BuildingRecord, world: World, parameters: NavigationParameters
) -> BuildingRecord:
    """Return a map's record with the walls of the world."""
    table, bound, _ = world.lattice.checker.arrays
    scanner = parameters.scanner
    cast = cast_tables(world.environment, scanner, np.arange(scanner.beams))
    return record._replace(cast=cast, walls=Walls(table, bound), bounds=world.environment.bounds)


class Sites:
    """Prepared buildings, of which the latest are cached.

    Args:
        parameters: Robot, scanner and layer.
        scanner: The scanner, as kernels read it.
    """

    def __init__(self, parameters: NavigationParameters, scanner: ScannerArrays) -> None:
        self._parameters = parameters
        self._scanner = scanner
        self._beams = np.arange(parameters.scanner.beams)
        self._sites: OrderedDict[str, Site] = OrderedDict()
        self._noise: dict[float, Noise] = {}
        self._made = 0

    def of(self, building: Building) -> Site:
        """Return the prepared site of a building.

        Raises:
            InputError: it is a mesh and the localizer casts rays.
        """
        site = self._sites.get(building.key)
        if site is None or site.building is not building:
            cast = self._tables(building.environment)
            noise = self._noise_in(building.environment)
            site = Site(building, self._made, cast, self._scanner, noise, self._parameters)
            self._made += 1
            self._sites[building.key] = site
        self._sites.move_to_end(building.key)
        while len(self._sites) > KEPT:
            self._sites.popitem(last=False)
        return site

    def _tables(self, environment: Environment) -> CastTables:
        """Return the tables for ray casting; in a mesh, where no kernel casts, one without rays."""
        scanner, localizer = self._parameters.scanner, self._parameters.localizer
        if isinstance(environment.space, Mesh) and localizer != LOCALIZERS[EKF]:
            return cast_tables(environment.plan, scanner, self._beams[:0])
        return cast_tables(environment, scanner, self._beams)

    def _noise_in(self, environment: Environment) -> Noise:
        """Return bias and variance of the sensors; maps differ only in the walls' deviation."""
        std = as_map_std(environment, self._parameters.map_std)
        if std not in self._noise:
            scanner = self._parameters.scanner
            noise = beam_noise(environment, scanner, std)
            # One row a sensor.
            _, first = np.unique(scanner.sensor_of_beam, return_index=True)
            self._noise[std] = noise.bias[first], noise.variance[first]
        return self._noise[std]
