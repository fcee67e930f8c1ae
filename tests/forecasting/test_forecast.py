"""Forecasts of routes through a building whose good and bad floor is known."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.drive.localizer_spec import chosen_localizer, suited
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.odometries import ODOMETRIES
from ambinav.drive.robot import Robot
from ambinav.forecasting.causes import DRIFT, OPEN, SLIDING
from ambinav.forecasting.ensemble import LostRule
from ambinav.forecasting.forecast import Forecaster, forecast, in_words, sampled
from ambinav.forecasting.localizer_class import LocalizerClass, class_of, localizer_classes
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.sensing.scanner import RangeScanner
from tests.geometry.scenes import environment

ROOMS = Route.through([[8.5, 8.0], [8.5, 10.4], [28.0, 10.6]])
"""Past furniture and doors."""
HALL = Route.through([[9.0, 16.0], [14.5, 21.0], [20.5, 21.0]])
"""Through the middle of the hall, where no wall is in range."""


def test_hall_loses_robots_and_rooms_do_not(demo_map: AmbiguityMap) -> None:
    forecaster = Forecaster(demo_map, "poor")
    rooms, hall = forecaster(ROOMS), forecaster(HALL)
    assert rooms.lost_probability < 0.01 < 0.2 < hall.lost_probability
    assert rooms.expected_error.max() < 0.2
    worst = hall.causes[0]
    assert worst.kind == OPEN
    assert 10.0 < worst.x < 20.0
    assert 17.0 < worst.y < 24.0
    assert "nothing in range" in hall.sentence
    assert rooms.sentence == "fewer than 1 in 1000 robots get lost on this route."


def test_localizable_floor_is_not_called_open(demo_map: AmbiguityMap) -> None:
    strict = forecast(demo_map, ROOMS, odometry="poor", lateral_limit=0.1)
    causes = (*strict.causes, *forecast(demo_map, HALL, odometry="poor", localizer="amcl").causes)
    zones = [demo_map.sample("zone", cause.x, cause.y) for cause in causes]
    kinds = [(cause.kind, zone == 0) for cause, zone in zip(causes, zones, strict=True)]
    assert (DRIFT, True) in kinds
    assert (OPEN, False) in kinds
    assert set(kinds) <= {(DRIFT, True), (OPEN, False), (SLIDING, False)}
    assert "though scans tell the position" in strict.sentence


def test_curve_never_falls_and_ends_at_the_probability(demo_map: AmbiguityMap) -> None:
    result = an.forecast(demo_map, HALL, odometry="poor", localizer="product")
    assert (np.diff(result.lost) >= 0.0).all()
    assert result.lost[0] == 0.0
    assert result.lost[-1] == result.lost_probability
    assert result.distance[-1] == pytest.approx(math.hypot(5.5, 5.0) + 6.0)
    assert np.linalg.eigvalsh(result.covariance).min() > 0.0
    assert sum(cause.probability for cause in result.causes) <= result.lost_probability + 1e-9


@pytest.mark.slow
def test_worse_odometry_loses_more(demo_map: AmbiguityMap) -> None:
    shares = [
        forecast(demo_map, HALL, ODOMETRIES[name]).lost_probability
        for name in ("good", "mediocre", "poor", "amcl-default")
    ]
    assert shares == sorted(shares)
    assert 2.0 * shares[0] < shares[-1] > 0.8


def test_many_routes_at_once_are_the_same(demo_map: AmbiguityMap) -> None:
    forecaster = Forecaster(demo_map, "poor")
    shares = forecaster.lost_probabilities([HALL, ROOMS, HALL])
    assert shares.tolist() == [forecaster(route).lost_probability for route in (HALL, ROOMS, HALL)]
    assert forecaster.lost_probabilities([]).shape == (0,)


def test_information_near_the_routes_is_enough(demo_map: AmbiguityMap) -> None:
    routes = [HALL, ROOMS]
    near, everywhere = Forecaster(demo_map, "poor", routes=routes), Forecaster(demo_map, "poor")
    assert np.array_equal(near.lost_probabilities(routes), everywhere.lost_probabilities(routes))
    fields = [forecaster.field for forecaster in (near, everywhere)]
    same = np.equal(*(field.entries[field.nearest] for field in fields))
    assert 0.02 < same[..., 0].mean() < 0.9
    assert 0.02 < same[..., 5].mean() < 0.9
    assert len(fields[0].entries) < 0.1 * len(fields[1].entries)


@pytest.mark.slow
def test_information_at_the_headings_of_the_routes_is_enough() -> None:
    """On a map with headings, for routes that bend and turn on the spot."""
    sensor = an.RangeSensor(max_range=6.0, std=0.03, resolution=0.01)
    fan = an.RangeScanner.planar(sensor, 30, math.radians(120.0))
    building = an.load_environment(an.DEMO_BUILDING)
    amap = an.build_map(building, fan, 0.4, headings=8, store=False)
    bent = Route.through(ROOMS.poses[:, :2], an.Steering("dubins", 0.5))
    routes = [HALL, ROOMS, bent]
    near, everywhere = Forecaster(amap, "poor", routes=routes), Forecaster(amap, "poor")
    assert np.array_equal(near.lost_probabilities(routes), everywhere.lost_probabilities(routes))
    assert len(near.field.entries) < 0.1 * len(everywhere.field.entries)
    # Elsewhere it knows nothing, and says so.
    back = Route.through(HALL.poses[::-1, :2])
    for ask in (near, lambda route: near.lost_probabilities([route])):
        with pytest.raises(InputError, match="none of the routes that this Forecaster"):
            ask(back)


@pytest.mark.parametrize("routes", [HALL, [None], "hall", 3])
def test_what_is_no_list_of_routes(demo_map: AmbiguityMap, routes: object) -> None:
    with pytest.raises(InputError, match=r"give a list of routes|a route is"):
        Forecaster(demo_map).lost_probabilities(routes)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"give a list of routes|a route is"):
        Forecaster(demo_map, routes=routes)  # type: ignore[arg-type]


@pytest.mark.slow
def test_limits_and_start_count(demo_map: AmbiguityMap) -> None:
    def share(**more: float | tuple[float, float, float]) -> float:
        return forecast(demo_map, HALL, "poor", **more).lost_probability  # type: ignore[arg-type]

    assert share(position_limit=1.2, heading_limit=1.0) < share() < share(position_limit=0.3)
    assert share() < share(start_std=(0.3, 0.3, 0.2))
    # Autoware's monitor: 1.2 m along the lane, 0.3 m across it.
    lanes = share(position_limit=1.2, lateral_limit=0.3)
    assert share(position_limit=1.2) < lanes < share(position_limit=0.3)


@pytest.mark.slow(kept=("mediocre",))
@pytest.mark.parametrize("odometry", ["mediocre", "poor"])
def test_driven_robots_are_lost_by_the_same_limits(demo_map: AmbiguityMap, odometry: str) -> None:
    """Forecasts are near the interval of 64 drives, and wider limits lose fewer."""
    limits = {"position_limit": 1.2, "lateral_limit": 0.3}
    forecaster = Forecaster(demo_map, odometry, **limits)  # type: ignore[arg-type]
    runner = forecaster.runner()
    for route in (ROOMS, HALL):
        driven = runner.drive(route, np.random.default_rng(1), 64).probability
        assert driven.low - 0.15 < forecaster(route).lost_probability < driven.high + 0.15
    along = runner.drive(HALL, np.random.default_rng(1), 64, lost=LostRule(1.2, lateral=9.0))
    both = runner.drive(HALL, np.random.default_rng(1), 64, lost=LostRule(1.2))
    assert (
        along.lost.sum()
        <= both.lost.sum()
        < runner.drive(HALL, np.random.default_rng(1), 64).lost.sum()
    )


def test_samples_are_an_update_apart() -> None:
    route = Route.through([[0.0, 0.0], [2.0, 0.0], [2.0, 1.1]])
    poses, along = sampled(route, 0.25, 0.2)
    assert poses[0].tolist() == [0.0, 0.0, 0.0]
    assert poses[-1] == pytest.approx([2.0, 1.1, math.pi / 2.0])
    steps = np.diff(along)
    # A turn on the spot is a step of no length.
    assert sorted(set(np.round(steps, 2).tolist())) == [0.0, 0.1, 0.25]
    alone, _ = sampled(Route.through([[0.0, 0.0], [0.1, 0.0]]), 0.25, 0.2)
    assert alone[:, 0].tolist() == [0.0, 0.1]


@pytest.mark.parametrize(
    ("probability", "words"),
    [
        (0.0, "fewer than 1 in 1000 robots get"),
        (0.004, "about 1 in 250 robots gets"),
        (0.05, "about 1 in 20 robots gets"),
        (0.29, "about 1 in 3 robots gets"),
        (0.5, "about half of the robots get"),
        (0.7, "about 7 in 10 robots get"),
        (0.95, "nearly all robots get"),
        (0.99, "nearly all robots get"),
    ],
)
def test_words(probability: float, words: str) -> None:
    assert in_words(probability) == words


def test_words_grow_with_the_probability() -> None:
    def share(words: str) -> float:
        if "half" in words:
            return 0.5
        first, second = re.search(r"(\d+) in (\d+)", words).groups()  # type: ignore[union-attr]
        return int(first) / int(second)

    said = [share(in_words(p)) for p in np.linspace(0.002, 0.94, 800)]
    assert (np.diff(said) >= 0.0).all()


def test_classes_are_calibrated() -> None:
    assert "product" in localizer_classes()
    for name in localizer_classes():
        entry = LocalizerClass.load(name)
        assert entry.name == name
        assert "commit" in entry.made
        assert "skill" in entry.made
        raw = np.array([0.0, 0.01, 0.2, 0.7, 1.0])
        calibrated = entry.calibrated(raw)
        assert calibrated[0] == 0.0
        assert (np.diff(calibrated) > 0.0).all()
        assert calibrated[-1] <= 1.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"odometry": "wheels"}, "odometry is 'wheels'; "),
        ({"localizer": "gps"}, "localizer is 'gps', which has no calibration; "),
        ({"position_limit": 0.0}, "position_limit is 0.0; "),
        ({"lateral_limit": math.nan}, "lateral_limit is nan; "),
        ({"heading_limit": -1.0}, "heading_limit is -1.0; "),
        ({"start_std": (0.1, 0.1)}, r"start_std is \(0.1, 0.1\); "),
    ],
)
def test_bad_arguments(demo_map: AmbiguityMap, arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Forecaster(demo_map, **arguments)  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_class_without_skill_names_no_cause(demo_map: AmbiguityMap, tmp_path: Path) -> None:
    plain = LocalizerClass.load("product")
    assert plain.skill is not None and plain.has_skill
    replace(plain, skill=(-11.98, 0.11)).to_yaml(tmp_path / "dead.yaml")
    dead = LocalizerClass.load(tmp_path / "dead.yaml")
    assert dead.skill == (-11.98, 0.11) and not dead.has_skill
    with pytest.warns(InputWarning, match=r"no better than their mean .* -11.98 to 0.11 in"):
        forecast = Forecaster(demo_map, localizer=dead)(HALL)
    known = Forecaster(demo_map)(HALL)
    np.testing.assert_array_equal(forecast.lost, known.lost)
    assert forecast.causes == () and replace(known, localizer=plain).causes == known.causes


def test_the_file_of_a_localizer_is_no_class(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("type: program\ncommand: [python, mine.py]\n")
    with pytest.raises(InputError, match="make a class of it with `ambinav calibrate localizer`"):
        LocalizerClass.load(path)


def test_routes_of_another_map(demo_map: AmbiguityMap) -> None:
    forecaster = Forecaster(demo_map)
    far = Route.through([[100.0, 100.0], [120.0, 100.0]])
    for ask in (forecaster, lambda route: forecaster.lost_probabilities([HALL, route])):
        with pytest.raises(InputError, match=r"route: \(100.0, 100.0\) m and .* the map that"):
            ask(far)
        # Its samples would fill any memory.
        with pytest.raises(InputError, match=r"route: \(1, 1e\+09\) m is far from the floor"):
            ask(Route.through([[1.0, 1.0], [1.0, 1e9]]))


@pytest.mark.slow
def test_a_route_close_to_a_wall_is_on_the_floor() -> None:
    """Along a slanted wall it passes cells whose centre lies behind the wall."""
    room = environment(shapely.Polygon([(0.0, 0.0), (10.0, 0.0), (10.0, 6.0), (0.0, 3.0)]))
    scanner = RangeScanner.from_preset("turtlebot3-lds")
    amap = an.build_map(room, scanner, spacing=0.25)
    along = Route.through([[0.2, 3.0], [9.8, 5.88]])
    x, y = along.steering.dense(along.poses, 0.05)[0][:, :2].T
    assert (amap.sample("free", x, y) < 0.5).mean() > 0.2
    assert Forecaster(amap)(along).lost_probability < 0.05


@pytest.mark.slow
def test_ensembles_are_of_the_class(demo_map: AmbiguityMap) -> None:
    """Lasers have the likelihood field multiplied, cones what suits them."""
    forecaster = Forecaster(demo_map, "poor")
    robot = Robot(radius=0.1)
    driven = forecaster.runner(robot).drive(HALL, np.random.default_rng(1), 32)
    assert min(driven.probability.value, forecaster(HALL).lost_probability) > 0.8
    exact = (0.005, 0.005, 0.005)
    strict = Forecaster(demo_map, "poor", position_limit=0.01, heading_limit=0.01, start_std=exact)
    assert strict.runner().drive(HALL, np.random.default_rng(1), 4).probability.value == 1.0
    product = forecaster.localizer
    for preset, model in (("rplidar-a1", "likelihood_field_prob"), ("hc-sr04", "beam_prob")):
        scanner = RangeScanner.from_preset(preset)
        chosen = product.chosen(scanner, forecaster.odometry, robot)
        assert chosen.parameters.laser_model_type == model
        assert chosen.parameters.alpha1 == forecaster.odometry.modelled.alpha1
        found = class_of(chosen, scanner, forecaster.odometry, robot, 10.0)
        assert found is not None
        assert found.name == "product"
    with pytest.raises(InputError, match="localizer"):
        replace(product, localizer="gps").chosen(scanner, forecaster.odometry)


@pytest.mark.parametrize(
    ("preset", "localizer", "name"),
    [
        ("rplidar-a1", "amcl", "amcl"),
        ("rplidar-a1", "mcl", "amcl"),
        ("rplidar-a1", "ekf", None),
        ("hc-sr04", "mcl", "product"),
        ("hc-sr04", "amcl", None),
    ],
)
def test_class_of_a_localizer(preset: str, localizer: str, name: str | None) -> None:
    scanner, odometry = RangeScanner.from_preset(preset), ODOMETRIES["poor"]
    motion = odometry, Robot(), 10.0
    chosen = chosen_localizer(suited(localizer, scanner), *motion)
    entry = class_of(chosen, scanner, *motion)
    assert (None if entry is None else entry.name) == name


@pytest.mark.slow
def test_a_class_that_cannot_use_the_scanner() -> None:
    scanner = RangeScanner.from_preset("hc-sr04")
    sonar_map = an.build_map(an.load_environment(an.DEMO_BUILDING), scanner, spacing=0.5)
    with pytest.warns(InputWarning, match="localizer 'amcl' was not calibrated for this: .* cones"):
        Forecaster(sonar_map, localizer="amcl", routes=[ROOMS])


def test_raw_shares_are_those_that_were_calibrated() -> None:
    product = LocalizerClass.load("product")
    for share in (1e-4, 0.05, 0.9):
        assert product.calibrated(np.array(product.raw(share))) == pytest.approx(share)
    flat = LocalizerClass(name="flat", title="tells nothing", gain=0.1, slope=0.005, offset=1.0)
    assert flat.raw(0.05) == 0.0
    assert flat.raw(0.999) == 1.0


def test_class_from_a_file(demo_map: AmbiguityMap, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("name: mine\ntitle: our own filter\ngain: 0.3\noffset: 0.5\n")
    ours = forecast(demo_map, HALL, OdometryNoise(scale=0.5), str(path))
    assert ours.localizer.title == "our own filter"
    for text, message in (
        ("name: mine\ntitle: x\ngain: 0\n", "gain"),
        ("name: mine\ntitle: x\ngane: 1\n", "gane"),
        ("- 1\n", "mapping"),
        ("name: x\ntitle: x\ngain: 1\nlocalizer: {type: amcl, foo: 1}\n", "mine.yaml: .*'foo'"),
        ("name: x\ntitle: x\ngain: 1\nlocalizer: nosuch\n", "mine.yaml: .*'nosuch'"),
        ("name: x\ntitle: x\ngain: 1\notherwise: {type: 3}\n", "mine.yaml: .*3"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            LocalizerClass.load(path)
    with pytest.raises(InputError, match=r"nothing\.yaml"):
        LocalizerClass.load("nothing.yaml")


@pytest.mark.slow
def test_what_a_forecast_cannot_know_is_said(demo_map: AmbiguityMap) -> None:
    forecaster = Forecaster(demo_map)
    with pytest.warns(InputWarning, match=r"crosses walls of .*, first near \(10\.\d, 10\.0\) m"):
        forecaster(Route.through([[8.5, 8.0], [8.5, 10.0], [28.0, 10.4]]))
    loop = an.Steering("dubins", 1e7)
    with pytest.raises(InputError, match=r"step is 0\.\d+ m on a route of 7\.\d+e\+07 m"):
        forecaster(Route.through([[14.5, 20.0, 0.0], [14.5, 19.0, 3.0]], loop))
    for changed, limit in (
        ({"start_std": (5.0, 0.1, 0.02)}, "position_limit is 0.5 m, below the deviation of 5 m"),
        ({"start_std": (0.1, 0.1, 1.0)}, r"heading_limit is 0.524 rad \(30 degrees\), below"),
        ({"lateral_limit": 0.03}, "lateral_limit is 0.03 m, below the deviation of 0.05 m"),
    ):
        with pytest.raises(InputError, match=limit):
            Forecaster(demo_map, **changed)
    still = Route.through([[14.5, 20.0], [14.5, 20.0]])
    assert forecaster(still).lost_probability < 0.01
