"""Sampled poses of a building on which beam subsets are compared with all beams.

The beams are cast once. A subset is columns of what they returned, compared by the real kernel
(`Neighbourhoods`), so a subset is measured, not estimated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.feasible_poses import standing_lattice
from ambinav.ambiguity.model import AmbiguityModel, independent_tau
from ambinav.ambiguity.neighbourhoods import Neighbourhoods
from ambinav.ambiguity.returns import panorama_returns
from ambinav.ambiguity.tensor import classify, relative_radii
from ambinav.geometry.collision.reach import Reach
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.runtime.array_types import Bools, Bytes, Floats, Floats32, Indices
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.design.beams.loss import POINTS, Loss
from ambinav.studies.design.explored import explored
from ambinav.studies.design.region import ALL_HEADINGS, Places, Region

HEADINGS = 4
"""Headings of a sample, a quarter of a turn apart, from one that is drawn. A subset of the beams
of a scanner that looks all around does not, so it is measured at headings that no wall is
aligned with; another sample has others."""
ROUTE_HEADINGS = 24
"""Headings that those of a route are rounded to."""

Beams = Sequence[int] | Indices


def subset_tau(full: RangeScanner, beams: int) -> float:
    """Compute the beams per independent piece of evidence for a subset of a given size.

    The pieces a turn stay those of the full scanner: its tau times the share of beams that is
    kept, but at least 1. So a beam that is left out takes no evidence with it as long as there
    are more beams than pieces (15 a turn), and one piece from there on.
    """
    return max(1.0, independent_tau(full) * beams / full.beams)


@dataclass(frozen=True, eq=False)
class PoseGroup:
    """M poses at one heading, with the returns of every beam there and at N poses around them.

    Attributes:
        around: The poses and their neighbours.
        columns: float32, shape (B + K, N, 5): see `Returns`, column by column of the full
            scanner's `BeamTable`, the intensities of K beams last.
    """

    around: Neighbourhoods
    columns: Floats32


@dataclass(frozen=True, eq=False)
class MapSample:
    """Sampled poses of one building.

    Attributes:
        name: Name of the building.
        scanner: The full scanner, B beams.
        table: Its beams.
        model: The parameters, with the full scanner's tau.
        groups: The poses, by heading.
        weight: Weight of each of the M poses, group after group, shape (M,); they sum to 1.
        level: Level with all beams, shape (M,).
        zone: Zone with all beams, uint8, shape (M,).
    """

    name: str
    scanner: RangeScanner
    table: BeamTable
    model: AmbiguityModel
    groups: tuple[PoseGroup, ...]
    weight: Floats
    level: Floats
    zone: Bytes

    def measure(self, beams: Beams) -> tuple[Floats, Bytes]:
        """Compute `level` and zone of the poses for a subset of the beams, each of shape (M,)."""
        model = self.model_of(len(beams))
        table, columns = self.table.subset(beams), self.table.columns_of(beams)
        sums = [
            group.around.sums(packed(group.columns, columns, len(table.limit)), table, model)[:, 0]
            for group in self.groups
        ]
        return _rated(np.concatenate(sums), model)

    def model_of(self, beams: int) -> AmbiguityModel:
        """Return the model parameters for a number of beams."""
        return replace(self.model, tau=subset_tau(self.scanner, beams))

    def loss(self, beams: Beams) -> Loss:
        """Compute the loss of a subset of the beams."""
        return Loss.between(*self.measure(beams), self.level, self.zone, self.weight)

    def level_loss(self, level: Floats) -> float:
        """Compute `Loss.level` of measured levels."""
        return POINTS * float(self.weight @ np.abs(level - self.level))


def packed(columns: Floats32, chosen: Indices, width: int) -> Floats32:
    """Arrange columns of all (B + K, N, 5) in the layout of `Returns`, shape (1, N, 5, width)."""
    # Padding is multiplied by 0, and so must be finite.
    data = np.ones((1, *columns.shape[1:], width), dtype=np.float32)
    for place, column in enumerate(chosen):
        data[0, :, :, place] = columns[column]
    return data


def _rated(sums: Floats, model: AmbiguityModel) -> tuple[Floats, Bytes]:
    layers = relative_radii(sums)
    return layers["level"], classify(layers["major"], layers["minor"], model.low, model.high)


def rng_of(env: Environment, seed: int, purpose: str) -> np.random.Generator:
    """Return a generator for a building, which depends on no other building."""
    return np.random.default_rng([seed, *purpose.encode(), int(env.checksum[:16], 16)])


def draw_samples(
    env: Environment,
    scanner: RangeScanner,
    places: int,
    rng: np.random.Generator,
    *,
    spacing: float,
    radius: float,
    map_std: float | None = None,
    region: Region | None = None,
    reach: Reach | None = None,
    samples: int = 2,
    headings: Floats | None = None,
) -> tuple[MapSample, ...]:
    """Sample poses of the explored floor, as in the scanner's map, and cast all beams there.

    Args:
        env: The building.
        scanner: The full scanner; all its beams take part.
        places: How many poses a sample has at most.
        rng: Draws them.
        spacing: Spacing of the lattice, metres.
        radius: Radius of the neighbourhoods, metres.
        map_std: Deviation of the walls, metres; None: the building's own.
        region: Region to sample, with its headings; None: all of the map.
        reach: Floor that the robot reaches; None: all floor counts.
        samples: How many samples to draw, no place in two of them.
        headings: Radians, the same for all samples; None: they are drawn.

    Raises:
        InputError: no pose is left, or the region, spacing or scanner do not suit the building.
    """
    region = Region.of_map() if region is None else region
    scanner = scanner.centred
    model = AmbiguityModel(
        radius=radius,
        map_std=env.map_std if map_std is None else map_std,
        tau=independent_tau(scanner),
    )
    if headings is None:
        count = samples * (HEADINGS if region.route is None else ROUTE_HEADINGS)
        turn = 2 * math.pi / count
        headings = np.asarray(rng.uniform(0.0, turn) + turn * np.arange(count), dtype=np.float64)
    lattice, possible = standing_lattice(Lattice.over(env, spacing), scanner, headings)
    region_places = region.places(lattice, headings, reach)
    region_places = region_places.sampled(lattice, samples * places, rng)
    known = explored(lattice, scanner, region_places.point, model)
    if not known.any():
        raise InputError(
            f"{env.name}: at each of the {len(known)} sampled places half of the beams or more "
            "end in unknown space; give an explored region, or more --places."
        )
    region_places = region_places.among(known)
    drawn = []
    for number in range(samples):
        part = region_places.among(np.arange(len(region_places)) % samples == number)
        # Each at one heading of the sample's own, where the region does not say at which.
        random = rng.integers(0, len(headings[number::samples]), len(part)) * samples + number
        heading = np.where(part.heading == ALL_HEADINGS, random, part.heading)
        stands = possible[part.point, heading]
        part = replace(part, heading=heading).among(stands)
        drawn.append(_cast(scanner, lattice, possible, headings, part, model))
    return tuple(drawn)


def _cast(
    scanner: RangeScanner,
    lattice: Lattice,
    possible: Bools,
    headings: Floats,
    places: Places,
    model: AmbiguityModel,
) -> MapSample:
    """Cast all beams at places that have a heading and around them."""
    env = lattice.environment
    table = BeamTable.of(scanner, model.map_std, model.outlier_share, env.has_reflectors)
    groups, weights, sums = [], [], []
    for h in np.unique(places.heading):
        here, angle = places.among(places.heading == h), headings[h : h + 1]
        chosen = np.zeros(len(possible), dtype=np.bool_)
        chosen[here.point] = True
        around = Neighbourhoods.around(lattice, possible[:, h : h + 1], chosen, model.radius)
        x, y = around.lattice.points
        data = np.empty((1, len(x), 5, len(table.limit)), dtype=np.float32)
        panorama_returns(env, scanner, table, x, y, angle, data)
        columns = np.ascontiguousarray(data[0, :, :, : table.columns].transpose(2, 0, 1))
        groups.append(PoseGroup(around, columns))
        # Points are ascending, and so are `around.poses`.
        weights.append(here.weight)
        sums.append(around.sums(data, table, model)[:, 0])
    if not groups:
        raise InputError(
            f"{env.name}: a sample has no place left, for few are explored where the scanner can "
            "stand; give more --places, or another region."
        )
    weight = np.concatenate(weights)
    level, zone = _rated(np.concatenate(sums), model)
    return MapSample(
        env.name, scanner, table, model, tuple(groups), weight / weight.sum(), level, zone
    )
