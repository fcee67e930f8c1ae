"""Sweeps: known optima, and each setting against the map of its scanner."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

import ambinav as an
from ambinav.buildings.shapes import environment_from_shapes
from ambinav.demo import DEMO_BUILDING
from ambinav.geometry.collision.reach import find_reach
from ambinav.geometry.motion.steering import Steering
from ambinav.maps.zones import ZONES
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError
from ambinav.studies.audit.audit import audit
from ambinav.studies.design.region import Region
from ambinav.studies.design.sweep.figures import Criterion
from ambinav.studies.design.sweep.sweep import sweep_scanner
from ambinav.studies.design.sweep.text import Words
from ambinav.studies.design.sweep.vary import Variation, settings
from tests.geometry import scenes

LASER = an.RangeSensor(name="laser", max_range=5.0, std=0.03, resolution=0.001)
FAN = an.RangeScanner.planar(LASER, 19, math.radians(90), (0.12, 0.0, 0.0), name="fan")


def counted(env: an.Environment, scanner: an.RangeScanner) -> NDArray[np.bool_]:
    """Floor that is explored for a scanner and that a robot of 0.2 m reaches, (ny, nx)."""
    amap = an.build_map(env, scanner, store=False)
    return amap.judged_by(find_reach(env, 0.2)).counted


def mean(amap: an.AmbiguityMap, layer: str, floor: NDArray[np.bool_]) -> float:
    return float(np.nanmean(amap.dataset[layer].values.astype(np.float64)[floor]))


@pytest.mark.slow
def test_settings_are_the_maps_of_their_scanners() -> None:
    env = scenes.scene(5, size=4.0, blocks=3, thin=1)
    found = sweep_scanner(env, FAN, ["aperture=60,180", "max_range=2"], places=0)
    assert found.shape == (2, 1)
    assert found.headings == "8, weighted equally"
    floor = counted(env, FAN)
    for outcome in (*found.outcomes, found.present):
        amap = an.build_map(env, outcome.setting.scanner, store=False)
        assert outcome.figures.mean == pytest.approx(mean(amap, "level_mean", floor), abs=1e-6)
        level = amap.dataset["level"].values[floor]
        assert outcome.figures.worst == pytest.approx(float(np.nanmax(level)), abs=1e-6)


@pytest.mark.slow(kept=("5",))
@pytest.mark.parametrize("headings", [None, 5])
def test_zones_are_those_of_the_audit(headings: int | None) -> None:
    """Of scanners that do not look all around, in the mean over headings."""
    env = scenes.scene(5, size=6.0, blocks=4, thin=2)
    swept = sweep_scanner(
        env, FAN, ["aperture=40,90,200"], places=0, criterion="bad", headings=headings
    )
    bad = []
    for outcome in (*swept.outcomes, swept.present):
        amap = an.build_map(env, outcome.setting.scanner, headings=headings, store=False)
        shares = [part.share for part in amap.zone_shares("mean", counted(env, FAN))]
        assert list(outcome.figures.zones.values()) == pytest.approx(shares, abs=1e-6)
        bad.append(outcome.figures.bad)
    assert min(bad) == 0.0 and max(bad) > 0.4


@pytest.mark.slow
def test_a_setting_that_looks_all_around_is_the_map_without_headings() -> None:
    env = scenes.scene(5, size=4.0, blocks=3, thin=1)
    found = sweep_scanner(env, FAN, ["aperture=90,360"], places=0)
    around = found.outcomes[1]
    amap = an.build_map(env, around.setting.scanner, store=False)
    assert "theta" not in amap.dataset.dims
    floor = counted(env, FAN)
    assert around.figures.mean == pytest.approx(mean(amap, "level", floor), abs=1e-6)
    zone = amap.dataset["zone"].values[floor]
    expected = [float((zone == code).mean()) for code in range(len(ZONES))]
    assert list(around.figures.zones.values()) == pytest.approx(expected)


@pytest.fixture(scope="module")
def corridor() -> an.Environment:
    """40 m long, 2 m wide, along x; closed at both ends."""
    return scenes.room(40.0, 2.0)


def ratios(env: an.Environment, yaw: float, x: float) -> tuple[float, float]:
    """Free along and across the corridor at (x, 1), with 60 degrees towards a yaw, heading 0."""
    scanner = an.RangeScanner.planar(LASER, 21, math.radians(60))
    (turned,) = (one.scanner for one in settings(scanner, [Variation("yaw", (yaw,))]))
    amap = an.build_map(env, turned, headings=1, store=False)
    along, across, axis = (
        float(amap.sample(name, x, 1.0, 0.0)) for name in ("major", "minor", "direction")
    )
    return (along, across) if abs(math.cos(axis)) > 0.7 else (across, along)


def test_in_a_corridor_a_sideways_aperture_wins_laterally(corridor: an.Environment) -> None:
    forward, sideways = ratios(corridor, 0.0, 20.0), ratios(corridor, 90.0, 20.0)
    # What looks forward meets no wall nearer than 2 m, and those at a slant.
    assert sideways[1] < forward[1] - 0.02
    assert min(forward[0], sideways[0]) > 0.9


def test_near_its_end_a_forward_aperture_wins_longitudinally(corridor: an.Environment) -> None:
    forward, sideways = ratios(corridor, 0.0, 38.0), ratios(corridor, 90.0, 38.0)
    assert forward[0] < 0.3
    assert sideways[0] > 0.9


def test_what_looks_all_around_has_no_best_yaw(corridor: an.Environment) -> None:
    around = an.RangeScanner.planar(LASER, 24, 2 * math.pi)
    end = Region.of_polygon(shapely.box(37.0, 0.0, 40.0, 2.0))
    found = sweep_scanner(corridor, around, ["yaw=0:345:15"], end)
    means = found.grid(lambda figures: figures.mean)
    np.testing.assert_allclose(means, means[0], atol=1e-6)
    # They are one scanner, and no two of them are the best and the next best.
    assert found.order == found.as_good == (0,)
    assert found.twins(7) == tuple(range(24))
    assert found.present_is_best
    assert found.turning is None


def test_nor_has_it_one_by_definition() -> None:
    # 15 degrees are the angle between its beams. Their order decides how sums in float32 are
    # rounded, which in front of a wall moves the level of a pose by 1e-3, and the mean by 1e-5.
    room = scenes.room(2.93, 1.97)
    around = an.RangeScanner.planar(LASER, 24, 2 * math.pi)
    floor = counted(room, around)
    for outcome in sweep_scanner(room, around, ["yaw=0,15,90"], places=0).outcomes:
        amap = an.build_map(room, outcome.setting.scanner, store=False)
        assert outcome.figures.mean == pytest.approx(mean(amap, "level", floor), abs=1e-4)


def test_a_turned_mount_is_computed_where_it_sits() -> None:
    env = scenes.room(4.0, 3.0)
    found = sweep_scanner(env, FAN, ["yaw=0,90"], places=0)
    assert found.headings == "0° in the map, which the robot keeps"
    floor = counted(env, FAN)
    for outcome in found.outcomes:
        amap = an.build_map(env, outcome.setting.scanner, headings=1, store=False)
        assert outcome.figures.mean == pytest.approx(mean(amap, "level", floor), abs=1e-6)


def test_a_kept_heading_turns_the_scanner() -> None:
    env = scenes.room(4.0, 3.0)
    centred = an.RangeScanner.planar(LASER, 19, math.radians(90))
    turned = sweep_scanner(env, centred, ["yaw=90"], places=0)
    kept = sweep_scanner(env, centred, ["yaw=0"], heading=math.pi / 2, places=0)
    assert turned.best.figures.mean == pytest.approx(kept.best.figures.mean, abs=1e-6)


@pytest.mark.slow
def test_a_sample_is_near_the_whole_and_its_interval_holds_it() -> None:
    env = scenes.scene(4, size=5.0, blocks=5, thin=2)
    vary = ["aperture=60,120"]
    whole = sweep_scanner(env, FAN, vary, places=0)
    some = sweep_scanner(env, FAN, vary, places=300)
    assert len(some.levels.places) == 300
    assert some.best.figures.mean == pytest.approx(whole.best.figures.mean, abs=0.03)
    true, guessed = whole.margin(None), some.margin(None)
    assert true.low == true.value == true.high
    assert guessed.low < true.value < guessed.high
    assert guessed.high - guessed.low < 0.05
    assert some.best.setting == whole.best.setting
    again = sweep_scanner(env, FAN, vary, places=300)
    assert again.best.figures == some.best.figures
    other = sweep_scanner(env, FAN, vary, places=300, seed=1)
    assert other.best.figures != some.best.figures


def test_along_a_route_the_scanner_follows_the_robot(corridor: an.Environment) -> None:
    # Towards the east end, and back in reverse: the robot faces the end all the time.
    there = Region.of_route(Route.through([[36.0, 1.05, 0.0], [39.0, 1.05, 0.0]], Steering("se2")))
    scanner = an.RangeScanner.planar(LASER, 21, math.radians(60))
    found = sweep_scanner(corridor, scanner, ["yaw=0,90,180"], there)
    assert found.region.unit == "m"
    assert found.best.setting.values == (0.0,)
    # A route to the north in the same corridor.
    across = Region.of_route(Route.through([[37.0, 0.4], [37.0, 1.6]]))
    found = sweep_scanner(corridor, scanner, ["yaw=-90,0,90"], across)
    assert found.best.setting.values == (-90.0,)


def test_turning_is_worth_it_where_the_best_side_changes() -> None:
    # From one end of a corridor to the other, with a short scanner: each end is seen near it.
    env = scenes.room(12.0, 2.0)
    route = Region.of_route(Route.through([[1.0, 1.05], [11.0, 1.05]]))
    scanner = an.RangeScanner.planar(LASER, 21, math.radians(60))
    found = sweep_scanner(env, scanner, ["yaw=0,180"], route)
    turning = found.turning
    assert turning is not None
    assert turning.is_worth_it
    assert turning.turned_mean < turning.fixed_mean
    assert turning.gain.value == pytest.approx(turning.fixed_mean - turning.turned_mean)
    x = found.levels.x
    assert (turning.best[x > 9.5] == 0).all()
    assert (turning.best[x < 2.5] == 1).all()
    assert sum(turning.shares) == pytest.approx(1.0)
    # Not with a single yaw.
    alone = sweep_scanner(env, scanner, ["yaw=0"], route).turning
    assert alone is not None
    assert not alone.is_worth_it


@pytest.mark.slow
def test_the_best_is_by_the_criterion() -> None:
    env = scenes.scene(4, size=8.0, blocks=5, thin=2)
    criteria: tuple[Criterion, ...] = ("mean", "p95", "worst", "bad")
    for criterion in criteria:
        found = sweep_scanner(env, FAN, ["aperture=60,120"], places=50, criterion=criterion)
        values = [outcome.figures.of(criterion) for outcome in found.outcomes]
        assert found.best.figures.of(criterion) == min(values)


@pytest.mark.parametrize(
    ("given", "what"),
    [
        ({"vary": ["aperture=90"], "criterion": "best"}, "criterion is 'best'"),
        ({"vary": ["aperture=90"], "spacing": -1.0}, "spacing is -1.0 m"),
        ({"vary": ["aperture=90"], "places": -3}, "places is -3"),
        ({"vary": []}, "nothing is varied"),
        (
            {"vary": ["yaw=0"], "scanner": an.RangeScanner.planar(LASER, 5, 1.0, (9.0, 0.0, 0.0))},
            "none of its floor in scene is explored: .* or a sensor stands in a wall",
        ),
        ({"vary": ["yaw=0"], "heading": 1.0, "headings": 3}, "excludes a number of headings"),
        ({"vary": ["yaw=0"], "heading": math.nan}, "heading is nan"),
        ({"vary": ["yaw=0"], "region": Region.of_polygon(shapely.box(9, 9, 10, 10))}, "no point"),
        (
            {
                "vary": ["yaw=0"],
                "region": Region.of_route(Route.through([[1, 1], [3, 1]])),
                "heading": 0.0,
            },
            "a route has its own headings",
        ),
    ],
)
def test_what_cannot_be_is_refused(given: dict[str, object], what: str) -> None:
    with pytest.raises(InputError, match=what):
        sweep_scanner(scenes.room(4.0, 3.0), **{"scanner": FAN, **given})  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["hokuyo-urg-04lx", "rplidar-a1"])
def test_the_floor_is_that_of_the_audit(preset: str) -> None:
    env = an.load_environment(DEMO_BUILDING)
    scanner = an.RangeScanner.from_preset(preset)
    amap = an.build_map(env, scanner, 0.5, store=False)
    known = audit(amap, env, scanner, places=0)
    for places in (0, 7):
        found = sweep_scanner(env, scanner, ["max_range=3"], spacing=0.5, places=places)
        assert found.levels.amount == known.parts.area(known.parts.counted)
        assert found.levels.amount < 0.85 * amap.free_area
    # Another robot, in another room.
    start = (2.15, 26.0)
    known = audit(amap, env, scanner, places=0, reach=find_reach(env, 0.47, start))
    found = sweep_scanner(
        env, scanner, ["max_range=3"], spacing=0.5, robot_radius=0.47, start=start
    )
    assert found.levels.amount == known.parts.area(known.parts.counted)


def test_unexplored_floor_does_not_count() -> None:
    # A court that the map ends in.
    room, court = shapely.box(0, 0, 4, 4), shapely.box(4, 0, 8, 4)
    env = environment_from_shapes(
        [room, court], openings=[[(4.5, 4), (8, 4), (8, 0), (4.5, 0)]], name="court"
    )
    scanner = an.RangeScanner.planar(LASER, 24, 2 * math.pi)
    known = audit(an.build_map(env, scanner, store=False), env, scanner, places=0)
    parts = known.parts
    assert parts.unexplored.any()
    found = sweep_scanner(env, scanner, ["std=0.1"], places=0)
    assert found.levels.amount == parts.area(parts.counted)
    assert len(found.levels.places) == parts.counted.sum()
    beyond = Region.of_polygon(shapely.box(7.0, 1.0, 7.5, 3.0))
    with pytest.raises(InputError, match="none of its floor in court is explored"):
        sweep_scanner(env, scanner, ["std=0.1"], beyond)


def test_twins_are_one_setting() -> None:
    env = scenes.room(4.0, 3.0)
    ring = an.RangeScanner.ring(LASER, 8, 0.1)
    found = sweep_scanner(env, ring, ["yaw=0:90:15", "max_range=2,4"], places=20)
    # 8 beams are the same after a turn by 45 degrees: 3 yaws of 7, twice.
    assert len(found.order) == 6
    assert found.twins(0) == (0, 6, 12)
    assert found.twins(2) == (2, 8)
    first, second = found.order[:2]
    assert second not in found.twins(first)
    # And none about a turn that the beams do not keep.
    fan = sweep_scanner(env, FAN, ["yaw=0:90:15"], places=20)
    assert len(fan.order) == 7
    # Beams that a map leaves out are not told apart.
    around = an.RangeScanner.planar(LASER, 360, 2 * math.pi)
    found = sweep_scanner(env, around, ["beams=30,60,120,240"], places=20)
    assert found.twins(1) == (1, 2, 3)
    assert len(found.order) == 2
    assert found.present_is_best == (found.order[0] == 1)


@pytest.mark.slow
def test_a_criterion_without_interval_ties_only_with_what_is_equal() -> None:
    env = scenes.scene(4, size=8.0, blocks=5, thin=2)
    found = sweep_scanner(env, FAN, ["aperture=60,120,180"], places=50, criterion="p95")
    values = [round(outcome.figures.p95, 6) for outcome in found.outcomes]
    assert len(found.as_good) == values.count(min(values))


@pytest.mark.slow
def test_of_equals_by_the_criterion_the_lower_mean_is_best() -> None:
    # In the middle of a hall that no beam crosses the worst level is 1, whatever looks.
    env = scenes.room(14.0, 14.0)
    found = sweep_scanner(env, FAN, ["aperture=60,120,180"], places=60, criterion="worst")
    assert [round(one.figures.worst, 6) for one in found.outcomes] == [1.0, 1.0, 1.0]
    means = [found.outcomes[i].figures.mean for i in found.order]
    assert means == sorted(means)
    assert found.best.setting.values == (180.0,)
    assert "2 others have the same figure, and a higher mean level." in Words(found).summary
