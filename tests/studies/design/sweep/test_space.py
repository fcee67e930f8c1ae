"""Sweeps in space: the plan's figures where it is extruded, and each setting against its map."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.ambiguity import panorama
from ambinav.buildings.shapes import environment_from_shapes
from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.geometry.extrude import extruded
from ambinav.maps.zones import NOT_FREE
from ambinav.runtime.errors import InputError
from ambinav.studies.design.region import Region
from ambinav.studies.design.sweep.sweep import SweepResult, sweep_scanner
from ambinav.studies.design.sweep.text import Words
from tests.buildings import plan_models
from tests.geometry import scenes
from tests.geometry.furnished import furnished

LASER = an.RangeSensor(name="laser", max_range=5.0, std=0.03, resolution=0.001)
# Turned by a hair: rays along walls meet corners, which of them is not said.
HAIR = 0.003
FAN = an.RangeScanner.planar(LASER, 19, math.radians(90), (0.12, 0.0, HAIR), z=0.3, name="fan")
LAYERS = an.RangeScanner.layered(
    LASER, 24, np.radians([-20, 0, 20]), mount=(0.0, 0.0, HAIR), z=0.5, name="layers"
)
RIG = an.RangeScanner.mixed(FAN, LAYERS, name="rig")


def tall(env: an.Environment) -> an.Environment:
    return env.in_space(extruded(env, 2.5))


def check_against_maps(env: an.Environment, found: SweepResult) -> None:
    """Compare every setting, and the present scanner, with its map at every place and heading."""
    levels = found.levels
    for row, outcome in zip(found.rows, (*found.outcomes, found.present), strict=True):
        scanner = outcome.setting.scanner
        headings = None
        if levels.level.shape[2] == 1 and not scanner.looks_all_around:
            headings = len(levels.headings)
        data = an.build_map(env, scanner, found.spacing, headings=headings, store=False).dataset
        y, x = (
            np.rint((at - float(axis[0])) / found.spacing).astype(int)
            for at, axis in ((levels.y, data.y), (levels.x, data.x))
        )
        for layer, values in (("level", levels.level[row]), ("zone", levels.zone[row])):
            expected = data[layer].transpose("y", "x", ...).values[y, x].reshape(len(x), -1)
            if found.region.kind == "route" and headings:
                expected = np.take_along_axis(expected, levels.places.heading[:, None], axis=1)
            expected = np.broadcast_to(expected, values.shape)
            if layer == "zone" and values.shape[1] > 1 and "zone_mean" in data:
                mean = data["zone_mean"].values[y, x][:, None]
                expected = np.where(np.isfinite(levels.level[row]), mean, NOT_FREE)
            np.testing.assert_allclose(values, expected, atol=1e-6, err_msg=str(outcome.setting))


# -- an extruded plan is the plan --------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("vary", ["aperture=60,120", "yaw=0.5:180.5:90"])
def test_a_level_scanner_has_the_figures_of_the_plan(vary: str) -> None:
    plan = scenes.scene(5, size=4.0, blocks=3, thin=1)
    flat = sweep_scanner(plan, FAN, [vary], places=60)
    solid = sweep_scanner(tall(plan), FAN, [vary, "height=0.3,1.1"], places=60)
    assert solid.headings == flat.headings
    assert solid.levels.amount == flat.levels.amount
    for count, outcome in enumerate(flat.outcomes):
        for height in (0, 1):
            assert solid.outcomes[2 * count + height].figures == outcome.figures
    assert solid.present.figures == flat.present.figures


def test_along_a_route_too() -> None:
    plan = scenes.room(6.0, 2.0)
    route = Region.of_route(an.Route.through([[1.0, 1.05], [5.0, 0.8]]))
    flat = sweep_scanner(plan, FAN, ["yaw=0.5,180.5"], route)
    solid = sweep_scanner(tall(plan), FAN, ["yaw=0.5,180.5"], route)
    assert [one.figures for one in solid.outcomes] == [one.figures for one in flat.outcomes]
    assert solid.turning is not None
    assert flat.turning is not None
    assert solid.turning.gain == flat.turning.gain


# -- each setting is the map of its scanner ----------------------------------------------------


@pytest.mark.slow(
    kept=(
        "scanner0-vary0-None-prisms",
        "scanner1-vary1-None-mesh",
        "scanner2-vary2-None-prisms",
        "scanner3-vary3-1-mesh",
    )
)
@pytest.mark.parametrize("kind", ["prisms", "mesh"])
@pytest.mark.parametrize(
    ("scanner", "vary", "part"),
    [
        # Under the table, in it and over it.
        (FAN, ["height=0.3,0.72,1.0", "aperture=60,360"], None),
        (LAYERS, ["pitch=-15,0", "height=0.5,1.1"], None),
        (LAYERS, ["aperture=120,360", "max_range=3"], None),
        (RIG, ["height=0.2,1.3", "yaw=-40.3,60.4"], "1"),
    ],
)
def test_settings_in_a_furnished_room(
    scanner: an.RangeScanner, vary: list[str], part: str | None, kind: str
) -> None:
    env = furnished()[("prisms", "mesh").index(kind)]
    found = sweep_scanner(env, scanner, vary, part=part, spacing=0.2, places=40)
    check_against_maps(env, found)


@pytest.mark.slow
def test_settings_along_a_route() -> None:
    _, mesh = furnished()
    route = Region.of_route(an.Route.through([[1.0, 1.5], [5.0, 1.3], [5.3, 2.3]]))
    found = sweep_scanner(mesh, FAN, ["height=0.3,1.0", "pitch=0,10"], route, spacing=0.2)
    assert found.headings == "those of the route"
    # No mast goes along under the table.
    standing = [one.figures.standing for one in found.outcomes]
    assert standing[:2] == [1.0, 1.0]
    assert standing[2] == standing[3] < 0.8
    check_against_maps(mesh, found)


@pytest.mark.slow
def test_settings_in_a_building_model(tmp_path: Path) -> None:
    house = plan_models.two_storeys(tmp_path / "house.ifc")
    env = an.load_environment(house, level=0, in_space=True)
    found = sweep_scanner(env, LAYERS, ["height=0.3,1.4"], spacing=0.25, places=50)
    check_against_maps(env, found)
    # Over the sills of its windows.
    assert found.outcomes[0].figures != found.outcomes[1].figures


def test_a_higher_scanner_passes_over_low_furniture() -> None:
    """A bench across the room, 0.4 m high: the robot stops before it, its scanner goes on.

    And a sill of 0.08 m, which no robot is stopped by.
    """
    bench = shapely.box(2.0, 0.0, 2.4, 3.0)
    plan = environment_from_shapes([shapely.box(0, 0, 4, 3)], name="bench")
    walls = [(0, 0, 4, 0), (4, 0, 4, 3), (4, 3, 0, 3), (0, 3, 0, 0)]
    solids = [Solid(bench, 0.0, 0.4), Solid(shapely.box(0.5, 0.0, 1.0, 3.0), -0.1, 0.08)]
    env = plan.in_space(Prisms(walls, [(0.0, 2.5)] * 4, solids=solids, floor=0.0, ceiling=2.5))
    ahead = an.RangeScanner.planar(LASER, 19, math.pi / 2, (0.3, 0.0, HAIR), z=0.6)
    found = sweep_scanner(
        env, ahead, ["height=0.2,0.6"], heading=0.0, places=0, spacing=0.1, robot_radius=0.05
    )
    low, high = (one.figures.standing for one in found.outcomes)
    x = found.levels.x
    assert not ((x > 2.0) & (x < 2.4)).any()
    assert ((x > 0.5) & (x < 1.0)).any()
    # 0.3 m before the far wall the sensor would be in that.
    before_wall, before_bench = x > 3.7, (x > 1.7) & (x < 2.0)
    assert before_bench.any()
    assert high == pytest.approx(1.0 - before_wall.mean())
    assert low == pytest.approx(1.0 - (before_wall | before_bench).mean())


def test_a_best_setting_that_fits_on_less_floor_is_reported_so() -> None:
    env, _ = furnished()
    found = sweep_scanner(env, LAYERS, ["height=0.5,1.3"], spacing=0.2, places=0)
    (best,) = found.best.setting.values
    assert best == 1.3
    # Of 6 x 4 m without the cupboard the table of 2 m² and what touches it are left out.
    standing = found.best.figures.standing
    assert standing == pytest.approx(1.0 - 2.0 / found.levels.amount, abs=0.01)
    assert (
        f"That is of the {100 * standing:.1f} % of the region where the robot fits with it; with "
        "others it fits on up to 100.0 %."
    ) in Words(found).summary


# -- what is shared and what is refused --------------------------------------------------------


def test_shared_beams_are_cast_once(monkeypatch: pytest.MonkeyPatch) -> None:
    cast: list[int] = []

    def counting(env, scanner, *arguments):  # type: ignore[no-untyped-def]
        cast.append(scanner.beams)
        return returns(env, scanner, *arguments)

    returns = panorama.panorama_returns
    monkeypatch.setattr(panorama, "panorama_returns", counting)
    env = tall(scenes.room(4.0, 3.0))
    # 7, 13 and 25 beams, 5 degrees apart, at yaws of 30 degrees: 12 directions besides the widest.
    vary = ["aperture=30,60,120", "yaw=0.5,30.5,60.5"]
    layers = an.RangeScanner.layered(LASER, 19, [-0.2, 0.1], math.pi / 2, z=0.5)
    sweep_scanner(env, layers, vary, spacing=0.5, places=8)
    # Those of the present scanner look half a degree beside.
    assert cast == [2 * (25 + 12) + 2 * 19]


@pytest.mark.parametrize(
    ("env", "scanner", "vary", "what"),
    [
        (scenes.room(4.0, 3.0), FAN, "height=0.5", "vary height: scene is a plan, which has no "),
        (scenes.room(4.0, 3.0), FAN, "pitch=5", r"vary pitch: .* `--extrude M`, .*extruded\("),
        (scenes.room(4.0, 3.0), LAYERS, "max_range=3", "it is a plan, and the scanner looks up"),
        (
            tall(scenes.room(4.0, 3.0)), FAN.raised(-0.3), "height=0.5",
            "z = 0 m, on its floor; give the mount a height.*`--scanner-height M` on the comm",
        ),
        (tall(scenes.room(4.0, 3.0)), FAN.raised(3.0), "height=0.5", "or a sensor stands in a "),
    ],
)  # fmt: skip
def test_what_does_not_go_together_is_refused(
    env: an.Environment, scanner: an.RangeScanner, vary: str, what: str
) -> None:
    with pytest.raises(InputError, match=what):
        sweep_scanner(env, scanner, [vary])
