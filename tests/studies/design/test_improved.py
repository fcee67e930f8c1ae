"""Places where a change improves most floor, on maps whose zones are set."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.maps.zones import LOCALIZABLE, OPEN
from ambinav.studies.design.improved import most_improved


@pytest.fixture(scope="module")
def corridor() -> an.AmbiguityMap:
    sensor = an.RangeSensor(max_range=3.0, std=0.02, resolution=0.01)
    scanner = an.RangeScanner.planar(sensor=sensor, beams=36, aperture=math.tau)
    environment = an.environment_from_shapes([shapely.box(0, 0, 12, 2)])
    return an.build_map(environment, scanner, spacing=0.25)


def zoned(amap: an.AmbiguityMap, boxes: list[tuple[float, float, float, float]]) -> an.AmbiguityMap:
    """The map with zone open in the boxes (x0, y0, x1, y1), else localizable."""
    data = amap.dataset.copy()
    zone = np.where(np.isin(data["zone"].values, (255,)), 255, LOCALIZABLE).astype(np.uint8)
    x, y = data["x"].values[None, :], data["y"].values[:, None]
    for x0, y0, x1, y1 in boxes:
        zone[(x > x0) & (x < x1) & (y > y0) & (y < y1)] = OPEN
    data["zone"] = (data["zone"].dims, zone)
    return an.AmbiguityMap(data)


def test_places_come_by_their_area(corridor: an.AmbiguityMap) -> None:
    x0, y0, x1, _ = corridor.bounds
    third, height = (x1 - x0) / 3, 10.0
    left = (x0, y0, x0 + 0.6 * third, y0 + height)
    middle = (x0 + 1.2 * third, y0, x0 + 1.9 * third, y0 + height)
    right = (x0 + 2.5 * third, y0, x1, y0 + height)
    before = zoned(corridor, [left, middle, right])
    after = zoned(corridor, [right])
    found = most_improved(before, after)
    assert len(found) == 2
    assert most_improved(before, before) == () and most_improved(after, before) == ()
    counted, x = before.judged.counted, before.dataset["x"].values
    for place, box in zip(found, (middle, left), strict=True):
        inside = counted[:, (x > box[0]) & (x < box[2])].sum() * before.spacing**2
        assert place.area_m2 == pytest.approx(inside, abs=0.01)
        assert box[0] < place.x_m < box[2]
