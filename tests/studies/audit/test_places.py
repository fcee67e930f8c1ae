"""The worst places of a map whose regions are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import ndimage

from ambinav.geometry.collision.reach import reach_of
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.regions import _renumber, _spread, find_regions, passable
from ambinav.maps.zones import CORRIDOR, OPEN
from ambinav.studies.audit.ambiguous_regions import _zero_for_nan, find_ambiguous_regions
from tests.maps import synthetic


def grid(picture: str) -> np.ndarray:
    """Zone codes drawn as text, top row last: c corridor, o open, . localizable, # wall."""
    code = {"c": CORRIDOR, "o": OPEN, ".": 0, "#": 255}
    rows = [[code[letter] for letter in line.strip()] for line in picture.strip().splitlines()]
    return np.array(rows[::-1], dtype=np.uint8)


def regions(picture: str, direction: float | np.ndarray = 0.0, gap: int = 2, least: int = 3):
    zone = grid(picture)
    axis = np.where(zone == CORRIDOR, direction, np.nan)
    return find_regions(zone, (CORRIDOR, OPEN), axis, zone != 255, gap=gap, least=least)[::-1]


def test_zones_are_regions_of_their_own():
    found = regions(
        """
        cccc#ooo
        cccc#ooo
        """
    )
    assert found.max() == 2
    assert (found[:, :4] == found[0, 0]).all()
    assert (found[:, 5:] == found[0, 7]).all()
    assert (found[:, 4] == 0).all()


def test_pieces_across_a_small_gap_are_one():
    assert regions("cccc..cccc").max() == 1
    assert regions("cccc...cccc").max() == 2
    assert regions("cccc##cccc").max() == 2


def test_the_gap_itself_does_not_belong_to_the_region():
    assert (regions("cccc..cccc") == [[1, 1, 1, 1, 0, 0, 1, 1, 1, 1]]).all()


def test_corridors_that_run_differently_stay_apart():
    turned = np.array([[0.0] * 5 + [math.pi / 2] * 5])
    assert regions("cccccccccc", turned).max() == 1  # one piece, whatever its direction
    assert regions("cccc..cccc", turned).max() == 2
    almost = np.array([[math.radians(178)] * 5 + [math.radians(2)] * 5])
    assert regions("cccc..cccc", almost).max() == 1


def test_small_regions_join_a_larger_neighbour_or_vanish():
    assert (regions("ccccoo") == 1).all()
    assert regions("cccc...oo").max() == 1
    assert (regions("cccc...oo")[0, 7:] == 0).all()
    assert regions("oo").max() == 0
    assert regions("....").max() == 0


def test_a_wall_without_thickness_parts_regions():
    # Both rows are free; the wall runs between them, so clearance is half a cell there.
    zone = np.full((6, 8), CORRIDOR, dtype=np.uint8)
    clearance = np.repeat([[0.25], [0.15], [0.05], [0.05], [0.15], [0.25]], 8, axis=1)
    connected = passable(np.ones_like(zone, dtype=bool), clearance, 0.1)
    found = find_regions(zone, (CORRIDOR,), np.zeros(zone.shape), connected, gap=4, least=1)
    assert found.max() == 2
    # The cells at the wall belong to their own side.
    assert (found[:3] == found[0, 0]).all()
    assert (found[3:] == found[5, 0]).all()


