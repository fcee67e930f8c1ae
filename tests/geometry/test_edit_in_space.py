"""Edits of buildings in space, against plans, against each other, and against plain geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.geometry.edit_in_space import TAG
from ambinav.geometry.environment import Environment
from ambinav.geometry.obstacle import Obstacle
from ambinav.geometry.segments import REFLECTOR, WALL
from ambinav.runtime.errors import InputError
from tests.geometry import scenes
from tests.geometry.furnished import furnished

HEIGHT = 2.5


def tall(env: Environment) -> Environment:
    return env.in_space(an.extruded(env, HEIGHT))


def ranges(env: Environment, at: np.ndarray, elevation: np.ndarray, height: float) -> np.ndarray:
    """What rays in 24 directions and at all elevations read at each point."""
    assert env.space is not None
    azimuth = np.linspace(0.003, math.tau, 24, endpoint=False)
    turned = np.array([(a, e) for a in azimuth for e in elevation])
    flat = np.cos(turned[:, 1])
    along = [flat * np.cos(turned[:, 0]), flat * np.sin(turned[:, 0]), np.sin(turned[:, 1])]
    origin = np.column_stack([at, np.full(len(at), height)])
    distance, _ = env.space.cast(origin[:, None], np.stack(along, axis=-1)[None], 20.0)
    return np.asarray(distance)


def edits(seed: int, env: Environment) -> tuple[list[Obstacle], shapely.Polygon]:
    rng = np.random.default_rng(seed)
    a, b = scenes.points_inside(env, 2, seed).tolist()
    add = [Obstacle.post(*a, rng.uniform(0.05, 0.3)), Obstacle.panel(*b, b[0] + 1.0, b[1] + 0.4)]
    x, y = rng.uniform(env.bounds[:2], env.bounds[2:]).tolist()
    return add, shapely.box(x - 1.5, y - 1.0, x + 1.5, y + 1.0)


@pytest.mark.parametrize("seed", range(8))
def test_an_edited_extrusion_is_the_extruded_edit(seed: int) -> None:
    """Obstacles as high as the building, and removed parts: level rays go as far as in the plan."""
    plan = scenes.scene(seed, size=12.0, blocks=8)
    add, remove = edits(seed, plan)
    edited, expected = tall(plan).edited(add, remove), tall(plan.edited(add, remove))
    at = scenes.points_inside(expected, 200, seed)
    elevation = np.radians([-20.0, 0.0, 20.0])
    found, wanted = (ranges(env, at, elevation, 0.7) for env in (edited, expected))
    # A ray may slip past the end of a wall that was cut, by rounding.
    assert (np.abs(found - wanted) > 1e-6).mean() < 1e-3
    assert edited.free.equals(expected.free)


def test_rays_pass_over_a_low_obstacle_and_under_a_high_one() -> None:
    room = tall(scenes.room(6.0, 4.0))
    low = room.edited([Obstacle.post(4.0, 2.0, 0.2).between(0.0, 1.0)])
    high = room.edited([Obstacle.panel(4.0, 1.0, 4.0, 3.0).between(1.0, 2.0)])
    for env, seen_low, seen_high in ((low, 1.8, 4.0), (high, 4.0, 2.0)):
        assert env.space is not None
        distance, _ = env.space.cast([(2.0, 2.0, 0.5), (2.0, 2.0, 1.5)], (1.0, 0.0, 0.0), 9.0)
        np.testing.assert_allclose(distance, [seen_low, seen_high], atol=1e-3)
        assert not env.is_free(4.0, 2.0, 0.1)
    higher = room.edited([Obstacle.post(4.0, 2.0, 0.2).between(0.0, 1.1)])
    assert len({room.checksum, low.checksum, higher.checksum}) == 3


@pytest.mark.parametrize("top", [0.9, None])
def test_prisms_and_meshes_are_edited_alike(top: float | None) -> None:
    add = [Obstacle.post(1.0, 2.5, 0.3).between(0.0, top), Obstacle.panel(3.0, 2.5, 3.0, 3.5)]
    prisms, mesh = (env.edited(add) for env in furnished())
    at = scenes.points_inside(prisms, 150, 1)
    elevation = np.radians([-25.0, 0.0, 25.0])
    found = [ranges(env, at, elevation, 0.4) for env in (prisms, mesh)]
    assert (np.abs(found[0] - found[1]) > 1e-4).mean() < 2e-3


def test_what_stands_in_a_removed_part_goes_and_what_hangs_over_it_stays() -> None:
    room, _ = furnished()
    edited = room.edited(remove=shapely.box(1.5, 0.5, 5.0, 3.5))
    assert isinstance(edited.space, Prisms)
    table, cupboard = edited.space.solids
    assert (table.bottom, table.outline.area) == (0.70, 2.0)
    assert cupboard.outline.bounds == (5.0, 2.8, 5.4, 3.4)
    assert cupboard.bottom == 0.0
    assert edited.is_free(4.8, 3.1)
    assert not edited.is_free(5.2, 3.1)


def test_a_part_cut_out_of_solid_ground_is_closed_to_the_ceiling() -> None:
    room = tall(scenes.room(4.0, 4.0)).edited(remove=shapely.box(3.0, 1.0, 6.0, 2.0))
    assert room.space is not None
    for height in (0.1, 2.4):
        distance, _ = room.space.cast([(2.0, 1.5, height), (5.0, 1.5, height)], (1, 0, 0), 20.0)
        np.testing.assert_allclose(distance, [4.0, 1.0])
    distance, _ = room.space.cast((5.0, 1.5, 1.0), (0, 1, 0), 20.0)
    assert distance == pytest.approx(0.5)


def test_a_tag_is_met_on_its_wall_at_its_height_alone() -> None:
    room = tall(scenes.room(6.0, 4.0))
    tagged = room.edited([Obstacle.wall([(6.0, 1.5), (6.0, 2.5)], reflective=True).between(1, 1.5)])
    assert tagged.space is not None
    for height, kind, away in ((0.8, WALL, 4.0), (1.2, REFLECTOR, 4.0 - TAG), (1.8, WALL, 4.0)):
        distance, surface = tagged.space.cast((2.0, 2.0, height), (1.0, 0.0, 0.0), 9.0)
        assert distance == pytest.approx(away, abs=1e-9)
        assert tagged.surface_kind[surface] == kind
    beside, _ = tagged.space.cast((2.0, 3.0, 1.2), (1.0, 0.0, 0.0), 9.0)
    assert beside == pytest.approx(4.0)


def test_a_panel_that_reflects_does_so_on_both_sides() -> None:
    room = tall(scenes.room(6.0, 4.0))
    panel = Obstacle.panel(3.0, 1.0, 3.0, 3.0, reflective=True)
    edited = room.edited([panel])
    assert edited.space is not None
    distance, surface = edited.space.cast([(2, 2, 1), (4, 2, 1)], [(1, 0, 0), (-1, 0, 0)], 9.0)
    np.testing.assert_allclose(distance, 1.0)
    assert (edited.surface_kind[surface] == REFLECTOR).all()


def test_a_tag_on_a_thin_wall_is_met_from_both_sides() -> None:
    """Of the building as it was, and of a wall that is put up with it."""
    wall = Obstacle.panel(3.0, 0.0, 3.0, 2.0)
    tag = Obstacle.wall([(3.0, 0.5), (3.0, 1.5)], reflective=True).between(0.2, 1.0)
    plan = scenes.room(6.0, 4.0)
    for room in (tall(plan.edited([wall])).edited([tag]), tall(plan).edited([wall, tag])):
        assert room.space is not None
        origin, look = [(2, 1, 0.5), (4, 1, 0.5)], [(1, 0, 0), (-1, 0, 0)]
        distance, surface = room.space.cast(origin, look, 9.0)
        np.testing.assert_allclose(distance, 1.0 - TAG)
        assert (room.surface_kind[surface] == REFLECTOR).all()
        _, surface = room.space.cast([(2, 1, 1.5)], [(1, 0, 0)], 9.0)
        assert room.surface_kind[surface] == WALL


def test_a_thin_wall_across_a_low_box_has_no_hole() -> None:
    room = tall(scenes.room(6.0, 4.0))
    box = Obstacle(shapely.box(2.5, 1.0, 3.5, 3.0)).between(0.0, 0.3)
    panel = Obstacle.panel(3.0, 0.5, 3.0, 3.5).between(0.0, 2.0)
    for edited in (room.edited([box, panel]), room.edited([box]).edited([panel])):
        assert edited.space is not None
        distance, _ = edited.space.cast((1.0, 2.0, 1.0), (1.0, 0.0, 0.0), 9.0)
        assert distance == pytest.approx(2.0)


@pytest.mark.parametrize("top", np.linspace(0.2, 0.47, 28).tolist())
def test_a_level_ray_meets_a_top_of_its_own_height(top: float) -> None:
    """In prisms surfaces are closed, and so is what is put into a mesh."""
    for room in furnished():
        edited = room.edited([Obstacle.post(1.0, 2.5, 0.2).between(0.0, top)])
        assert edited.space is not None
        distance, _ = edited.space.cast((0.2, 2.5, top), (1.0, 0.0, 0.0), 9.0)
        assert distance == pytest.approx(0.6, abs=2e-3)


def test_what_stands_on_the_floor_of_the_plan_is_removed_too() -> None:
    """A kerb of 0.2 m that the plan does not show."""
    plan = scenes.room(6.0, 4.0)
    walls = [(0, 0, 6, 0), (6, 0, 6, 4), (6, 4, 0, 4), (0, 4, 0, 0)]
    kerb = Solid(shapely.box(4, 1, 5, 2), 0.0, 0.2)
    room = plan.in_space(
        Prisms(walls, [(0.0, 2.5)] * 4, solids=[kerb], floor=0.0, ceiling=2.5, free=plan.free)
    )
    edited = room.edited(remove=shapely.box(3.0, 0.5, 5.5, 2.5))
    assert isinstance(edited.space, Prisms)
    assert edited.space.solids == ()
    assert room.edited(remove=shapely.box(1.0, 0.5, 2.0, 2.5)) is room


def test_ranges_in_a_mesh_stay_as_they_are_to_the_last_bit() -> None:
    """Also where what is put up reaches beyond the mesh."""
    _, mesh = furnished()
    edited = mesh.edited([Obstacle.panel(5.0, 3.9, 9.0, 3.95).between(0.0, 9.0)])
    assert mesh.space is not None and edited.space is not None
    rng = np.random.default_rng(2)
    origin = rng.uniform((0.3, 0.3, 0.2), (4.0, 2.5, 2.0), (500, 3))
    look = rng.normal(size=(500, 3))
    before, after = (part.space.cast(origin, look, 9.0)[0] for part in (mesh, edited))
    assert (before == after).mean() > 0.9
    assert (np.abs(before - after)[before != after] > 1e-3).all()


def test_nothing_to_do_changes_nothing() -> None:
    for env in furnished():
        assert env.edited() is env
    room = tall(scenes.room(4.0, 4.0))
    assert room.edited(remove=shapely.box(1, 1, 2, 2)) is room


def test_bad_edits_are_refused() -> None:
    prisms, mesh = furnished()
    with pytest.raises(InputError, match="no part can be removed; change its file"):
        mesh.edited(remove=shapely.box(4.5, 2.5, 5.5, 3.5))
    with pytest.raises(InputError, match="no face is known as a reflector"):
        mesh.edited([Obstacle.post(1.0, 2.5, 0.2, reflective=True)])
    with pytest.raises(InputError, match=r"begins 2\.6 m above the floor.*2\.5 m high"):
        prisms.edited([Obstacle.post(1.0, 2.5, 0.2).between(2.6, 3.0)])
    with pytest.raises(InputError, match=r"top is 0\.2; give a height above its bottom of 0\.5"):
        Obstacle.post(0.0, 0.0, 0.1).between(0.5, 0.2)
    with pytest.raises(InputError, match="bottom is -1"):
        Obstacle.post(0.0, 0.0, 0.1).between(-1.0, None)
    with pytest.raises(InputError, match="obstacle: top"):
        Obstacle.post(0.0, 0.0, 0.1).between(0.0, "high")  # type: ignore[arg-type]


def test_floors_at_any_height_and_solids_in_the_way() -> None:
    """Heights of obstacles count from the floor of the building, not from z = 0."""
    plan = scenes.room(6.0, 4.0)
    walls = [(0, 0, 6, 0), (6, 0, 6, 4), (6, 4, 0, 4), (0, 4, 0, 0)]
    beam = Solid(shapely.box(0, 1.8, 6, 2.2), 12.2, 12.5)
    space = Prisms(walls, [(10.0, 12.5)] * 4, solids=[beam], floor=10.0, ceiling=12.5)
    edited = plan.in_space(space, 10.0).edited([Obstacle.post(4.0, 2.0, 0.2).between(0.0, 1.0)])
    assert edited.floor == 10.0
    assert edited.space is not None
    distance, _ = edited.space.cast([(2, 2, 10.5), (2, 2, 11.5)], (1.0, 0.0, 0.0), 9.0)
    np.testing.assert_allclose(distance, [1.8, 4.0], atol=1e-3)
