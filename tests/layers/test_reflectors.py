"""The layer `reflectors`: views, precision and aliasing against independent computations."""

from __future__ import annotations

import functools
import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

import ambinav as an
from ambinav.geometry.environment import Environment
from ambinav.geometry.obstacle import Obstacle
from ambinav.layers.context import LayerContext
from ambinav.layers.reflectors.aliased_poses import APART, TURNED
from ambinav.layers.reflectors.positioning import Positioning, Site
from ambinav.layers.reflectors.precision import position_stds
from ambinav.layers.reflectors.targets import Targets
from ambinav.layers.reflectors.views import ReflectorRules, seen_reflectors, sees_all_around
from ambinav.runtime.errors import InputError
from ambinav.sensing.intensity import Intensity
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor

Floats = NDArray[np.float64]

CHANNEL = Intensity(wall=0.3, reflector=1.0, std=0.15)


def scanner(
    beams: int = 720, aperture: float = 2 * math.pi, max_range: float = 12.0, std: float = 0.01
) -> RangeScanner:
    """Return a laser that measures intensities."""
    sensor = RangeSensor(max_range=max_range, std=std, resolution=0.001, intensity=CHANNEL)
    return RangeScanner.planar(sensor, beams, aperture)


def room(posts: list[tuple[float, float]], width: float = 8.0, depth: float = 6.0) -> Environment:
    """Return a room with round reflectors, 0.1 m in radius."""
    bare = an.environment_from_shapes([[(0, 0), (width, 0), (width, depth), (0, depth)]])
    return bare.edited(add=[Obstacle.post(x, y, 0.1, reflective=True) for x, y in posts])


def site(environment: Environment, rules: ReflectorRules, seeing: RangeScanner) -> Site:
    """Return the poses of a map of 0.5 m."""
    amap = an.build_map(environment, seeing, spacing=0.5, store=False)
    return Site.of(LayerContext.of(amap, environment), rules)


def positioning(
    environment: Environment, rules: ReflectorRules, seeing: RangeScanner
) -> Positioning:
    """Judge the reflectors of a building."""
    where, targets = site(environment, rules, seeing), Targets.of(environment)
    return where.positioning(targets, where.views(targets))


def test_targets_are_the_reflectors_of_the_building() -> None:
    tags = [[(2.0, 0.0), (2.4, 0.0)], [(8.0, 3.0), (8.0, 3.4)]]
    made = an.environment_from_shapes([[(0, 0), (8, 0), (8, 6), (0, 6)]], reflectors=tags)
    edited = made.edited(add=[Obstacle.post(4.0, 3.0, 0.1, reflective=True)])
    middle = Targets.of(edited).middle
    expected = [(2.2, 0.0), (4.0, 3.0), (8.0, 3.2)]
    assert np.allclose(sorted(middle.tolist()), expected, atol=1e-9)
    assert len(Targets.of(room([]))) == 0


def test_a_reflector_around_a_corner_is_seen() -> None:
    corner = [(7.5, 0.0), (8.0, 0.0), (8.0, 0.6)]
    building = an.environment_from_shapes([[(0, 0), (8, 0), (8, 6), (0, 6)]], reflectors=[corner])
    targets = Targets.of(building)
    poses = np.array([[4.0, 0.5, 0.0], [7.0, 4.0, 0.0], [2.0, 5.0, 0.0]])
    assert seen_reflectors(building, scanner(), targets, poses, ReflectorRules()).all()


@pytest.mark.parametrize("incidence", [20.0, 45.0, 70.0])
def test_a_tag_is_seen_up_to_the_angle_of_incidence_and_the_range(incidence: float) -> None:
    building = an.environment_from_shapes(
        [[(0, 0), (20, 0), (20, 10), (0, 10)]], reflectors=[[(9.8, 0.0), (10.2, 0.0)]]
    )
    rng = np.random.default_rng(1)
    poses = np.column_stack([rng.uniform(0, 20, 4000), rng.uniform(0, 10, 4000), np.zeros(4000)])
    rules = ReflectorRules(max_range=6.0, max_incidence=incidence)
    seen = seen_reflectors(building, scanner(), Targets.of(building), poses, rules)[:, 0]
    off, away = poses[:, 0] - 10.0, np.hypot(poses[:, 0] - 10.0, poses[:, 1])
    angle = np.degrees(np.arctan2(np.abs(off), poses[:, 1]))
    expected = (angle <= incidence) & (away <= 6.0)
    # Right at the tag the ends are seen under other angles, and it is wide: never too narrow here.
    assert np.array_equal(seen, expected)


def test_a_tag_must_be_as_wide_as_the_angle_between_two_beams() -> None:
    building = an.environment_from_shapes(
        [[(0, 0), (20, 0), (20, 10), (0, 10)]], reflectors=[[(9.9, 0.0), (10.1, 0.0)]]
    )
    away = np.linspace(0.5, 9.5, 200)
    poses = np.column_stack([np.full(200, 10.0), away, np.zeros(200)])
    coarse = scanner(beams=180)
    seen = seen_reflectors(building, coarse, Targets.of(building), poses, ReflectorRules())[:, 0]
    assert np.array_equal(seen, 2.0 * np.arctan2(0.1, away) >= math.radians(2.0))