@pytest.mark.parametrize("headings", [0, 8])
def test_places_of_the_known_building(headings):
    places = find_ambiguous_regions(synthetic.for_a_point(synthetic.dataset(headings)))
    assert [place.number for place in places] == [1, 2, 3, 4, 5, 6]
    assert [place.severity for place in places] == sorted(
        (place.severity for place in places), reverse=True
    )
    hall, corridor, *rims = places
    assert (hall.zone, hall.direction) == ("open", None)
    assert (hall.length, hall.width, hall.area) == pytest.approx((6.0, 6.0, 36.0))
    assert (hall.x, hall.y) == pytest.approx((21.0, 5.0), abs=0.1)
    assert corridor.zone == "corridor"
    assert corridor.direction == pytest.approx(0.0, abs=1e-6)
    assert (corridor.length, corridor.width, corridor.area) == pytest.approx((11.0, 2.0, 22.0))
    assert (corridor.x, corridor.y) == pytest.approx((10.0, 2.0), abs=0.1)
    assert corridor.outline == pytest.approx((4.5, 1.0, 15.5, 3.0))
    assert {round(rim.direction or 0.0, 3) for rim in rims} == {0.0, round(math.pi / 2, 3)}
    for rim in rims:
        assert rim.area == pytest.approx(12.0)
    assert hall.level == pytest.approx(0.925 if headings == 0 else 0.925 * 0.75, abs=1e-4)
    if headings:
        assert hall.best_heading == pytest.approx(0.0)
        assert hall.worst_heading == pytest.approx(math.pi)
    else:
        assert hall.best_heading is None


def test_the_representative_point_is_a_worst_one_inside_the_region():
    dataset = synthetic.dataset()
    bad = (dataset["x"] > 12.0) & (dataset["x"] < 13.5) & (dataset["zone"] == CORRIDOR)
    dataset["level"] = dataset["level"].where(~bad, 0.6).astype(np.float32)
    place = find_ambiguous_regions(AmbiguityMap(dataset))[1]
    assert 12.0 < place.x < 13.5
    assert place.y == pytest.approx(2.0, abs=0.1)


def test_an_l_shaped_region_is_marked_inside():
    dataset = synthetic.dataset()
    # Everything open in the room but its upper right quarter.
    room = (dataset["x"] < 4) & dataset["free"]
    ell = room & ~((dataset["x"] > 1) & (dataset["y"] > 1))
    dataset["zone"] = dataset["zone"].where(~ell, OPEN).astype(np.uint8)
    dataset["level"] = dataset["level"].where(~ell, 1.0).astype(np.float32)
    amap = synthetic.for_a_point(dataset)
    place = next(p for p in find_ambiguous_regions(amap) if p.x < 4)
    assert amap.sample("zone", place.x, place.y) == OPEN
    assert place.area == pytest.approx(4 + 3)


def test_count_limits_and_a_harmless_map_has_none():
    amap = AmbiguityMap(synthetic.dataset())
    assert len(find_ambiguous_regions(amap, 2)) == 2
    assert find_ambiguous_regions(amap, 0) == ()
    dataset = synthetic.dataset()
    dataset["zone"] = dataset["zone"].where(~dataset["free"], 0).astype(np.uint8)
    assert find_ambiguous_regions(AmbiguityMap(dataset)) == ()


def test_floor_that_no_robot_stands_on_is_no_place():
    amap = AmbiguityMap(synthetic.dataset())
    corridor = find_ambiguous_regions(amap)[1]
    # A robot of 0.2 m leaves as much of the corridor's 2 m on either side.
    assert (corridor.length, corridor.width) == pytest.approx((11.0, 1.6))
    # A robot that does not get into the corridor sets out in the hall.
    wide = amap.for_robot(reach_of(amap.environment, 1.1))
    assert {place.zone for place in find_ambiguous_regions(wide)} == {"open", "corridor"}
    assert all(place.x > 17.0 for place in find_ambiguous_regions(wide))


def test_spreading_is_a_dilation_within_the_mask():
    rng = np.random.default_rng(0)
    cross = ndimage.generate_binary_structure(2, 1)
    for _ in range(50):
        shape = rng.integers(1, 14, 2)
        labels = (rng.integers(1, 9, shape) * (rng.random(shape) < 0.1)).astype(np.int32)
        mask, wanted = rng.random(shape) < 0.7, labels
        steps = int(rng.integers(0, 5))
        for _ in range(steps):
            grown = ndimage.grey_dilation(wanted, footprint=cross)
            wanted = np.where((wanted == 0) & mask, grown, wanted)
        np.testing.assert_array_equal(_spread(labels, mask, steps), wanted)
        dense = np.unique(np.append(labels, 0), return_inverse=True)[1][:-1].reshape(shape)
        np.testing.assert_array_equal(_renumber(labels), dense)


