"""Aliasing: against brute force over all pairs and turns, and where symmetry says what is found."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from numba import njit

from ambinav import environment_from_shapes
from ambinav.ambiguity import reference
from ambinav.ambiguity.heading import turns
from ambinav.geometry.environment import Environment
from ambinav.layers.aliasing.kernel import compare_fully
from ambinav.layers.aliasing.layer import LEAST_LIKENESS, AliasedPoses, aliased_poses, compute
from ambinav.layers.aliasing.scans import Scans
from ambinav.layers.context import LayerContext
from ambinav.map_building.build import build_map
from ambinav.runtime.errors import InputError
from ambinav.sensing import Intensity, RangeScanner, RangeSensor


def laser(beams: int = 36, reach: float = 4.0, aperture: float = math.tau) -> RangeScanner:
    sensor = RangeSensor(max_range=reach, std=0.03, resolution=0.001)
    return RangeScanner.planar(sensor, beams, aperture)


def sonar() -> RangeScanner:
    """A ring with cones and bins so coarse that the table of evidence is used."""
    sensor = RangeSensor(max_range=2.5, std=0.02, resolution=0.25, aperture=math.radians(20))
    return RangeScanner.ring(sensor, 12, 0.1)


def mixed() -> RangeScanner:
    return RangeScanner.mixed(laser(24), sonar())


def floor() -> Environment:
    """Two rooms, nearly alike, a corridor between them, and a door to unknown space."""
    rooms = [shapely.box(0, 0, 2.1, 1.7), shapely.box(5, 0, 7.1, 1.6)]
    hall = shapely.box(1.9, 0.4, 5.2, 1.1)
    return environment_from_shapes(
        [shapely.union_all([*rooms, hall])], openings=[shapely.LineString([(0, 0), (0, 1.7)])],
        reflectors=[shapely.LineString([(0.3, 0), (1.1, 0)])],
    )  # fmt: skip


def seeing(scanner: RangeScanner) -> RangeScanner:
    """The same with intensities, which tell the tag of the one room."""
    return scanner.with_intensity(Intensity(wall=0.3, reflector=1.0, std=0.15))


def context(env: Environment, scanner: RangeScanner, spacing: float, **more) -> LayerContext:
    return LayerContext.of(build_map(env, scanner, spacing=spacing, **more))


@njit
def all_pairs(data, beams, xy, limit, icap, use, evidence, tau, c0, c2, near, most, phis):
    """far and near sums without any search: every pose, every turn, every beam."""
    n, order = len(xy), beams.shape[0]
    mass = np.zeros((n, 2))
    for p in range(n):
        for q in range(n):
            for k in range(order):
                pair = np.zeros((2, 5, limit.size), dtype=np.float32)
                pair[:, 4] = 1.0
                pair[0] = data[p]
                for b in range(beams.shape[1]):
                    pair[1, :, b] = data[q, :, beams[k, b]]
                alike, _, _, _, _, phi = compare_fully(
                    pair, limit, icap, use, evidence, tau, c0, c2
                )
                phis[p, q, k] = phi
                if phi <= most:
                    far = math.hypot(xy[p, 0] - xy[q, 0], xy[p, 1] - xy[q, 1]) > near * (1 + 1e-9)
                    mass[p, 1 if far else 0] += alike
    return mass


@pytest.mark.slow(kept=("laser", "fan seeing"))
@pytest.mark.parametrize(
    ("scanner", "headings", "least"),
    [
        (laser(), None, 0.01),
        (sonar(), None, 0.01),
        (mixed(), None, 0.2),
        (laser(20, 4, 2.0), 4, 1e-3),
        (seeing(laser()), None, 0.01),
        (seeing(mixed()), None, 0.2),
        (seeing(laser(20, 4, 2.0)), 4, 1e-3),
    ],
    ids=["laser", "sonar", "mixed", "fan", "seeing", "mixed seeing", "fan seeing"],
)
def test_search_equals_brute_force(scanner, headings, least):
    here = context(floor(), scanner, 0.4, headings=headings)
    found = aliased_poses(here, least=least)
    scans, table = Scans.of(here), here.table
    around = headings is None
    beams = turns(here.scanner) if around else np.arange(here.scanner.beams, dtype=np.uint64)[None]
    beams = table.turned(beams)
    assert (beams.shape[1] > here.scanner.beams) == (len(here.scanner.intensity_beams) > 0)
    data = np.stack([here.returns(k).data for k in range(len(here.headings))], axis=1)
    data = data.reshape(-1, *data.shape[2:])[scans.explored]
    xy = np.column_stack([scans.x, scans.y])[scans.explored]
    most = -math.log(least)
    phis = np.empty((len(xy), len(xy), len(beams)))
    mass = all_pairs(
        data, beams, xy, table.limit, table.inverse_cap, table.use, table.evidence, scans.tau,
        *scans.cell_variance, here.radius, most, phis,
    )  # fmt: skip
    assert (np.abs(phis - most) > 1e-4).all(), "a tie: let the test use another map"
    share = mass[:, 1] / mass.sum(axis=1)
    assert 0.05 < share.mean() < 0.95
    # Sums of float32 differ by a few 1e-5 with the width of the vector registers.
    np.testing.assert_allclose(found.share.ravel()[scans.explored], share, rtol=1e-4, atol=1e-9)
    area = mass[:, 1] * here.spacing**2
    np.testing.assert_allclose(found.area.ravel()[scans.explored], area, rtol=1e-4, atol=1e-9)
    assert found.compared >= (phis <= most).sum()
    # And it did leave most of them out; ten beams of a fan tell too little for that.
    assert found.compared < (0.5 if around else 0.9) * phis.size


@pytest.mark.slow
def test_pairs_are_compared_as_the_reference_does():
    here = context(floor(), laser(), 0.4)
    scans = Scans.of(here)
    x, y = here.points
    cell = np.diag([scans.cell_variance[0]] * 2 + [scans.cell_variance[1]])
    step = math.tau / 36
    found = aliased_poses(here)
    limit, cap = np.full(36, 4.0), np.full(36, -math.log(0.05))

    def beams(cell: int, theta: float) -> tuple[np.ndarray, ...]:
        return reference.beams(here.environment, here.scanner, here.model, x[cell], y[cell], theta)

    for p in (3, 17, 30):
        px, py, turn, likeness = found.poses[p, 0, 0]
        one, there = beams(p, 0.0), []
        # The offset may lead out of the cell that it starts from.
        for q in np.argsort(np.hypot(x - px, y - py))[:9].tolist():
            for k in range(round(turn / step) - 1, round(turn / step) + 2):
                other = beams(q, k * step)
                _, offset, _ = reference.compare(one, other, limit, cap, scans.tau, cell)
                z = np.minimum(one[0], 4.0) - np.minimum(other[0] + other[1] @ offset, 4.0)
                evidence = z * z / (2 * (one[2] + other[2]))
                apart = np.sum(evidence / np.sqrt(1 + (evidence / cap) ** 2)) / scans.tau
                at = (x[q] + offset[0], y[q] + offset[1], k * step + offset[2])
                there.append((*at, math.exp(-apart)))
        off = np.abs(np.array(there) - (px, py, turn, likeness)).max(axis=1)
        assert off.min() < 0.02


def at(here: LayerContext, alike: AliasedPoses, x: float, y: float) -> tuple[float, np.ndarray]:
    """Share and aliased poses of the cell nearest to a point."""
    px, py = here.points
    cell = int(np.argmin(np.hypot(px - x, py - y)))
    return float(alike.share[cell, 0]), alike.poses[cell, 0]


@pytest.mark.parametrize("rooms", [2, pytest.param(4, marks=pytest.mark.slow)])
def test_equal_rooms_in_a_row(rooms):
    """n rooms that are the same but for nothing: 1 - 1/n, and a twin in each of the others."""
    period = 3.37  # no multiple of the spacing
    outline = shapely.Polygon(
        [(0, 0), (2.4, 0), (2.4, 0.7), (1.7, 0.7), (1.7, 1.4), (2.4, 1.9), (0.4, 2.2)]
    )
    env = environment_from_shapes(
        [shapely.affinity.translate(outline, i * period) for i in range(rooms)]
    )
    here = context(env, laser(60), 0.1)
    alike = aliased_poses(here, count=rooms)
    # A twin between the lattice's points counts a little less than the pose itself.
    assert 1 - 1 / rooms - 0.05 < np.median(alike.share) < 1 - 1 / rooms + 0.01
    px, py = here.points
    for cell in range(0, len(px), 31):
        twins = alike.poses[cell, 0, : rooms - 1]
        room = int(px[cell] // period)
        expected = px[cell] + period * np.delete(np.arange(rooms) - room, room)
        assert np.sort(twins[:, 0]) == pytest.approx(expected, abs=0.05)
        assert twins[:, 1] == pytest.approx(py[cell], abs=0.05)
        assert twins[:, 2] == pytest.approx(0.0, abs=0.05)
        assert (twins[:, 3] >= LEAST_LIKENESS).all()


@pytest.mark.slow(kept=("crossing",))
@pytest.mark.parametrize("fold", [4, 6], ids=["crossing", "hexagon"])
def test_rotated_places_are_the_look_alikes(fold):
    """A crossing of equal corridors, four and six of them, each with the same niche."""
    arm = shapely.union_all([shapely.box(0, -0.6, 4.0, 0.6), shapely.box(3.0, 0.0, 3.5, 1.1)])
    turned = [shapely.affinity.rotate(arm, 360 / fold * i, origin=(0, 0)) for i in range(fold)]
    env = environment_from_shapes([shapely.union_all(turned)])
    here = context(env, laser(60, 8.0), 0.1)
    alike = aliased_poses(here, count=fold)
    share, twins = at(here, alike, 2.5, 0.3)
    assert 1 - 1 / fold - 0.13 < share < 1 - 1 / fold + 0.01
    px, py = here.points
    cell = int(np.argmin(np.hypot(px - 2.5, py - 0.3)))
    place = px[cell] + 1j * py[cell]
    angles = math.tau / fold * np.arange(1, fold)
    expected = place * np.exp(1j * angles)
    for one, angle in zip(expected, angles, strict=True):
        near = np.abs(twins[: fold - 1, 0] + 1j * twins[: fold - 1, 1] - one)
        best = int(near.argmin())
        assert near[best] < 0.06
        assert math.remainder(twins[best, 2] - angle, math.tau) == pytest.approx(0.0, abs=0.03)
        assert twins[best, 3] > 0.2


def test_a_room_without_symmetry_has_no_look_alikes():
    env = environment_from_shapes([shapely.Polygon([(0, 0), (3, 0), (3.5, 1.2), (1.2, 2.6)])])
    alike = aliased_poses(context(env, laser(60), 0.2))
    assert np.median(alike.share) < 0.02


def test_places_of_ones_own_are_not_listed_but_count():
    here = context(floor(), laser(), 0.4)
    free = aliased_poses(here)
    own = aliased_poses(here, place=np.ones(len(here.points[0]), dtype=np.int32))
    np.testing.assert_array_equal(own.share, free.share)
    assert np.isnan(own.poses).all()


@pytest.mark.parametrize(
    ("scanner", "headings"), [(laser(), None), (laser(20, 4, 2.0), 4)], ids=["laser", "fan"]
)
def test_those_that_are_sought_are_found_as_among_all(scanner, headings):
    here = context(floor(), scanner, 0.4, headings=headings)
    whole = aliased_poses(here, count=3)
    sought = np.arange(len(here.points[0])) % 3 == 1
    some = aliased_poses(here, count=3, sought=sought)
    for name in ("share", "area", "poses"):
        one, all_ = getattr(some, name), getattr(whole, name)
        np.testing.assert_array_equal(one[sought], all_[sought])
        assert np.isnan(one[~sought]).all()
    assert some.compared < whole.compared
    none = aliased_poses(here, sought=np.zeros_like(sought))
    assert np.isnan(none.share).all() and none.compared == 0


def test_unexplored_floor_is_like_everything_and_nothing_is_like_it():
    """A room open to unknown space all round: scans carry no information there."""
    box = shapely.box(0, 0, 1.5, 1.5)
    env = environment_from_shapes([box, shapely.box(3, 0, 5, 1.2)], openings=[box.exterior])
    here = context(env, laser(), 0.3)
    layer = compute(here)
    x = here.lattice.x[np.nonzero(here.free)[1]]
    share = layer["aliasing"][here.free]
    assert (share[x < 2] == 1.0).all()
    assert (share[x > 2] < 1.0).all()
    assert np.isnan(layer["aliasing_area"][here.free][x < 2]).all()
    assert not (layer["aliasing_x"][here.free] < 2.0).any()


def test_layer_on_the_lattice():
    here = context(floor(), laser(20, 4, 2.0), 0.4, headings=4)
    layer = compute(here, least=0.05)
    for values in layer.values():
        assert values.shape == (*here.free.shape, 4)
        assert values.dtype == np.float32
        assert np.isnan(values[~here.free]).all()
    share = layer["aliasing"][here.free]
    assert ((share >= 0.0) & (share <= 1.0)).all()
    aliased = np.isfinite(layer["aliasing_x"])
    assert (layer["aliasing_distance"][aliased] > here.radius - 2 * here.spacing).all()


@pytest.mark.parametrize("least", [0.0, 1.0, -0.1, math.nan])
def test_bad_least(least):
    with pytest.raises(InputError, match="least"):
        aliased_poses(context(floor(), laser(), 0.5), least=least)
    assert 0.0 < LEAST_LIKENESS < 1.0
