"""Effect of obstacles on a map, computed without building the map again.

An obstacle shortens the rays that meet it and leaves all others alone (`AddedWalls`). So only the
poses that see it are cast again, and only they and their neighbours are compared again. What comes
out is what a build of the changed building gives, as nearly as
tests/studies/design/test_effect.py says.

The floor that counts stays that of the building as it is: a pose that an obstacle covers keeps
what it had, so that nothing is gained by putting things on bad floor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ambinav.ambiguity.feasible_poses import TOUCHING
from ambinav.ambiguity.neighbourhoods import Neighbourhoods, disc
from ambinav.ambiguity.returns import BEYOND, panorama_returns
from ambinav.ambiguity.tensor import classify, classify_over_headings, relative_radii
from ambinav.casting.added import AddedWalls
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import STEPS
from ambinav.geometry.obstacle import Obstacle
from ambinav.maps.zones import CORRIDOR, OPEN, ZONES
from ambinav.runtime.array_types import Bools, Bytes, Floats, Floats32
from ambinav.runtime.errors import InputError
from ambinav.studies.design.place.map_setting import MapSetting
from ambinav.studies.design.place.obstacle_walls import walls_of
from ambinav.studies.design.region import ALL_HEADINGS, Places

Rows = NDArray[np.int64]

SMOOTH: Final = 0.25
"""Weight of a level of 1 on a square metre against a square metre of bad floor."""
MOST_BYTES: Final = 8e9
"""Returns of the poses that count are held in so much memory at most."""


@dataclass(frozen=True)
class Badness:
    """Bad area or length of the places that count, in square metres or metres of routes.

    Attributes:
        bad: Amount in corridor and open zones.
        level: Sum of the level over those that were bad without any obstacle.
    """

    bad: float
    level: float

    @property
    def cost(self) -> float:
        """Cost to minimize: bad floor, and a small weight on its level.

        One obstacle alone often turns nothing good that two would: then bad floor says nothing of
        which one to begin with, and the level does.
        """
        return self.bad + SMOOTH * self.level

    def __sub__(self, other: Badness) -> Badness:
        """Return the decrease from this badness to the other."""
        return Badness(self.bad - other.bad, self.level - other.level)


@dataclass(frozen=True, eq=False)
class Change:
    """Change of a map by additional obstacles.

    Attributes:
        obstacles: The additional obstacles.
        rows: Poses that count whose scan, or a neighbour's, has changed: rows of `Effects.radii`.
        gain: Bad floor and level that they remove.
        fixed: Places that are bad and turn good, by their number.
        radii: Major, minor and level of the rows, shape (3, R, H).
        among: Poses whose returns may have changed, by their number in the lattice.
        data: Returns of these, shape (H, A, 5, P).
        possible: Where the robot can stand now, shape (N, H).
    """

    obstacles: tuple[Obstacle, ...]
    rows: Rows
    gain: Badness
    fixed: Rows
    radii: Floats
    among: Rows
    data: Floats32
    possible: Bools


class Effects:
    """A building to which obstacles are added in turn, and its bad floor.

    Args:
        environment: The building.
        setting: Settings of its map.
        places: Places that count, on the lattice of that map (`MapSetting.lattice`).

    Raises:
        InputError: the returns of all these places do not fit into memory.
    """

    def __init__(self, environment: Environment, setting: MapSetting, places: Places) -> None:
        self.environment = environment
        self.setting = setting
        self.places = places
        lattice, possible = setting.lattice(environment)
        chosen = np.zeros(len(possible), dtype=np.bool_)
        chosen[places.point] = True
        around = Neighbourhoods.around(lattice, possible, chosen, setting.model.radius)
        self.lattice, self.possible = around.lattice, around.possible
        self.x, self.y = self.lattice.points
        shape = (len(setting.headings), len(self.x), 5, len(setting.table.limit))
        size = 4.0 * float(np.prod(shape, dtype=np.float64))
        if size > MOST_BYTES:
            raise InputError(
                f"--spacing: {setting.spacing:g} m makes {len(self.x):,} poses at {shape[0]} "
                f"headings, whose returns take {size / 1e9:.0f} GB; give a wider one, or a part of "
                "the floor by --polygon or --route."
            )
        self.data = np.empty(shape, dtype=np.float32)
        panorama_returns(
            environment, setting.scanner, setting.table, self.x, self.y, setting.headings, self.data
        )
        self.obstacles: tuple[Obstacle, ...] = ()
        self.walls = AddedWalls.of([], [])
        self.poses = around.poses
        self.rays = setting.scanner.rays(environment.space is not None)
        mounts = np.hypot(*self.rays.origin.T).max()
        self._sight = float(setting.scanner.max_range + BEYOND + mounts)
        # Each place is one of the poses at a heading.
        self._pose = np.searchsorted(np.flatnonzero(chosen), places.point)
        self.radii = self._first_radii = self._compared(around, self.data)
        self.bad, self.level = self._judge_places(np.arange(len(self._pose)), self.radii)
        self._first = self.bad

    @property
    def badness(self) -> Badness:
        """Badness of the current building."""
        return self._badness(np.arange(len(self.bad)), self.bad, self.level)

    @property
    def reach(self) -> float:
        """Distance within which an obstacle may change the map, metres."""
        return self._sight + self.setting.model.radius

    def tried(self, obstacles: Sequence[Obstacle]) -> Change:
        """Compute the change by additional obstacles without adding them."""
        walls = walls_of(obstacles, self.environment)
        possible = self.possible & self._have_room(obstacles)
        shape = shapely.unary_union([obstacle.outline for obstacle in obstacles])
        # Poses whose links may be cut.
        beside = np.zeros(len(self.x), dtype=np.bool_)
        beside[_within(self.x, self.y, shape, 1.5 * self.setting.spacing)] = True
        changed = self._see_walls(walls)
        affected = self._have_neighbour(changed | beside)[self.poses]
        chosen = np.zeros(len(self.x), dtype=np.bool_)
        chosen[self.poses[affected]] = True
        rows = np.flatnonzero(affected)
        if not len(rows):
            none = np.empty(0, dtype=np.int64)
            return Change(
                tuple(obstacles), none, Badness(0.0, 0.0), none, self.radii[:, none], none,
                self.data[:, none], possible,
            )  # fmt: skip
        around = Neighbourhoods.around(self.lattice, possible, chosen, self.setting.model.radius)
        around = self._cut_links(around, (*self.obstacles, *obstacles))
        data = np.take(self.data, around.among, axis=1)  # in C order, for the kernel
        fresh = np.flatnonzero(changed[around.among])
        if len(fresh):
            cast = np.empty((len(data), len(fresh), *data.shape[2:]), dtype=np.float32)
            where = around.among[fresh]
            panorama_returns(
                self.environment, self.setting.scanner, self.setting.table, self.x[where],
                self.y[where], self.setting.headings, cast, added=self.walls + walls,
            )  # fmt: skip
            data[:, fresh] = cast
        radii = self._compared(around, data)
        # A pose that is covered keeps what it had without obstacles.
        radii = np.where(np.isnan(radii), self._first_radii[:, rows], radii)
        return Change(
            tuple(obstacles), rows, *self._gain(rows, radii), radii, around.among[fresh],
            data[:, fresh], possible,
        )  # fmt: skip

    def put(self, change: Change) -> None:
        """Add the obstacles of a change that was computed for the current building."""
        self.obstacles += change.obstacles
        self.walls = self.walls + walls_of(change.obstacles, self.environment)
        self.possible = change.possible
        self.data[:, change.among] = change.data
        self.radii = self.radii.copy()
        self.radii[:, change.rows] = change.radii
        self.bad, self.level = self._judge_places(np.arange(len(self._pose)), self.radii)

    def copy(self) -> Effects:
        """Copy the building to try other obstacles in it."""
        other = object.__new__(Effects)
        other.__dict__.update(self.__dict__)
        other.data = self.data.copy()
        return other

    def areas(self, change: Change | None = None) -> Floats:
        """Return the weight of the places in each zone, with a change or without, shape (zones,).

        In square metres or metres, in the order of `ZONES`.
        """
        radii = self.radii
        if change is not None:
            radii = radii.copy()
            radii[:, change.rows] = change.radii
        zone, _ = self._classified(np.arange(len(self._pose)), radii)
        areas = np.bincount(zone, self.places.weight, minlength=len(ZONES))
        return np.asarray(areas, dtype=np.float64)

    def weights(self, places: Rows) -> Floats:
        """Return the weights of places, square metres or metres."""
        return self.places.weight[places]

    def _gain(self, rows: Rows, radii: Floats) -> tuple[Badness, Rows]:
        number = np.full(len(self.poses), -1)
        number[rows] = np.arange(len(rows))
        mine = np.flatnonzero(number[self._pose] >= 0)
        bad, level = self._judge_places(mine, radii, number)
        before = self._badness(mine, self.bad[mine], self.level[mine])
        return before - self._badness(mine, bad, level), mine[self.bad[mine] & ~bad]

    def _badness(self, places: Rows, bad: Bools, level: Floats) -> Badness:
        weight = self.places.weight[places]
        return Badness(float(weight[bad].sum()), float((weight * level)[self._first[places]].sum()))

    def _judge_places(
        self, places: Rows, radii: Floats, number: Rows | None = None
    ) -> tuple[Bools, Floats]:
        """Return which places are bad, and the level of all; arguments as of `_classified`."""
        zone, level = self._classified(places, radii, number)
        return (zone == CORRIDOR) | (zone == OPEN), level

    def _classified(
        self, places: Rows, radii: Floats, number: Rows | None = None
    ) -> tuple[Bytes, Floats]:
        """Return zone and level of places.

        Args:
            places: Indices of the places.
            radii: Major, minor and level of poses, shape (3, R, H).
            number: Row of `radii` of each pose that counts; None: they are all there, in order.
        """
        pose = self._pose[places]
        of_pose = radii[:, pose if number is None else number[pose]]
        heading = self.places.heading[places]
        model = self.setting.model
        zones = classify(of_pose[0], of_pose[1], model.low, model.high)
        at = np.maximum(heading, 0)[:, None]
        level_at_heading = np.take_along_axis(of_pose[2], at, axis=1)[:, 0]
        own_zone = np.take_along_axis(zones, at, axis=1)[:, 0]
        # No pose that counts is impossible at all headings.
        every = (heading == ALL_HEADINGS) | np.isnan(level_at_heading)
        level = np.where(every, np.nanmean(of_pose[2], axis=1), level_at_heading)
        return np.where(every, classify_over_headings(zones), own_zone), level

    def _compared(self, around: Neighbourhoods, data: Floats32) -> Floats:
        radii = relative_radii(around.sums(data, self.setting.table, self.setting.model))
        return np.stack([radii[name] for name in ("major", "minor", "level")])

    def _see_walls(self, walls: AddedWalls) -> Bools:
        """Return which poses see new walls in front of what they see now, shape (N,)."""
        setting, rays = self.setting, self.rays
        near = np.zeros(len(self.x), dtype=np.bool_)
        for x, y, radius in walls.circle:
            near |= np.hypot(self.x - x, self.y - y) <= self._sight + radius
        rows = np.flatnonzero(near)
        beam = np.repeat(np.arange(setting.scanner.beams), np.diff(rays.start))
        bias = setting.table.bias.min(axis=1)
        seen = np.zeros(len(rows), dtype=np.bool_)
        up = np.column_stack([rays.height + self.environment.floor, rays.elevation])
        for h, theta in enumerate(setting.headings):
            c, s = np.cos(theta), np.sin(theta)
            origin = rays.origin @ np.array([[c, s], [-s, c]])
            far = self.data[h, rows, 0, : setting.table.beams] - bias
            seen |= walls.seen_by(
                self.x[rows], self.y[rows], np.column_stack([rays.angle + theta, origin, up]),
                beam, far.astype(np.float64),
            )  # fmt: skip
        near[rows] = seen
        return near

    def _have_neighbour(self, mask: Bools) -> Bools:
        """Return which poses have a given pose within their neighbourhood radius, shape (N,)."""
        rows, columns = self.lattice.rows_columns[mask].T
        grid = np.zeros_like(self.lattice.free)
        for row, column in disc(self.setting.model.radius, self.setting.spacing):
            r, c = rows + row, columns + column
            inside = (r >= 0) & (c >= 0) & (r < grid.shape[0]) & (c < grid.shape[1])
            grid[r[inside], c[inside]] = True
        return grid[self.lattice.free]

    def _have_room(self, obstacles: Sequence[Obstacle]) -> Bools:
        """Return where obstacles leave room for the robot and its sensors, shape (N, H)."""
        room = np.ones_like(self.possible)
        scanner, in_space = self.setting.scanner, self.environment.space is not None
        mounts = np.unique(np.column_stack([scanner.mounts[:, :2], scanner.upright[:, 0]]), axis=0)
        body = max(self.setting.model.robot_radius, TOUCHING)
        reach = max(body, float(np.hypot(*mounts[:, :2].T).max())) + TOUCHING
        for obstacle in obstacles:
            shape, top = obstacle.outline, obstacle.top
            rows = _within(self.x, self.y, shape, reach)
            centre = np.column_stack([self.x[rows], self.y[rows]])
            clear = shapely.distance(shapely.points(centre), shape) >= body
            for h, theta in enumerate(self.setting.headings):
                room[rows, h] &= clear
                c, s = np.cos(theta), np.sin(theta)
                for mx, my, height in mounts.tolist():
                    if in_space and not obstacle.bottom <= height <= (top or np.inf):
                        continue
                    sensor = centre + np.array([c * mx - s * my, s * mx + c * my])
                    arm = shapely.linestrings(np.stack([centre, sensor], axis=1))
                    room[rows, h] &= shapely.distance(arm, shape) > TOUCHING
        return room

    def _cut_links(self, around: Neighbourhoods, obstacles: Sequence[Obstacle]) -> Neighbourhoods:
        """Return the neighbourhoods without links between neighbours that an obstacle separates."""
        shape = shapely.unary_union([obstacle.outline for obstacle in obstacles])
        x, y = around.lattice.points
        spacing = self.setting.spacing
        rows = _within(x, y, shape, 1.5 * spacing)
        links = around.links.copy()
        here = np.column_stack([x[rows], y[rows]])
        for k, step in enumerate(STEPS):
            lines = shapely.linestrings(np.stack([here, here + spacing * step], axis=1))
            parted = rows[shapely.intersects(lines, shape)]
            links[:, parted] &= np.uint8(255 - (1 << k))
        return replace(around, links=links)


def _within(x: Floats, y: Floats, shape: BaseGeometry, distance: float) -> Rows:
    """Return the points within a distance of a shape, metres, ascending."""
    # Creating shapes is slow, so only points in the bounds are converted.
    parts = shapely.get_parts(shape)
    near = np.zeros(len(x), dtype=np.bool_)
    for left, low, right, high in shapely.bounds(parts) + (distance + 1e-9) * np.array(
        [-1, -1, 1, 1]
    ):
        near |= (left <= x) & (x <= right) & (low <= y) & (y <= high)
    rows = np.flatnonzero(near)
    close: Rows = rows[shapely.dwithin(shapely.points(x[rows], y[rows]), shape, distance)]
    return close