def test_numbers_are_those_of_nan_to_num():
    values = np.array([0.1, math.nan, -2.0], dtype=np.float32)
    for one in (values, np.append(values, np.float32([math.inf, -math.inf]))):
        np.testing.assert_array_equal(_zero_for_nan(one), np.nan_to_num(one.astype(np.float64)))


def regions_of_all_cells(zone, codes, direction, passable, *, gap, least, rim=2):
    """`find_regions` as its contract says it, with all cells looked at in each step."""
    labels, owner = np.zeros(zone.shape, dtype=np.int32), [0]
    for code in codes:
        found, count = ndimage.label((zone == code) & passable)
        labels = np.where(found > 0, found + len(owner) - 1, labels).astype(np.int32)
        owner += [code] * count
    reach = spread_over_all_cells(labels, passable, (gap + 1) // 2)
    axis = [
        np.exp(2j * direction[(labels == i) & np.isfinite(direction)]).sum()
        for i in range(len(owner))
    ]
    chief = list(range(len(owner)))
    for a, b in touching(reach):
        turned = abs(np.angle(axis[a] * np.conj(axis[b]))) / 2.0
        if owner[a] == owner[b] and turned < math.radians(20.0):
            chief = [chief[a] if one == chief[b] else one for one in chief]
    labels, reach = np.array(chief)[labels], np.array(chief)[reach]
    size = np.bincount(labels.ravel(), minlength=len(owner))
    target = np.where(size >= least, np.arange(len(owner)), 0)
    best = np.zeros(len(owner))
    for pair in touching(reach):
        for small, big in (pair, pair[::-1]):
            if size[small] < least <= size[big] and size[big] > best[small]:
                best[small], target[small] = size[big], big
    labels = np.where(labels > 0, target[labels], 0)
    claim = np.isin(zone, codes) & (labels == 0) & ~passable
    labels = spread_over_all_cells(labels, claim, rim)
    return np.unique(np.append(labels, 0), return_inverse=True)[1][:-1].reshape(zone.shape)


def spread_over_all_cells(labels, mask, steps):
    cross = ndimage.generate_binary_structure(2, 1)
    for _ in range(steps):
        labels = np.where(
            (labels == 0) & mask, ndimage.grey_dilation(labels, footprint=cross), labels
        )
    return labels


def touching(labels):
    pairs = set()
    for first, second in ((labels[1:], labels[:-1]), (labels[:, 1:], labels[:, :-1])):
        pairs |= {tuple(sorted(pair)) for pair in zip(first.flat, second.flat, strict=True)}
    return sorted((int(a), int(b)) for a, b in pairs if 0 < a < b)


@pytest.mark.slow
def test_regions_are_those_of_a_look_at_all_cells():
    rng = np.random.default_rng(1)
    several = 0
    for _ in range(200):
        shape = tuple(rng.integers(1, 40, 2).tolist())
        # Blobs of zones, of free floor and of directions.
        noise = [
            ndimage.gaussian_filter(rng.normal(size=shape), rng.uniform(0, 3)) for _ in range(4)
        ]
        zone = np.select(
            [noise[0] > np.quantile(noise[0], 0.6), noise[1] > np.quantile(noise[1], 0.7)],
            [CORRIDOR, OPEN],
        ).astype(np.uint8)
        free = noise[2] > np.quantile(noise[2], rng.uniform(0.0, 0.5))
        turn = np.where(noise[3] > 0.0, rng.uniform(0.0, math.pi, 2)[0], rng.uniform(0.0, math.pi))
        axis = np.where((zone == CORRIDOR) & (rng.random(shape) < 0.9), turn, np.nan)
        how = {"gap": int(rng.integers(0, 7)), "least": int(rng.integers(1, 12)), "rim": 3}
        found = find_regions(zone, (CORRIDOR, OPEN), axis, free, **how)
        wanted = regions_of_all_cells(zone, (CORRIDOR, OPEN), axis, free, **how)
        np.testing.assert_array_equal(found, wanted)
        several += int(found.max() > 2)
    assert several > 100
