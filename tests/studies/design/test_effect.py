"""What obstacles change of a map is what a build of the changed building gives."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.obstacle import Obstacle
from ambinav.sensing.intensity import Intensity
from ambinav.studies.design.place.effect import Effects
from ambinav.studies.design.place.map_setting import MapSetting
from ambinav.studies.design.region import Region

SPACING = 0.2
TOLERANCE = 1e-5
"""Of a level, where a robot can stand in both."""


def corridor() -> an.Environment:
    """Twelve metres by two, with a room at one end."""
    return environment_from_shapes([shapely.box(0, 0, 12, 2), shapely.box(12, -2, 15, 4)])


def laser(aperture: float = 2 * math.pi, mount: tuple[float, float, float] = (0.0, 0.0, 0.0)):
    sensor = an.RangeSensor(max_range=3.0, std=0.03, resolution=0.001)
    return an.RangeScanner.planar(sensor, 48, aperture, mount)


SCANNERS = {
    "laser": laser(),
    "fan off the centre": laser(math.pi, (0.12, 0.03, 0.0)),
    "sonars": an.RangeScanner.from_preset("polaroid-6500-ring"),
    "intensities": laser().with_intensity(Intensity(wall=100.0, reflector=400.0, std=60.0)),
}
OBSTACLES = {
    "post": [Obstacle.post(5.03, 1.02, 0.1)],
    "post at a wall": [Obstacle.post(6.03, 0.08, 0.1)],
    "panel": [Obstacle.panel(4.03, -0.02, 4.05, 0.61, 0.04)],
    "line": [Obstacle.panel(7.03, 0.52, 7.41, 0.93)],
    "three": [
        Obstacle.post(3.03, 1.02, 0.15),
        Obstacle.post(7.03, 1.93, 0.1),
        Obstacle.panel(9.03, 0.72, 9.47, 1.13, 0.04),
    ],
}


def effects(env: an.Environment, scanner: an.RangeScanner, reflect: bool) -> Effects:
    amap = an.build_map(env, scanner, SPACING, store=False)
    setting = MapSetting.of(amap, scanner, reflect)
    lattice, _ = setting.lattice(env)
    return Effects(env, setting, Region.of_map().places(lattice, setting.headings))


@pytest.mark.parametrize("name", SCANNERS)
@pytest.mark.parametrize(
    "what",
    [
        "three",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("line", "post at a wall")),
        *(pytest.param(name, marks=pytest.mark.sweep) for name in ("post", "panel")),
    ],
)
def test_effects_are_those_of_the_changed_building(name: str, what: str) -> None:
    scanner, reflect = SCANNERS[name], name == "intensities"
    env = corridor()
    added = [Obstacle(one.outline, reflect) for one in OBSTACLES[what]]
    now = effects(env, scanner, reflect)
    for one in added:
        now.put(now.tried([one]))
    built = an.build_map(env.edited(add=added), scanner, SPACING, store=False)
    free = now.lattice.free
    expected = built.dataset["level"].values[free].reshape(len(now.x), -1)
    found = now.radii[2]
    known = np.isfinite(expected) & now.possible
    assert (np.isfinite(expected) == now.possible).all()
    assert known.sum() > 0.9 * known.size
    np.testing.assert_allclose(found[known], expected[known], atol=TOLERANCE)
    # It is a change that this test would not see if nothing were computed again.
    assert np.nanmax(np.abs(found - effects(env, scanner, reflect).radii[2])) > 0.01


def test_effects_are_those_of_an_updated_map() -> None:
    env, scanner = corridor(), SCANNERS["laser"]
    now = effects(env, scanner, False)
    now.put(now.tried(OBSTACLES["three"]))
    amap = an.build_map(env, scanner, SPACING, store=False)
    updated = amap.update(env.edited(add=OBSTACLES["three"]))
    expected = updated.dataset["level"].values[now.lattice.free]
    known = np.isfinite(expected)
    np.testing.assert_allclose(now.radii[2, known, 0], expected[known], atol=TOLERANCE)


IN_SPACE = {
    "level": (laser().raised(0.5), False),
    "fan off the centre": (laser(math.pi, (0.12, 0.03, 0.003)).raised(0.5), False),
    "layers": (
        an.RangeScanner.layered(
            an.RangeSensor(max_range=3.0, std=0.03, resolution=0.001), 24, [-0.3, 0.0, 0.2], z=0.5
        ),
        False,
    ),
    "intensities": (
        laser(2 * math.pi, (0.0, 0.0, 0.003))
        .with_intensity(Intensity(wall=100.0, reflector=400.0, std=60.0))
        .raised(0.5),
        True,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", IN_SPACE)
def test_effects_in_space_are_those_of_the_changed_building(name: str) -> None:
    """Low, high and hanging obstacles, and tags, each of which only some rays meet."""
    scanner, reflect = IN_SPACE[name]
    env = corridor().in_space(an.extruded(corridor(), 2.5))
    added = [
        Obstacle.post(3.03, 1.02, 0.15, reflective=reflect).between(0.0, 0.4),
        Obstacle.post(7.03, 1.93, 0.1, reflective=reflect).between(0.0, 1.1),
        Obstacle.panel(9.03, 0.72, 9.47, 1.13, 0.04, reflective=reflect).between(0.45, None),
        Obstacle.panel(5.03, 0.52, 5.41, 0.93, reflective=reflect).between(0.2, 0.8),
    ]
    if reflect:
        added.append(Obstacle.wall([(1.0, 2.0), (1.6, 2.0)], reflective=True).between(0.3, 0.7))
    now = effects(env, scanner, reflect)
    for obstacle in added:
        now.put(now.tried([obstacle]))
    built = an.build_map(env.edited(add=added), scanner, SPACING, store=False)
    expected = built.dataset["level"].values[now.lattice.free].reshape(len(now.x), -1)
    known = np.isfinite(expected) & now.possible
    assert (np.isfinite(expected) == now.possible).all()
    np.testing.assert_allclose(now.radii[2][known], expected[known], atol=TOLERANCE)
    assert np.nanmax(np.abs(now.radii[2] - effects(env, scanner, reflect).radii[2])) > 0.01


def test_one_after_the_other_is_all_at_once() -> None:
    env, scanner = corridor(), SCANNERS["laser"]
    single, joint = effects(env, scanner, False), effects(env, scanner, False)
    before = single.badness
    parts = []
    for one in OBSTACLES["three"]:
        change = single.tried([one])
        parts.append(change.gain.bad)
        single.put(change)
    whole = joint.tried(OBSTACLES["three"])
    joint.put(whole)
    assert joint.badness.bad == pytest.approx(single.badness.bad, abs=2 * SPACING**2)
    assert whole.gain.bad == pytest.approx((before - joint.badness).bad)
    assert sum(parts) == pytest.approx((before - single.badness).bad)


def test_what_is_tried_changes_nothing() -> None:
    now = effects(corridor(), SCANNERS["laser"], False)
    before = now.badness, now.radii.copy(), now.data.copy(), now.possible.copy()
    first = now.tried(OBSTACLES["three"]).gain
    assert now.badness == before[0]
    for kept, held in zip(before[1:], (now.radii, now.data, now.possible), strict=True):
        np.testing.assert_array_equal(kept, held)
    copied = now.copy()
    copied.put(copied.tried(OBSTACLES["post"]))
    assert now.tried(OBSTACLES["three"]).gain == first


def test_an_obstacle_that_nobody_sees_changes_nothing() -> None:
    """The room is beyond the range of all floor that counts."""
    env, scanner = corridor(), SCANNERS["laser"]
    amap = an.build_map(env, scanner, SPACING, store=False)
    setting = MapSetting.of(amap, scanner)
    lattice, _ = setting.lattice(env)
    places = Region.of_polygon(shapely.box(0, 0, 3, 2)).places(lattice, setting.headings)
    change = Effects(env, setting, places).tried([Obstacle.post(14.0, 3.0, 0.2)])
    assert not len(change.rows)
    assert change.gain.cost == 0.0


def test_a_route_counts_the_metres_at_its_headings() -> None:
    from tests.drive.cases import route_through

    env, scanner = corridor(), SCANNERS["fan off the centre"]
    amap = an.build_map(env, scanner, SPACING, store=False)
    setting = MapSetting.of(amap, scanner)
    lattice, _ = setting.lattice(env)
    region = Region.of_route(route_through([(4.0, 1.0), (9.0, 1.0)]))
    now = Effects(env, setting, region.places(lattice, setting.headings))
    zone = amap.dataset["zone"].values[lattice.free]
    places = region.places(lattice, setting.headings)
    bad = np.isin(zone[places.point, places.heading], (2, 3))
    assert now.badness.bad == pytest.approx(places.weight[bad].sum())
    assert now.badness.bad <= 5.0


def test_covered_floor_stays_as_it_was() -> None:
    """Bad floor is not made good by putting something on it."""
    env, scanner = corridor(), SCANNERS["laser"]
    now = effects(env, scanner, False)
    box = Obstacle(shapely.box(4.0, 0.5, 7.0, 1.5))
    covered = shapely.contains_xy(box.outline, now.x, now.y)
    bad = now.bad.copy()
    assert bad[covered].any()
    now.put(now.tried([box]))
    np.testing.assert_array_equal(now.bad[covered], bad[covered])
    assert not now.possible[covered].any()
