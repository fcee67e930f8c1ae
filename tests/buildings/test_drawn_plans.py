"""The floor of drawn plans, of which it is known by construction."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import ezdxf
import numpy as np
import pytest
import shapely

from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER
from ambinav.runtime.errors import InputError, InputWarning
from tests.buildings.drawn_plans import (
    STYLES,
    THICK,
    DrawnPlan,
    courtyard,
    hall,
    hall_and_rooms,
    niche,
    office,
    plans,
    random_rooms,
    two_buildings,
)

PLANS = plans()


def read(plan: DrawnPlan, folder: Path) -> tuple[Environment, list[str]]:
    """The environment, and what was warned about."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", InputWarning)
        env = load_environment(plan.write(folder / "plan.dxf"))
    return env, [str(one.message) for one in caught if one.category is InputWarning]


def error(plan: DrawnPlan, env: Environment) -> float:
    """Area of floor that is lost, and of what is none, as a share of the floor."""
    floor = plan.floor()
    return float(shapely.symmetric_difference(floor, env.free).area / floor.area)


@pytest.mark.parametrize(
    "plan",
    [
        pytest.param(
            plan,
            id=f"{plan.name}, {plan.style}",
            marks=pytest.mark.sweep if number % 5 else pytest.mark.slow,
        )
        for number, plan in enumerate(PLANS)
    ],
)
def test_the_floor_of_a_plan_is_what_was_drawn(plan: DrawnPlan, tmp_path: Path) -> None:
    env, warned = read(plan, tmp_path)
    assert error(plan, env) < 0.01
    assert not warned


@pytest.mark.sweep
@pytest.mark.parametrize("part", range(8))
def test_a_plan_that_is_turned_has_the_same_floor(part: int, tmp_path: Path) -> None:
    """Each plan at two of five angles."""
    for number, plan in list(enumerate(PLANS))[part % 4 :: 4]:
        turned = replace(plan, angle=(0.017, 0.7, 1.1, 2.5, -1.57)[(number + 2 * (part // 4)) % 5])
        env, warned = read(turned, tmp_path)
        assert error(turned, env) < 0.01, (plan.name, turned.angle)
        assert not warned, (plan.name, turned.angle)


@pytest.mark.slow(kept=("lines",))
@pytest.mark.parametrize("style", STYLES)
def test_random_rooms_have_their_floor(style: str, tmp_path: Path) -> None:
    for seed in range(12):
        rng = np.random.default_rng(seed)
        plan = replace(random_rooms(rng), style=style, angle=float(rng.uniform(0.0, 3.0)))
        env, warned = read(plan, tmp_path)
        assert error(plan, env) < 0.01, seed
        assert not warned, seed


def test_an_opening_to_outdoors_is_a_frontier_and_said(tmp_path: Path) -> None:
    env, _ = read(hall(6.0), tmp_path)
    lengths = env.segments.lengths[env.segments.kind == FRONTIER]
    assert sorted(lengths.tolist()) == pytest.approx([0.9, 6.0], abs=1e-3)
    assert [note for note in env.notes if "wider than a door, in metres: 6." in note]


@pytest.mark.parametrize("style", ["outlines", "lines"])
def test_a_hall_behind_a_wide_gate_is_floor(style: str, tmp_path: Path) -> None:
    plan = replace(hall_and_rooms(2.0), style=style)
    env, _ = read(plan, tmp_path)
    assert error(plan, env) < 1e-3
    assert env.free.area == pytest.approx(467.0, abs=0.5)
    in_hall = env.free.intersection(shapely.box(-1.0, -1.0, 19.93, 17.0))
    assert in_hall.area == pytest.approx(312.0, abs=0.5)
    assert [note for note in env.notes if "wider than a door, in metres: 2." in note]


def test_what_counts_as_outdoors_is_said(tmp_path: Path) -> None:
    plan = niche(3.0, 1.5)
    env, _ = read(plan, tmp_path)
    (note,) = [note for note in env.notes if "not taken for floor" in note]
    assert "4.05 m² in 1 piece is not taken for floor" in note and "draw a line across" in note
    # And so it becomes floor.
    path = tmp_path / "plan.dxf"
    document = ezdxf.readfile(path)
    y = -THICK / 2
    document.modelspace().add_line((4.5, y), (7.5, y), dxfattribs={"layer": "Floor"})
    document.saveas(path)
    with_porch = load_environment(path)
    assert with_porch.free.area == pytest.approx(env.free.area + 2.7 * 1.5, abs=0.01)


def test_a_room_without_floor_is_warned_about(tmp_path: Path) -> None:
    plan = replace(courtyard(12.0), labels=[("Hall", 3, 3), ("Yard", 12, 12), ("12.50", 12, 14)])
    env, warned = read(plan, tmp_path)
    said = [text for text in warned if "no floor is found in 1 of 2 named rooms: Yard." in text]
    assert said and said[0] in env.notes


def test_doors_onto_nothing_are_said(tmp_path: Path) -> None:
    """Two doors of each building lead into the gap between them; then none of one of them does."""
    plan = two_buildings(1.5)
    into = [(10.0, y, 10.0, y + 0.9) for y in (1.0, 6.0)]
    plan = replace(plan, openings=[*plan.openings, *into], leaves=into)
    env, warned = read(plan, tmp_path)
    assert error(plan, env) < 0.01
    assert [text for text in warned if "2 of 2 doors open onto nothing" in text]
    office_notes = read(office(1, arcs=True), tmp_path)[0].notes
    assert not [note for note in office_notes if "onto nothing" in note]


def test_a_passage_between_buildings_with_doors_on_both_sides_is_floor(tmp_path: Path) -> None:
    plan = two_buildings(2.0)
    x = 12.0 + THICK
    both = [(10.0, 1.0, 10.0, 2.0), (x, 5.0, x, 6.0)]
    env, _ = read(replace(plan, openings=[*plan.openings, *both]), tmp_path)
    assert env.is_free(11.0, 4.0) and len(shapely.get_parts(env.free)) == 1


def test_an_outline_that_is_open_everywhere_is_refused_with_a_remedy(tmp_path: Path) -> None:
    plan = DrawnPlan("corner", [(0, 0, 8, 0), (0, 0, 0, 8)], [], shapely.box(0, 0, 8, 8))
    with pytest.raises(InputError, match=r"no floor is left .* draw a line across each opening"):
        load_environment(plan.write(tmp_path / "plan.dxf"))


def test_a_plan_beside_its_elevations_is_said(tmp_path: Path) -> None:
    env, warned = read(two_buildings(3.0), tmp_path)
    assert [note for note in env.notes if "2 parts of it do not touch, of" in note]
    assert not warned


def test_walls_of_one_outline_with_a_wide_pier_are_walls(tmp_path: Path) -> None:
    plan = hall(3.0)
    pier = shapely.box(-0.4, 11, 0.4, 11.8)
    body = shapely.union(plan.bodies(), pier)
    document = ezdxf.new()
    document.header["$INSUNITS"] = 6
    for part in shapely.get_parts(body):
        for ring in (part.exterior, *part.interiors):
            document.modelspace().add_lwpolyline(
                ring.coords[:-1], close=True, dxfattribs={"layer": "Walls"}
            )
    document.saveas(tmp_path / "pier.dxf")
    env = load_environment(tmp_path / "pier.dxf")
    assert env.free.area == pytest.approx(plan.floor().difference(pier).area, rel=1e-3)