def test_nothing_is_seen_through_walls_and_behind_posts() -> None:
    posts = [(4.0, 3.0), (6.0, 3.0)]
    building = room(posts).edited(add=[Obstacle.wall([(0.0, 4.5), (8.0, 4.5)], 0.0)])
    poses = np.array([[1.0, 3.0, 0.0], [4.0, 1.0, 0.0], [4.0, 5.0, 0.0]])
    seen = seen_reflectors(building, scanner(), Targets.of(building), poses, ReflectorRules())
    order = np.argsort(Targets.of(building).middle[:, 0])
    assert seen[:, order].tolist() == [[True, False], [True, True], [False, False]]


def test_the_aperture_turns_with_the_robot() -> None:
    building, quarter = room([(7.0, 3.0)]), scanner(beams=181, aperture=math.pi / 2)
    assert not sees_all_around(quarter)
    assert sees_all_around(scanner())
    turns = np.linspace(-math.pi, math.pi, 361)[:-1]
    poses = np.column_stack([np.full(360, 2.0), np.full(360, 3.0), turns])
    seen = seen_reflectors(building, quarter, Targets.of(building), poses, ReflectorRules())[:, 0]
    assert np.array_equal(seen, np.abs(turns) <= math.pi / 4 + 1e-9)


def test_several_beams_in_one_direction_are_no_narrower_step() -> None:
    building, once = room([(7.0, 3.0), (1.0, 1.0)]), scanner(beams=180)
    twice = RangeScanner((*once.parts, *once.parts), name="two layers")
    targets = Targets.of(building)
    poses = np.column_stack([np.linspace(0.5, 6.5, 60), np.full(60, 2.5), np.zeros(60)])
    seen = [
        seen_reflectors(building, each, targets, poses, ReflectorRules()) for each in (once, twice)
    ]
    assert np.array_equal(*seen)
    assert 0 < seen[0].sum() < seen[0].size
    stds = [position_stds(each, 0.02, targets, poses, seen[0]) for each in (once, twice)]
    assert np.array_equal(*stds)


def test_precision_is_that_of_the_summed_information() -> None:
    rng = np.random.default_rng(3)
    targets = Targets.of_outlines(shapely.points(rng.uniform(0, 10, (6, 2))).tolist())
    poses = np.column_stack([rng.uniform(0, 10, (50, 2)), rng.uniform(-3, 3, 50)])
    seen, seeing = rng.random((50, 6)) < 0.6, scanner(std=0.02, max_range=20.0)
    stds = position_stds(seeing, 0.03, targets, poses, seen)
    turn = math.radians(0.5) ** 2 / 12.0
    for k, (x, y, _) in enumerate(poses):
        information = np.zeros((3, 3))
        for at_x, at_y in targets.middle[seen[k]]:
            dx, dy = at_x - x, at_y - y
            r = math.hypot(dx, dy)
            of_range, of_turn = 0.02**2 + 0.001**2 / 12 + 0.03**2, turn + (0.03 / r) ** 2
            for row, variance in (
                (np.array([-dx / r, -dy / r, 0.0]), of_range),
                (np.array([dy / r**2, -dx / r**2, -1.0]), of_turn),
            ):
                information += np.outer(row, row) / variance
        if seen[k].sum() < 2:
            assert stds[k] == math.inf
        else:
            worst = np.linalg.eigvalsh(np.linalg.inv(information)[:2, :2]).max()
            assert stds[k] == pytest.approx(math.sqrt(worst), rel=1e-6)


