"""Building of an environment's ambiguity map for a scanner, tile by tile."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.cost_layer import cost_layer
from ambinav.ambiguity.dataset import LatticeSums, assemble, labels
from ambinav.ambiguity.feasible_poses import standing_lattice
from ambinav.ambiguity.heading import turning_moments, turns
from ambinav.ambiguity.kernel import neighbourhood_sums
from ambinav.ambiguity.model import BEAMS_PER_TURN as BEAMS_PER_TURN
from ambinav.ambiguity.model import AmbiguityModel, independent_tau, thin
from ambinav.ambiguity.neighbourhoods import disc
from ambinav.ambiguity.returns import Returns, blind_share, panorama_returns
from ambinav.casting.scans import check_rays
from ambinav.config import as_count, check_kind
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.maps import schema
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.array_types import Bools, Bytes, Floats
from ambinav.runtime.arrays import line_of_floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Progress, reporter, within
from ambinav.sensing.scanner import RangeScanner

if TYPE_CHECKING:
    from ambinav.store.map_store import MapStore

# Headings of a map whose scanner does not look all around.
HEADINGS = 8
# Bytes of beam returns that are held at a time.
TILE_BYTES = 256_000_000
# Fewest poses in a tile, so that there is work for every thread.
TILE_POSES = 4096
# The neighbourhood has at most so many cells along its radius; the time grows with the square.
MOST_CELLS = 100


@dataclass(frozen=True, eq=False)
class MapSettings:
    """Checked settings of a map.

    Attributes:
        scanner: The scanner that the map is for.
        mounted: The same, in the robot's centre if one heading represents all.
        thinned: Its beams that take part.
        model: The parameters.
        spacing: Spacing of the lattice, metres.
        theta: Headings, radians, shape (H,), or None for a map without heading.
        layers: Names of further layers, with the one that costs read.
    """

    scanner: RangeScanner
    mounted: RangeScanner
    thinned: RangeScanner
    model: AmbiguityModel
    spacing: float
    theta: Floats | None
    layers: tuple[str, ...]

    @property
    def headings(self) -> Floats:
        """Headings, radians; [0] if one represents all."""
        return np.zeros(1) if self.theta is None else self.theta

    @classmethod
    def of(
        cls,
        env: Environment,
        scanner: RangeScanner | str | Path,
        spacing: float = 0.1,
        radius: float = 0.5,
        headings: int | None = None,
        map_std: float | None = None,
        *,
        tau: float | None = None,
        max_beams: int | None = None,
        sigma_theta: float = 0.05,
        outlier_share: float = 0.05,
        low: float = 0.35,
        high: float = 0.65,
        robot_radius: float = 0.0,
        layers: str | Iterable[str] = (),
    ) -> MapSettings:
        """Check the arguments of `build_map`, which describes them and the errors."""
        check_kind(env, Environment, "env", "give what `load_environment` returns")
        check_kind(
            scanner, (RangeScanner, str, Path), "scanner",
            "give a RangeScanner, a preset's name or a file",
        )  # fmt: skip
        if not isinstance(scanner, RangeScanner):
            scanner = RangeScanner.load(scanner)
        for name, value in (("spacing", spacing), ("radius", radius)):
            check_kind(value, Real, name, "give a positive number of metres")
        # JSON takes no numbers of NumPy's types.
        spacing, radius = float(spacing), float(radius)
        check_rays(env, scanner.upright[:, 0], scanner.upright[:, 1])
        names = (layers,) if isinstance(layers, str) else tuple(layers)
        names += tuple({cost_layer(scanner)} - schema.CORE)
        if names:
            # Only where they are wanted.
            from ambinav.layers.registry import chosen_layers

            names = tuple(layer.name for layer in chosen_layers(names, scanner, env))
        if not (math.isfinite(spacing) and spacing > 0.0):
            raise InputError(f"spacing is {spacing}; give a positive number of metres.")
        if not (math.isfinite(radius) and radius >= spacing):
            raise InputError(
                f"radius is {radius} m and spacing {spacing:g} m; the neighbourhood needs a radius "
                "(--ambiguity-radius) of at least one spacing (--spacing)."
            )
        if radius > MOST_CELLS * spacing:
            raise InputError(
                f"radius is {radius:g} m, {radius / spacing:.0f} cells of {spacing:g} m; give at "
                f"most {MOST_CELLS} cells, {MOST_CELLS * spacing:g} m, or a wider spacing."
            )
        if headings is not None:
            headings = as_count(headings, "headings")
        if headings is None and not scanner.looks_all_around:
            headings = HEADINGS
        mounted = scanner.centred if headings is None else scanner
        thinned = thin(mounted, max_beams)
        if headings is None and not thinned.looks_all_around:
            # The few beams that are kept look elsewhere at every heading.
            headings, mounted = HEADINGS, scanner
            thinned = thin(mounted, max_beams)
        model = AmbiguityModel(
            radius=radius,
            map_std=env.map_std if map_std is None else map_std,
            tau=independent_tau(thinned) if tau is None else tau,
            sigma_theta=sigma_theta,
            outlier_share=outlier_share,
            low=low,
            high=high,
            robot_radius=robot_radius,
        )
        theta = None if headings is None else 2 * math.pi * np.arange(headings) / headings
        return cls(scanner, mounted, thinned, model, spacing, theta, names)


def build_map(
    env: Environment,
    scanner: RangeScanner | str | Path,
    spacing: float = 0.1,
    radius: float = 0.5,
    headings: int | None = None,
    map_std: float | None = None,
    progress: bool | Progress = False,
    *,
    tau: float | None = None,
    max_beams: int | None = None,
    sigma_theta: float = 0.05,
    outlier_share: float = 0.05,
    low: float = 0.35,
    high: float = 0.65,
    robot_radius: float = 0.0,
    layers: str | Iterable[str] = (),
    store: bool | MapStore = True,
) -> AmbiguityMap:
    """Compute the ambiguity of every free pose of `env` for `scanner`, or open a stored map.

    Args:
        env: The environment.
        scanner: The scanner, a preset's name (`ambinav presets`), or the path of a scanner file.
        spacing: Distance between lattice points, metres.
        radius: Radius of the neighbourhood of a pose within which scans are compared, metres.
        headings: Number of headings, evenly from 0; None: one if the scanner looks all around
            (the map then has no theta axis, and is computed for the scanner in the robot's
            centre: `RangeScanner.centred`), else 8.
        map_std: Standard deviation of the walls' position, metres; None: 0.03 for occupancy
            maps, whatever their cells, and 0.02 for drawn polygons (`Environment.map_std`).
        progress: True for a progress bar on standard error, or a function that is called with
            the share done, from 0 to 1.
        tau: Number of beams that carry one independent piece of evidence, at least 1; None: so that
            there are 15 pieces per turn.
        max_beams: Maximum number of beams used, evenly chosen; None: 60 per turn. With so few that
            they do not look all around, the map has headings.
        sigma_theta: Standard deviation of the heading that is known beforehand, radians.
        outlier_share: Share of beams that hit objects that are not in the map.
        low: A radius ratio up to this counts as small when zones are distinguished.
        high: A radius ratio from this on counts as large.
        robot_radius: Radius of the robot's body, metres. Where the body or a sensor would be inside
            a wall, the pose is impossible: it has no value, and is no neighbour of others.
        layers: Names of further layers, or "all" (`ambinav.layers.registry`); the default layer of
            costs (`ambinav.ambiguity.cost_layer`) is always included.
        store: Store from which a map with the same input is opened, and in which new maps are
            stored: True for the user's own store, or a store. False always computes, as does the
            whole process if $AMBINAV_CACHE is empty. Maps that involve other code (a plug-in's
            layer, a derived class) are always computed.

    Returns:
        The map; its dataset's layers are named in `AmbiguityMap`.

    Raises:
        InputError: an argument is out of its range, there is no such scanner, building and scanner
            do not go together (`casting.scans.check_rays`), the scanner cannot have a layer, the
            robot can stand nowhere, $AMBINAV_CACHE is a file, or $AMBINAV_CACHE_LIMIT is no size.

    Warns:
        InputWarning: a stored map is damaged or of a newer ambinav and is computed again, or the
            map cannot be stored (`MapStore.opened_or_built`).
    """
    settings = MapSettings.of(
        env, scanner, spacing, radius, headings, map_std, tau=tau, max_beams=max_beams,
        sigma_theta=sigma_theta, outlier_share=outlier_share, low=low, high=high,
        robot_radius=robot_radius, layers=layers,
    )  # fmt: skip
    scanner, mounted, thinned = settings.scanner, settings.mounted, settings.thinned
    model, theta, names = settings.model, settings.theta, settings.layers
    spacing = settings.spacing

    def compute(report: Progress) -> AmbiguityMap:
        parts = 1 + len(names)
        lattice, results = computed_lattice(
            env, spacing, mounted, thinned, model, theta, within(report, 0.0, 1.0 / parts)
        )
        amap = AmbiguityMap(assemble(lattice, scanner, thinned, model, theta, results))
        if names:
            from ambinav.layers.build import with_layers

            amap = with_layers(
                amap,
                names,
                environment=env,
                progress=within(report, 1.0 / parts, (1.0 + len(names)) / parts),
            )
        return amap

    with reporter(progress, f"{env.name}, {scanner.name}") as report:
        if store is False:
            return compute(report)
        from ambinav.map_building.stored import map_key, opened_or_computed

        key = map_key(env, scanner, thinned, model, spacing, theta, names)
        map_store = None if store is True else store
        return opened_or_computed(key, labels(env, scanner), compute, report, map_store)


def computed_lattice(
    env: Environment,
    spacing: float,
    mounted: RangeScanner,
    thinned: RangeScanner,
    model: AmbiguityModel,
    theta: Floats | None,
    report: Progress,
) -> tuple[Lattice, LatticeSums]:
    """Compute every pose of a building where the robot can stand.

    Args:
        env: The building.
        spacing: Spacing of the lattice, metres.
        mounted: The scanner, in the robot's centre if one heading represents all.
        thinned: Its beams that take part.
        model: The parameters.
        theta: Headings, radians, shape (H,), or None for a map without heading.
        report: Called with the share done.

    Returns:
        The lattice of the points where it can stand at some heading, and the results there.

    Raises:
        InputError: there is none, see `Lattice.over` and `standing_lattice`.
    """
    headings = np.zeros(1) if theta is None else theta
    lattice, possible = standing_lattice(
        Lattice.over(env, spacing), mounted, headings, model.robot_radius
    )
    return lattice, _compute(lattice, possible, thinned, model, theta, report)


@dataclass(frozen=True)
class Tile:
    """Indices of the poses of a band of rows, and of the poses that it is compared with."""

    begin: int
    end: int
    first: int
    last: int


def tiled(lattice: Lattice, reach: int, bytes_per_pose: int) -> Iterator[Tile]:
    """Yield bands of rows such that a band and its neighbours fit into `TILE_BYTES`."""
    before = np.concatenate([[0], np.cumsum(lattice.free.sum(axis=1))])
    rows = len(lattice.y)
    poses_per_tile = max(TILE_BYTES // bytes_per_pose, TILE_POSES)
    row = 0
    while row < rows:
        first = int(before[max(row - reach, 0)])
        until = row + 1
        while until < rows and before[min(until + 1 + reach, rows)] - first <= poses_per_tile:
            until += 1
        last = int(before[min(until + reach, rows)])
        if before[until] > before[row]:
            yield Tile(int(before[row]), int(before[until]), first, last)
        row = until


def _compute(
    lattice: Lattice,
    possible: Bools,
    scanner: RangeScanner,
    model: AmbiguityModel,
    theta: Floats | None,
    report: Progress,
) -> LatticeSums:
    table = BeamTable.of(
        scanner, model.map_std, model.outlier_share, lattice.environment.has_reflectors
    )
    evidences = table.evidence
    angles = np.zeros(1) if theta is None else theta
    offsets = disc(model.radius, lattice.spacing)
    reach = int(offsets.max())
    x, y = lattice.points
    sums = np.empty((len(x), len(angles), 7))
    # In most cases the robot can stand at all headings or at none.
    link_headings = len(angles) if (possible != possible[:, :1]).any() else 1
    links: Bytes = np.stack([lattice.links_among(possible[:, h]) for h in range(link_headings)])
    turning = np.empty((len(x), 2)) if theta is None and scanner.turns_in_place else None
    beams = turns(scanner) if turning is not None else None
    width = len(table.limit)
    unknown = np.empty(len(x))
    tiles = list(tiled(lattice, reach, len(angles) * 5 * width * 4))
    largest_tile = max(tile.last - tile.first for tile in tiles)
    # Once for all tiles: it takes the system as long to hand out pages as to fill them.
    shape = (len(angles), largest_tile, 5, width)
    data = line_of_floats(math.prod(shape)).reshape(shape)
    first = last = 0
    for tile in tiles:
        # Rows that this tile shares with the one before are not cast again.
        fresh = max(last, tile.first)
        data[:, : fresh - tile.first] = data[:, tile.first - first : fresh - first]
        panorama_returns(
            lattice.environment, scanner, table, x[fresh : tile.last], y[fresh : tile.last],
            angles, data, fresh - tile.first,
        )  # fmt: skip
        linked = links[:, tile.first : tile.last].copy()
        # A piece a heading, so that progress shows.
        for begin, end in pairwise(np.linspace(tile.begin, tile.end, len(angles) + 1).astype(int)):
            sums[begin:end] = neighbourhood_sums(
                np.arange(begin, end), tile.first, lattice.rows_columns, lattice.index, linked,
                offsets, lattice.spacing, data, table, evidences, model.tau,
                model.cell_variance(lattice.spacing),
            )  # fmt: skip
            report(end / len(x))
        if turning is not None and beams is not None:
            turning[tile.begin : tile.end] = turning_moments(
                Returns(data[0]), np.arange(tile.begin, tile.end) - tile.first, beams, table,
                evidences, model.tau, lattice.spacing,
            )  # fmt: skip
        blind = blind_share(data, tile.begin - tile.first, tile.end - tile.first, table.beams)
        unknown[tile.begin : tile.end] = blind.mean(axis=1, where=possible[tile.begin : tile.end])
        first, last = tile.first, tile.last
    sums[~possible] = np.nan
    report(1.0)
    return LatticeSums(sums, unknown, turning)
