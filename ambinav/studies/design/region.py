"""The floor that a design is judged on: a whole map, a polygon of it, or a route through it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from ambinav.buildings.drawn_items import load_region
from ambinav.config import check_kind
from ambinav.geometry.collision.reach import Reach
from ambinav.geometry.lattice import Lattice
from ambinav.geometry.morton import morton
from ambinav.routes.route import Route
from ambinav.runtime.array_types import Bools, Floats, Ints
from ambinav.runtime.errors import InputError

ALL_HEADINGS: Final = -1
"""Stands for every heading in `Places.heading`."""

ROUTE_STEP: Final = 0.25
"""A route is looked at in steps of at most this share of the lattice's spacing."""
OFF_LATTICE: Final = 2.0
"""Largest distance of a pose of a route to the lattice point that represents it, in spacings."""

Kind = Literal["map", "polygon", "route"]
Unit = Literal["m2", "m"]
UNITS: Final[dict[Kind, Unit]] = {"map": "m2", "polygon": "m2", "route": "m"}


@dataclass(frozen=True, eq=False)
class Places:
    """Lattice points at headings, with weights.

    Attributes:
        point: Running numbers of the lattice's free points, int64, ascending, shape (K,).
        heading: Index of the heading at each, int64, shape (K,); `ALL_HEADINGS` where every
            heading counts alike.
        weight: Floor (square metres) or travel (metres) that each represents, float64, (K,).
        of: Number of all places if these are a sample; otherwise K.
    """

    point: Ints
    heading: Ints
    weight: Floats
    of: int

    @classmethod
    def at_all_headings(cls, point: Ints, weight: Floats) -> Places:
        """Return points at which every heading counts alike."""
        return cls(point, np.full(len(point), ALL_HEADINGS), weight, len(point))

    @classmethod
    def merged(cls, point: Ints, heading: Ints, weight: Floats) -> Places:
        """Return points at headings, each pair once with the sum of its weights."""
        pairs = np.column_stack([point, heading])
        distinct, which = np.unique(pairs, axis=0, return_inverse=True)
        total = np.zeros(len(distinct))
        np.add.at(total, which.ravel(), weight)
        points, headings = distinct.astype(np.int64).T
        return cls(points, headings, total, len(distinct))

    def __len__(self) -> int:
        """Return the number of places K."""
        return len(self.point)

    @property
    def is_sample(self) -> bool:
        """True if the places are a sample of more places."""
        return len(self) < self.of

    def among(self, mask: Bools) -> Places:
        """Return the places in the mask, shape (K,), with their weights."""
        return replace(
            self, point=self.point[mask], heading=self.heading[mask], weight=self.weight[mask]
        )

    def sampled(self, lattice: Lattice, count: int, rng: np.random.Generator) -> Places:
        """Return at most `count` places, spread evenly over the floor, that represent all.

        A systematic sample from a random start, along a curve that keeps neighbours together
        (Morton's), each place as likely as its weight: all places drawn weigh alike.

        Args:
            lattice: Lattice of the points.
            count: Number of places; from K on, all of them are returned unchanged.
            rng: The source of randomness.
        """
        if count >= len(self):
            return self
        order = np.argsort(morton(lattice.rows_columns[self.point]), kind="stable")
        total = float(self.weight.sum())
        marks = (rng.random() + np.arange(count)) * (total / count)
        drawn = np.searchsorted(np.cumsum(self.weight[order]), marks, side="right")
        chosen, times = np.unique(order[np.minimum(drawn, len(order) - 1)], return_counts=True)
        weight = times.astype(np.float64) * (total / count)
        return Places(self.point[chosen], self.heading[chosen], weight, self.of)