def explained_by_permutation(
    where: Site, targets: Targets, seen: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return where all reflectors in view fit a wrong pose: every assignment, fitted by SciPy."""
    x, y = where.lattice.points
    rules, middle = where.rules, targets.middle
    result = np.zeros(len(x), dtype=np.bool_)

    @functools.cache
    def fits(view: tuple[int, ...]) -> list[tuple[list[int], Rotation, Floats, Floats]]:
        """Return the assignments that fit: images, rotation and both centres."""
        ours, found = middle[list(view)], []
        for image in map(list, itertools.permutations(range(len(targets)), len(view))):
            theirs = middle[image]
            # Where all points are as near as this, so are their distances from each other.
            if np.abs(cdist(ours, ours) - cdist(theirs, theirs)).max() > 2.001 * rules.tolerance:
                continue
            centre, other = ours.mean(axis=0), theirs.mean(axis=0)
            flat = [np.pad(points, ((0, 0), (0, 1))) for points in (theirs - other, ours - centre)]
            # A rotation about z: both sets are of the plane, and lifting z keeps it upright.
            flat = [np.vstack([points, [0.0, 0.0, 1e3]]) for points in flat]
            turn, _ = Rotation.align_vectors(*flat)
            moved = turn.apply(flat[1])[:-1, :2] + other
            if np.hypot(*(moved - theirs).T).max() <= rules.tolerance:
                found.append((image, turn, centre, other))
        return found

    for p in range(len(x)):
        view = tuple(np.flatnonzero(seen[p, 0]).tolist())
        if len(view) < rules.needed:
            continue
        for image, turn, centre, other in fits(view):
            qx, qy = turn.apply([x[p] - centre[0], y[p] - centre[1], 0.0])[:2] + other
            angle = abs(turn.as_rotvec()[2])
            if math.hypot(qx - x[p], qy - y[p]) <= APART and angle <= TURNED:
                continue
            away = np.hypot(x - qx, y - qy)
            wrong = int(np.argmin(away))
            inside = max(abs(x[wrong] - qx), abs(y[wrong] - qy)) <= 0.25
            if inside and seen[wrong, 0, image].all():
                result[p] = True
                break
    return result


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Optimal rotation is not uniquely")
@settings(max_examples=12)
@given(
    st.lists(st.tuples(st.integers(1, 6), st.integers(1, 4)), min_size=3, max_size=5, unique=True),
    st.sampled_from([4.0, 12.0]),
)
def test_margin_is_zero_where_an_assignment_of_all_in_view_fits(
    posts: list[tuple[int, int]], far: float
) -> None:
    # On whole metres, off the lattice's points: much is alike.
    building = room([(x + 0.13, y + 0.17) for x, y in posts])
    rules = ReflectorRules(max_range=far)
    where, targets = site(building, rules, scanner()), Targets.of(building)
    seen = where.views(targets)
    margin = where.positioning(targets, seen).margin[:, 0]
    enough = seen[:, 0].sum(axis=1) >= rules.needed
    expected = explained_by_permutation(where, targets, seen)
    assert np.array_equal(margin[enough] == 0, expected[enough])
    assert not margin[~enough].any()


def test_a_symmetric_layout_is_ambiguous_until_one_reflector_breaks_it() -> None:
    symmetric = [(1.0, 1.0), (7.0, 5.0), (2.5, 4.0), (5.5, 2.0)]
    found = positioning(room(symmetric), ReflectorRules(), scanner())
    assert found.enough.mean() > 0.9
    assert not found.unique[(found.count == 4)[:, 0]].any()
    better = positioning(room([*symmetric, (3.0, 1.0)]), ReflectorRules(), scanner())
    assert better.unique[(better.count == 5)[:, 0]].all()


def test_the_layer_does_not_change_as_the_building_turns() -> None:
    posts = [(1.0, 1.0), (6.5, 5.0), (2.5, 4.0), (5.0, 1.5)]
    building, rules = room(posts), ReflectorRules()
    turned = building.transformed(math.pi / 2, 20.0, -3.0)
    first, second = (positioning(each, rules, scanner()) for each in (building, turned))
    for name in ("count", "margin", "std"):
        ours, theirs = (np.sort(getattr(each, name), axis=None) for each in (first, second))
        assert np.allclose(ours, theirs, rtol=1e-6)


def test_the_layer_is_part_of_a_map() -> None:
    building = room([(1.0, 1.0), (6.5, 5.0), (2.5, 4.0)])
    amap = an.build_map(building, scanner(), spacing=0.5, layers=["reflectors"], store=False)
    count = amap.floor("reflectors").values
    assert np.nanmax(count) == 3
    assert np.array_equal(np.isfinite(count), amap.dataset["free"].values)
    std = amap.floor("reflectors_std").values
    assert np.nanmin(std[count >= 2]) > 0.0
    assert np.isnan(std[count < 2]).all()
    assert np.nanmax(amap.floor("reflectors_margin").values[count < 3], initial=0.0) == 0.0


def test_bad_input_is_refused() -> None:
    blind = RangeScanner.from_preset("turtlebot3-lds")
    with pytest.raises(InputError, match="it measures no intensities"):
        an.build_map(room([(4, 3)]), blind, spacing=0.5, layers=["reflectors"], store=False)
    for options, message in (
        ({"needed": 1}, "needed is 1"),
        ({"max_incidence": 120.0}, "max_incidence"),
        ({"tolerance": -1.0}, "tolerance"),
        ({"max_std": 0.0}, "max_std"),
    ):
        with pytest.raises(InputError, match=message):
            ReflectorRules(**options)


def test_a_strip_that_branches_is_one_reflector() -> None:
    """As where a flat tag runs in and out of a round wall's corners."""
    strip = [(2.0, 0.0), (2.2, 0.0), (2.4, 0.0)]
    stub = [(2.2, 0.0), (2.2, 0.1)]
    lines = [*itertools.pairwise(strip), stub, [(5.0, 0.0), (5.3, 0.0)]]
    building = an.environment_from_shapes([[(0, 0), (8, 0), (8, 6), (0, 6)]], reflectors=lines)
    targets = Targets.of(building)
    assert len(targets) == 2 and targets.first[-1] == len(targets.edges)
