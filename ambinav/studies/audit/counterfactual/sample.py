"""Samples of the judged floor, bad and other, on which alternative scanners are evaluated.

What is computed at a place is what `build_map` computes there. Places that are bad now are looked
at apart from the others, so that a tenth of little bad floor is still seen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ambinav.ambiguity.model import AmbiguityModel
from ambinav.ambiguity.neighbourhoods import points_near
from ambinav.ambiguity.panorama import view_radii
from ambinav.ambiguity.tensor import classify, classify_over_headings
from ambinav.drive.bootstrap import Interval, share
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import BAD, LOCALIZABLE, NOT_FREE, TRANSITION
from ambinav.runtime.array_types import Bools, Bytes, Floats, Ints, Ints32
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.design.improved import MOST, ImprovedPart, connected
from ambinav.studies.design.place.map_setting import MapSetting
from ambinav.studies.design.region import Places
from ambinav.studies.design.views import mask_of, scanner_views

HEADINGS: Final = 8
"""Headings of scanners that do not look all around, where the map has none."""


@dataclass(frozen=True, eq=False)
class FloorSample:
    """Sampled positions that represent all judged floor.

    Attributes:
        environment: The building.
        lattice: N free points, those of the map.
        model: The parameters of the map.
        headings: Headings of the robot, radians, shape (H,).
        floor: Running numbers of all judged points, shape (J,).
        was_bad: Mask of those that are bad in the map, shape (J,).
        place: Bad place that each belongs to, shape (J,); 0: none.
        cell_area: Area of a point, square metres.
    """

    environment: Environment
    lattice: Lattice
    model: AmbiguityModel
    headings: Floats
    floor: Ints
    was_bad: Bools
    place: Ints32
    cell_area: float

    @classmethod
    def of(cls, amap: AmbiguityMap, environment: Environment, scanner: RangeScanner) -> FloorSample:
        """Sample the judged floor of a map that `build_map` made of a building for a scanner."""
        setting = MapSetting.of(amap, scanner)
        lattice, _ = setting.lattice(environment)
        counted = amap.judged.counted
        bad = counted & np.isin(amap.floor("zone").values, BAD)
        place = connected(amap, bad, amap.judged)
        floor = np.flatnonzero(counted[lattice.free])
        headings = setting.headings
        if not amap.has_theta:
            headings = 2.0 * math.pi * np.arange(HEADINGS) / HEADINGS
        return cls(
            environment, lattice, setting.model, headings, floor, bad[lattice.free][floor],
            place[lattice.free][floor], amap.cell_area,
        )  # fmt: skip

    @property
    def bad_area(self) -> float:
        """Bad floor of the map, square metres."""
        return float(self.was_bad.sum()) * self.cell_area

    def drawn(self, bad: int, others: int, rng: np.random.Generator) -> tuple[Ints, Ints]:
        """Return indices of bad and of other positions, evenly spread and ascending."""
        samples = []
        for points, count in ((self.floor[self.was_bad], bad), (self.floor[~self.was_bad], others)):
            places = Places.at_all_headings(points, np.ones(len(points)))
            samples.append(np.sort(places.sampled(self.lattice, count, rng).point))
        return samples[0], samples[1]

    def zones(self, scanners: Sequence[RangeScanner], point: Ints) -> Bytes:
        """Compute zone codes of points for several scanners, shape (S, K), as their maps have them.

        Over all headings; not free where a scanner's sensors have no room at any.
        """
        near = points_near(
            self.lattice, mask_of(point, len(self.lattice.rows_columns)), self.model.radius
        )
        lattice = self.lattice.among(near)
        inner = np.searchsorted(np.flatnonzero(near), point)
        views, possible = scanner_views(lattice, scanners, None, self.headings)
        shape = len(scanners), len(point), len(self.headings)
        zones = np.full(shape, NOT_FREE, dtype=np.uint8)
        pieces = view_radii(lattice, possible, inner, [entry.view for entry in views], self.model)
        for numbers, at, major, minor in pieces:
            zone = classify(major, minor, self.model.low, self.model.high)
            for i in numbers:
                zones[views[i].scanner][np.ix_(at, views[i].headings)] = zone[:, None]
        return classify_over_headings(zones)

    def improved(self, point: Ints, zone: Bytes) -> tuple[ImprovedPart, ...]:
        """Estimate the floor that becomes good in each bad place; return the largest gains first.

        Args:
            point: A sample of bad points, as `drawn` gives it.
            zone: Zone codes at these, with a change.
        """
        good = np.isin(zone, (LOCALIZABLE, TRANSITION))
        place = self.place[np.searchsorted(self.floor, point)]
        count = np.bincount(place[good])
        count[:1] = 0
        x, y = self.lattice.points
        places = []
        for number in np.argsort(-count, kind="stable")[:MOST].tolist():
            if count[number]:
                at = point[good & (place == number)]
                off = np.hypot(x[at] - x[at].mean(), y[at] - y[at].mean())
                middle = at[int(off.argmin())]
                area = count[number] / len(point) * self.bad_area
                places.append(ImprovedPart(x_m=x[middle], y_m=y[middle], area_m2=area))
        return tuple(places)

    def area_in(self, codes: Sequence[int], of_bad: Bytes, of_others: Bytes) -> Interval:
        """Estimate the judged floor in some zones, square metres, with a 95 % interval.

        The two samples' intervals are Wilson's, squared and added (Newcombe 1998, "Interval
        estimation for the difference between independent proportions", method 10; of a sum).

        Args:
            codes: Codes of the zones.
            of_bad: Zone codes at the sample of bad places, shape (K,).
            of_others: At that of the others.
        """
        value = below = above = 0.0
        bad = int(self.was_bad.sum())
        for zone, size in ((of_bad, bad), (of_others, len(self.floor) - bad)):
            if not size:
                continue
            estimate, area = share(np.isin(zone, codes)), size * self.cell_area
            value += area * estimate.value
            if len(zone) < size:
                below += (area * (estimate.value - estimate.low)) ** 2
                above += (area * (estimate.high - estimate.value)) ** 2
        low, high = max(value - math.sqrt(below), 0.0), value + math.sqrt(above)
        return Interval(value, low, high, len(of_bad) + len(of_others))