@dataclass(frozen=True, eq=False)
class Region:
    """The floor on which a design is judged.

    Make one with `of_map`, `of_polygon`, `of_file` or `of_route`.

    Attributes:
        title: Name in reports.
        kind: The name "map", "polygon" or "route".
        shape: The polygon; None for the other kinds.
        route: The route; None for the other kinds.
    """

    title: str
    kind: Kind
    shape: BaseGeometry | None = None
    route: Route | None = None

    @classmethod
    def of_map(cls) -> Region:
        """Return all floor where the robot can be."""
        return cls("the whole map", "map")

    @classmethod
    def of_polygon(cls, shape: BaseGeometry, title: str = "a polygon") -> Region:
        """Return the floor within one or several polygons.

        Args:
            shape: Polygon or MultiPolygon, map frame, metres.
            title: Name in reports.

        Raises:
            InputError: it has no area, or its coordinates are not finite.
        """
        if not np.isfinite(shapely.get_coordinates(shape)).all():
            raise InputError(f"region {title}: its coordinates are not finite; give metres.")
        if not shape.is_valid:
            shape = shapely.make_valid(shape)
        if not shape.area > 0.0:
            raise InputError(
                f"region {title}: a {shape.geom_type} without area holds no floor; give a polygon."
            )
        return cls(title, "polygon", shape=shape)

    @classmethod
    def of_file(cls, path: str | Path) -> Region:
        """Return the floor within the polygons of a GeoJSON or WKT file, map frame, metres.

        Raises:
            InputError: the file cannot be read, or holds anything but polygons.
        """
        return cls.of_polygon(load_region(path), str(path))

    @classmethod
    def of_route(cls, route: Route, title: str = "a route") -> Region:
        """Return the floor under a route, at the headings along the route.

        Raises:
            InputError: it covers no distance.
        """
        check_kind(route, Route, "route")
        if not route.steering.lengths(route.poses[:-1], route.poses[1:]).sum() > 0.0:
            raise InputError(f"region {title}: the route covers no distance; give a longer one.")
        return cls(title, "route", route=route)

    @property
    def unit(self) -> Unit:
        """Unit of the weights of places: square metres, or metres of a route."""
        return UNITS[self.kind]

    def places(self, lattice: Lattice, headings: Floats, reach: Reach | None = None) -> Places:
        """Return the region's places on a lattice.

        Args:
            lattice: Free points where the robot can stand, as `standing_lattice` gives them.
            headings: Headings of the map, shape (H,), radians.
            reach: Floor that the robot reaches; None: all floor counts. All of a route counts.

        Returns:
            For a map or a polygon: every free, reachable point at all headings, weighted by its
                area. For a route: the nearest free point and heading of each pose, weighted by the
                metres travelled there.

        Raises:
            InputError: no point of the lattice lies in it, the robot reaches none of them, or the
                route leaves the floor.
        """
        if self.route is not None:
            return self._along(self.route, lattice, headings)
        x, y = lattice.points
        inside = np.ones(len(x), dtype=np.bool_)
        if self.shape is not None:
            inside = np.asarray(shapely.intersects_xy(self.shape, x, y), dtype=np.bool_)
        point = np.flatnonzero(inside)
        if not len(point):
            raise InputError(
                f"region {self.title}: the robot can be at no point of it in "
                f"{lattice.environment.name} (spacing {lattice.spacing:g} m); draw it over free "
                "floor, in metres of the map frame."
            )
        if reach is not None:
            point = point[reach.reaches(x[point], y[point])]
            if not len(point):
                raise InputError(
                    f"region {self.title}: a robot of radius {reach.radius:g} m reaches no point "
                    f"of it in {lattice.environment.name}; give a smaller --robot-radius, or "
                    "another region."
                )
        return Places.at_all_headings(point, np.full(len(point), lattice.spacing**2))

    def _along(self, route: Route, lattice: Lattice, headings: Floats) -> Places:
        poses, _, along = route.steering.dense(route.poses, ROUTE_STEP * lattice.spacing)
        # Half of the distance to either neighbour.
        metres = np.diff(along, append=along[-1], prepend=along[0])
        metres = (metres[:-1] + metres[1:]) / 2.0
        moving = metres > 0.0
        poses, metres = poses[moving], metres[moving]
        away, nearest = cKDTree(np.column_stack(lattice.points)).query(poses[:, :2])
        lost = away > OFF_LATTICE * lattice.spacing
        if lost.any():
            x, y, _ = poses[int(np.argmax(lost))]
            raise InputError(
                f"region {self.title}: {metres[lost].sum():.2f} m of the route are where the robot "
                f"cannot be in {lattice.environment.name}, first at ({x:.2f}, {y:.2f}); give a "
                "route through free floor."
            )
        apart = np.abs(np.angle(np.exp(1j * (poses[:, 2:] - headings))))
        return Places.merged(nearest, apart.argmin(axis=1), metres)
