"""Scanners against each other: figures by computations apart, and what must play no part."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely
import xarray as xr

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.drive.noise import OdometryNoise
from ambinav.geometry.collision.reach import find_reach
from ambinav.localization.expected_covariance import expected_covariance
from ambinav.map_building.build import build_map
from ambinav.routes.route import Route
from ambinav.routes.sampled import sample_routes
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.store.map_store import MapStore
from ambinav.studies.audit.audit import audit
from ambinav.studies.design.scanners.compare import compare_scanners, distinct
from ambinav.studies.design.scanners.costs import Cost, Costs
from ambinav.studies.design.scanners.document import document
from ambinav.studies.design.scanners.route_figures import ErrorModel, expected_errors

from .conftest import SPACING


def row_of(table, name):
    return next(row for row in table.rows if row.name == name)


def without_times(table):
    plain = document(table).model_dump()
    for scanner in plain["scanners"]:
        scanner["build_seconds"] = None
    return plain


@pytest.mark.parametrize("name", ["long", "short", "ahead", "ring"])
def test_the_bad_area_is_that_of_an_audit_to_the_last_bit(hall, scanners, table, name):
    scanner = scanners[name]
    amap = build_map(hall, scanner, SPACING, store=False)
    found, row = audit(amap, hall, scanner), row_of(table, name)
    assert row.shares == found.shares
    assert row.bad_area == found.shares[2].area + found.shares[3].area
    assert row.counted_area == found.area


@pytest.mark.slow
@pytest.mark.parametrize("name", ["short", "ring"])
def test_the_bad_area_is_the_cells_counted_by_hand(hall, scanners, table, tmp_path, name):
    build_map(hall, scanners[name], SPACING, store=False).save(tmp_path / "map.zarr")
    data = xr.open_zarr(tmp_path / "map.zarr").load()
    x, y = np.meshgrid(data["x"], data["y"])
    # Shrunk by the robot's radius; exactly at it nobody's rounding is asked.
    room = hall.free.buffer(-0.2, quad_segs=64)
    assert room.geom_type == "Polygon"
    inside = shapely.contains_xy(room, x, y)
    zone = data["zone"].values
    bad = int((inside & ((zone == 2) | (zone == 3))).sum())
    row = row_of(table, name)
    assert bad > 20
    assert row.bad_area == pytest.approx(bad * SPACING**2, rel=1e-12)


@pytest.mark.slow
def test_neither_order_nor_repetition_plays_a_part(hall, scanners, routes, costs, table):
    every = list(scanners.values())
    again = compare_scanners(
        hall, [*every[::-1], every[1], replace(every[0])], spacing=SPACING, routes=routes,
        costs=costs, layers=("gfm",), store=False,
    )  # fmt: skip
    assert without_times(again) == without_times(table)


def test_rows_are_in_order_and_fronts_hold_who_has_a_figure(table):
    bad = [row.bad_area for row in table.rows]
    assert bad == sorted(bad) and bad[0] < bad[-1]
    points = {front.key: {one.name for one in front.points} for front in table.fronts}
    everyone = {"long", "short", "ahead", "ring"}
    assert points == {
        "price": {"long", "short", "ring"}, "power": {"long", "ring"}, "beams": everyone,
        "range": everyone, "error": everyone,
    }  # fmt: skip
    assert table.front is table.fronts[0]


def test_one_robot_carries_them_all(hall, scanners):
    wide = replace(scanners["short"], robot_radius=0.45)
    table = compare_scanners(hall, [wide, scanners["long"]], spacing=SPACING, pairs=0, store=False)
    assert table.reach.radius == 0.45 and table.routes == ()
    assert row_of(table, "long").counted_area == row_of(table, "short").counted_area
    assert {front.key for front in table.fronts} == {"beams", "range"}
    given = compare_scanners(hall, [wide], spacing=SPACING, pairs=0, robot_radius=0.3, store=False)
    assert given.reach.radius == 0.3


def test_what_cannot_be_used_is_said_and_the_rest_goes_on(hall, scanners, table):
    outrigger = RangeScanner.from_mounts(
        scanners["long"].sensors, [(30.0, 0.0, 0.1 * i) for i in range(12)], name="outrigger"
    )
    found = compare_scanners(
        hall, [outrigger, scanners["ring"]], spacing=SPACING, pairs=0, layers=["gfm"], store=False
    )
    (unusable,) = found.unusable
    assert unusable.name == outrigger.name and "stands inside a wall" in unusable.reason
    assert [row.name for row in found.rows] == ["ring"]
    assert "gfm" in found.rows[0].lacking and found.rows[0].layers == {}
    assert "ring" in found.rows[0].lacking["gfm"]
    assert set(row_of(table, "long").layers) == {"gfm"}
    with pytest.raises(InputError, match="stands inside a wall"):
        compare_scanners(hall, [outrigger], spacing=SPACING, pairs=0, store=False)


def test_a_layer_is_its_mean_over_the_floor_that_counts(hall, scanners, table):
    amap = build_map(hall, scanners["long"], SPACING, layers="gfm", store=False)
    row = row_of(table, "long")
    values = amap.dataset["gfm"].values[row.parts.counted]
    assert row.layers["gfm"].mean == pytest.approx(float(values.astype(float).mean()))


def test_stretches_are_those_of_the_corridor(scanners, routes, table):
    # A laser of 1.5 m sees the walls of the corridor, and none of the hall from its middle.
    figures = row_of(table, "short").routes
    assert figures is not None
    assert figures.metres == pytest.approx(
        math.dist((1, 1), (7.2, 2.25)) + 9.3 + math.dist((3, 4.5), (6.5, 0.5))
    )
    assert 6.0 < figures.floor.longest_corridor < 9.3
    assert 0.5 < figures.floor.longest_open < math.dist((1, 1), (7.2, 2.25))
    long = row_of(table, "long").routes
    assert long is not None and long.floor.longest_open == 0.0
    assert long.mean_error < figures.mean_error


def test_the_expected_error_is_odometry_and_fisher_information_step_by_step(hall, scanners):
    model = ErrorModel(odometry=OdometryNoise(scale=0.5), beams=20)
    route = Route.through([(1.0, 1.0), (7.2, 2.25), (16.5, 2.25)])
    for name in ("short", "ahead"):
        scanner = scanners[name]
        errors, along = expected_errors(hall, scanner, route, model)
        thinned = scanner.thinned(20)
        legs = [(route.poses[0], route.poses[1]), (route.poses[1], route.poses[2])]
        poses = [legs[0][0]]
        for a, b in legs:
            count = math.ceil(math.dist(a[:2], b[:2]) / 0.25 - 1e-9)
            heading = math.atan2(b[1] - a[1], b[0] - a[0])
            for k in range(1, count + 1):
                poses.append(np.array([*(a[:2] + (b[:2] - a[:2]) * k / count), heading]))
        covariance, expected = np.diag([0.05**2, 0.05**2, 0.02**2]), []
        odometry = model.odometry.modelled
        for k, pose in enumerate(poses):
            if k:
                covariance = odometry.covariances(
                    poses[k - 1], covariance, poses[k - 1], pose
                )[0]  # fmt: skip
            covariance = expected_covariance(
                hall, pose, source="fisher", scanner=thinned, prior=covariance
            )[0]
            expected.append(math.sqrt(covariance[0, 0] + covariance[1, 1]))
        assert len(poses) == len(errors)
        assert errors == pytest.approx(expected, rel=1e-6)
        gone = np.cumsum([0.0, *(math.dist(a[:2], b[:2]) for a, b in pairwise(poses))])
        assert along == pytest.approx(gone)


def test_where_nothing_is_in_range_the_error_is_that_of_dead_reckoning(scanners):
    field = environment_from_shapes([shapely.box(-20, -20, 40, 20)], name="field")
    model = ErrorModel(odometry=OdometryNoise(scale=1.0), start_std=(1e-9, 1e-9, 1e-9))
    route = Route.through([(0.0, 0.0), (10.0, 0.0)])
    errors, along = expected_errors(field, scanners["short"], route, model)
    # Of `ambinav.drive.noise`: along alpha3 d L, across 2/3 alpha2 d L^3, here in steps of d.
    d, alpha, n = 0.25, 0.2, round(10.0 / 0.25)
    along_path = alpha * d * 10.0
    # In steps: sum over k of the heading's errors times what is left to drive.
    across = sum(alpha * d * d * ((d * (n - k)) ** 2 + (d * (n - k - 1)) ** 2) for k in range(n))
    assert along[-1] == pytest.approx(10.0)
    assert errors[-1] == pytest.approx(math.sqrt(along_path + across), rel=1e-6)
    assert across == pytest.approx(2.0 / 3.0 * alpha * d * 10.0**3, rel=0.05)


def test_sampled_routes_are_those_of_the_seed(hall, sampled):
    expected = sample_routes(hall, find_reach(hall, 0.2), 3, np.random.default_rng(5))
    assert all(
        np.array_equal(a.poses, b.poses) for a, b in zip(sampled.routes, expected, strict=True)
    )


def test_maps_come_from_the_store(hall, scanners, tmp_path, computes, monkeypatch):
    monkeypatch.setenv("AMBINAV_CACHE", str(tmp_path))
    said: list[str] = []
    store = MapStore(tmp_path / "maps", before_build=lambda: said.append("build"))
    short = {"spacing": SPACING, "pairs": 0, "store": store}
    first = compare_scanners(hall, [scanners["long"]], **short)
    again = compare_scanners(hall, [scanners["long"], scanners["short"]], **short)
    assert len(computes) == 2 == len(said)
    times = {row.name: row.build_seconds for row in again.rows}
    assert first.rows[0].build_seconds > 0.0
    assert times["long"] is None and times["short"] > 0.0
    assert row_of(again, "long").shares == first.rows[0].shares


def test_progress_rises_to_one(hall, scanners):
    shares: list[float] = []
    both = [scanners["long"], scanners["short"]]
    compare_scanners(hall, both, spacing=0.5, pairs=1, store=False, progress=shares.append)
    assert shares == sorted(shares) and shares[-1] == pytest.approx(1.0) and shares[0] < 0.5


def test_unexplored_floor_is_no_bad_floor_and_no_scanner_wins_by_it(scanners):
    # A court that the map ends in: the long range meets the end, the short one meets nothing.
    room, court = shapely.box(0, 0, 4, 4), shapely.box(4, 0, 8, 4)
    env = environment_from_shapes(
        [room, court], openings=[[(4.5, 4), (8, 4), (8, 0), (4.5, 0)]], name="court"
    )
    table = compare_scanners(
        env, [scanners["long"], scanners["short"]], spacing=SPACING, pairs=0, store=False
    )
    long, short = row_of(table, "long"), row_of(table, "short")
    assert long.counted_area < short.counted_area
    assert "The floor that counts differs" in table.remarks[-1]
    common = long.parts.counted & short.parts.counted
    assert np.array_equal(table.common, common)
    for row in (long, short):
        bad = (row.zone == 2) | (row.zone == 3)
        assert table.common_bad_area(row) == pytest.approx((common & bad).sum() * SPACING**2)


def test_bad_arguments_are_refused(hall, scanners, routes):
    long = scanners["long"]
    with pytest.raises(InputError, match="scanners: none is given"):
        compare_scanners(hall, [])
    with pytest.raises(InputError, match="'long': two different scanners have this name"):
        distinct([long, replace(scanners["short"], name="long")])
    with pytest.raises(InputError, match="rplidar-a11"):
        distinct(["rplidar-a11"])
    with pytest.raises(InputError, match=r"layers: .*fischer"):
        compare_scanners(hall, [long], layers=["fischer"])
    with pytest.raises(InputError, match="pairs: -1 is negative"):
        compare_scanners(hall, [long], pairs=-1)
    with pytest.raises(InputError, match=r"radius is 0\.1 m and spacing 0\.25 m"):
        compare_scanners(hall, [long], spacing=0.25, radius=0.1, pairs=0, store=False)
    with pytest.raises(InputError, match=r"route 0\.csv: at .* of radius 0\.8 m cannot stand"):
        compare_scanners(hall, [long], routes=routes, robot_radius=0.8)
    through = [("walls.csv", Route.through([(1.0, 1.0), (16.0, 2.0)]))]
    with pytest.raises(InputError, match=r"walls\.csv: at \(1\.00, 1\.00\) m .* cannot drive on"):
        compare_scanners(hall, [long], routes=through)
    still = [("still.csv", Route.through([(1.0, 1.0), (1.0, 1.0)]))]
    with pytest.raises(InputError, match=r"still\.csv: the route has no length"):
        compare_scanners(hall, [long], routes=still)
    with pytest.raises(InputError, match="routes: none is given"):
        compare_scanners(hall, [long], routes=[])
    with pytest.raises(InputError, match="none of the scanners that are compared is listed"):
        compare_scanners(hall, [long], costs=Costs({"x": Cost(price=1.0)}))
    with pytest.raises(InputError, match="beams of the localizer: 0 is too few"):
        ErrorModel(beams=0)
    with pytest.raises(InputError, match="odometry: distance is 0"):
        ErrorModel(odometry=OdometryNoise(distance=0.0))
