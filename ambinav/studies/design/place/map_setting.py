"""Settings of a map, so that parts of it can be computed again."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.feasible_poses import standing_lattice
from ambinav.ambiguity.model import AmbiguityModel
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.array_types import Bools, Floats
from ambinav.sensing.scanner import RangeScanner


@dataclass(frozen=True, eq=False)
class MapSetting:
    """Settings of a map.

    Attributes:
        scanner: Scanner with the mounts and beams that took part.
        model: The parameters.
        headings: Radians, float64, shape (H,).
        spacing: Spacing of the lattice, metres.
        table: Table of the beams.
    """

    scanner: RangeScanner
    model: AmbiguityModel
    headings: Floats
    spacing: float
    table: BeamTable

    @classmethod
    def of(cls, amap: AmbiguityMap, scanner: RangeScanner, reflectors: bool = False) -> MapSetting:
        """Return the settings of a map that `build_map` made for `scanner`.

        Args:
            amap: The map.
            scanner: Scanner of the map, with all beams and its true mounts.
            reflectors: Whether there are reflectors, or will be.
        """
        parameters = amap.parameters
        model = AmbiguityModel(
            **{field.name: parameters[field.name] for field in fields(AmbiguityModel)}
        )
        headings = amap.dataset["theta"].values if amap.has_theta else np.zeros(1)
        mounted = scanner if amap.has_theta else scanner.centred
        thinned = mounted.thinned(parameters["beams_used"])
        table = BeamTable.of(thinned, model.map_std, model.outlier_share, reflectors)
        return cls(thinned, model, headings, parameters["spacing"], table)

    def lattice(self, environment: Environment) -> tuple[Lattice, Bools]:
        """Return the map's lattice, N points, and where the robot can stand at H headings.

        The mask has the shape (N, H).
        """
        return standing_lattice(
            Lattice.over(environment, self.spacing), self.scanner, self.headings,
            self.model.robot_radius,
        )  # fmt: skip
