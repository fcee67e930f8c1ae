"""Routes on disk: what comes back, what others read in them, and what is said of bad files."""

from __future__ import annotations

import json
import math
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ambinav.export.registry import EXPORTERS, Exporter
from ambinav.geometry.motion.steering import Steering
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.routes.clock import SpeedLimits
from ambinav.routes.evaluate import evaluate_route
from ambinav.routes.files import load_route, save_route
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from tests.maps import synthetic

STEERINGS = (
    Steering("r2"), Steering("se2"), Steering("dubins", 0.4), Steering("reeds-shepp", 0.4)
)  # fmt: skip

FORMATS = (".csv", ".geojson", ".json")
number = st.floats(0.6, 3.4)
pose = st.tuples(number, number, st.floats(-10.0, 10.0))


@pytest.fixture(scope="module")
def service() -> AmbiguityService:
    return AmbiguityService(AmbiguityMap(synthetic.dataset(headings=4)), weight=2.5)


@pytest.fixture(scope="module")
def route(service):
    return evaluate_route(
        service,
        [(1.0, 1.0, 0.0), (3.0, 1.1, 0.7), (3.0, 3.0, 2.0)],
        Steering("reeds-shepp", 0.4),
        planner='a "name", with: all\nkinds of #signs ÅΩ\u2028',
        seed=7,
        seconds=0.25,
        first_seconds=0.01,
        iterations=120,
        curve=[(0.01, 9.0), (0.2, 1 / 3)],
        covariances=np.array([np.diag([0.1, 0.2, i / 7]) + 0.01 for i in range(3)]),
    )


def assert_same(a, b):
    for field in fields(a):
        one, other = getattr(a, field.name), getattr(b, field.name)
        if isinstance(one, np.ndarray):
            assert one.dtype == other.dtype, field.name
            np.testing.assert_array_equal(one, other, err_msg=field.name)
        else:
            assert one == other, field.name


@pytest.mark.parametrize("ending", FORMATS)
def test_everything_comes_back(route, tmp_path, ending):
    path = tmp_path / f"route{ending}"
    save_route(route, path)
    assert_same(load_route(path), route)


@pytest.mark.slow
@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    poses=st.lists(pose, min_size=2, max_size=6),
    steering=st.sampled_from(STEERINGS),
    ending=st.sampled_from(FORMATS),
)
def test_any_route_comes_back_exactly(service, tmp_path, poses, steering, ending):
    route = evaluate_route(service, poses, steering, planner="random")
    path = tmp_path / f"any{ending}"
    save_route(route, path)
    assert_same(load_route(path), route)


def test_csv_is_a_plain_table(route, tmp_path):
    save_route(route, tmp_path / "a.csv")
    lines = (tmp_path / "a.csv").read_text(encoding="utf-8").rstrip().split("\n")
    table = [line.split(",") for line in lines if not line.startswith("#")]
    assert table[0][:7] == ["x", "y", "theta", "distance", "cost", "level", "zone"]
    assert [row[6] for row in table[1:]] == ["localizable"] * 3
    assert table[0][7] == "stamp" and table[-1][7] == repr(route.duration)
    assert np.array([row[:3] for row in table[1:]], dtype=float).tolist() == route.poses.tolist()
    assert f"# length_m: {route.length!r}" in lines
    plain = np.genfromtxt(tmp_path / "a.csv", delimiter=",", usecols=(0, 1, 2), skip_header=32)
    assert plain.shape == (3, 3)


def test_geojson_draws_curves_as_curves(route, tmp_path):
    save_route(route, tmp_path / "a.geojson")
    feature = json.loads((tmp_path / "a.geojson").read_text())
    assert (feature["type"], feature["geometry"]["type"]) == ("Feature", "LineString")
    line = np.array(feature["geometry"]["coordinates"])
    assert line.shape[1] == 2
    steps = np.hypot(*np.diff(line, axis=0).T)
    assert steps.min() > 0.0 and steps.max() < 0.0501
    assert steps.sum() == pytest.approx(route.length, rel=1e-3)
    assert feature["properties"]["length_m"] == route.length
    for x, y, _ in route.poses:
        assert np.hypot(*(line - (x, y)).T).min() < 1e-9


@pytest.mark.parametrize("steering", STEERINGS, ids=lambda steering: steering.space)
def test_a_path_message_is_stamped(service, tmp_path, steering):
    limits = SpeedLimits(max_speed=0.3, lateral_acceleration=0.1)
    poses = [(0.8, 0.8, 0.1), (3.0, 1.0, 0.2), (3.2, 3.2, 2.5), (1.0, 3.0, 3.0)]
    route = evaluate_route(service, poses, steering, planner="by hand")
    route = route.timed(limits, stops=[2], bound=[[0.0, 0.25], [2.0, 0.1]])
    save_route(route, tmp_path / "a.json")
    read = load_route(tmp_path / "a.json")
    assert_same(read, route)
    save_route(read, tmp_path / "b.json")
    assert (tmp_path / "a.json").read_text() == (tmp_path / "b.json").read_text()
    message = json.loads((tmp_path / "a.json").read_text())
    headers = [pose["header"]["stamp"] for pose in message["poses"]]
    assert all(0 <= stamp["nanosec"] < 10**9 for stamp in headers)
    seconds = np.array([stamp["sec"] + 1e-9 * stamp["nanosec"] for stamp in headers])
    assert seconds[0] == 0.0 and seconds[-1] == pytest.approx(route.duration, abs=1e-9)
    places = [list(pose["pose"]["position"].values())[:2] for pose in message["poses"]]
    speed = np.hypot(*np.diff(places, axis=0).T) / np.diff(seconds)
    assert speed.max() <= 0.25 + 1e-6
    if steering.turns:
        # Curves are shown by dense points: it stops at the ends and at the third pose.
        stop = np.hypot(*(np.array(places) - route.poses[2, :2]).T).argmin()
        assert max(speed[0], speed[-1], speed[stop - 1], speed[stop]) < 0.6 * speed.max()


def test_stamps_for_all_or_none_and_rising(route, tmp_path):
    path = tmp_path / "a.json"
    save_route(route, path)
    text = path.read_text()
    for change, message in (
        ({}, "only 2 of 3 poses have a stamp"),
        ({"stamp": 1e-3}, "stamp of pose 2 is 0.001 s"),
        ({"stamp": -1}, "stamp is -1"),
    ):
        saved = json.loads(text)
        del saved["ambinav"]["poses"][2]["stamp"]
        saved["ambinav"]["poses"][2] |= change
        path.write_text(json.dumps(saved))
        with pytest.raises(InputError, match=message):
            load_route(path)
    for pose in saved["ambinav"]["poses"]:
        pose.pop("stamp")
    del saved["ambinav"]["speed_limits"], saved["ambinav"]["duration_s"]
    path.write_text(json.dumps(saved))
    unstamped = load_route(path)
    assert unstamped.stamps is None and unstamped.speed_limits is None
    saved["ambinav"]["speed_limits"] = {"max_speed": -1.0}
    path.write_text(json.dumps(saved))
    with pytest.raises(InputError, match=r"max_speed is -1.* above 0"):
        load_route(path)


def test_json_reads_as_a_path_message(service, tmp_path):
    poses = [(1.0, 1.0, 0.5), (3.0, 1.0, -2.0)]
    route = evaluate_route(service, poses, Steering("se2"), planner="by hand")
    save_route(route, tmp_path / "a.json")
    message = json.loads((tmp_path / "a.json").read_text())
    assert message["header"]["frame_id"] == "map"
    assert len(message["poses"]) == 2
    for stamped, (x, y, theta) in zip(message["poses"], poses, strict=True):
        assert stamped["header"]["frame_id"] == "map"
        place, turn = stamped["pose"]["position"], stamped["pose"]["orientation"]
        assert (place["x"], place["y"], place["z"]) == (x, y, 0.0)
        assert turn["x"] ** 2 + turn["y"] ** 2 + turn["z"] ** 2 + turn["w"] ** 2 == pytest.approx(1)
        assert 2 * math.atan2(turn["z"], turn["w"]) == pytest.approx(theta)


def test_other_endings_are_refused_before_anything_is_written(route, tmp_path):
    with pytest.raises(InputError, match=r"route\.txt.*\.txt.*\.csv, \.geojson, \.json"):
        save_route(route, tmp_path / "route.txt")
    with pytest.raises(InputError, match=r"\.txt"):
        load_route(tmp_path / "route.txt")
    with pytest.raises(InputError, match="cannot be read"):
        load_route(tmp_path / "none.csv")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('# planner: "by hand"\n', "", r"'planner' is missing"),
        ("# seed: null", "# seed: soon", r"line 3: '# seed: soon' is not a figure"),
        ("# seed: null", '# seed: "soon"', r"seed is 'soon'; it should be a valid integer"),
        ("# weight: 2.5", "# weight: -1", r"weight is -1; give a number of at least 0"),
        ("# weight: 2.5", "# weight: NaN", r"weight is nan; give a number of at least 0"),
        ("# weight: 2.5", "# weigth: 2.5", r"'wei\w+' is"),
        ('# space: "r2"', '# space: "r3"', r"space is 'r3'"),
        ("ambinav-route/1", "ambinav-route/9", "format is 'ambinav-route/9'"),
        ("x,y,theta", "x,y,phi", r"line 32: the columns are x, y, phi"),
        ("3.0,1.0,0.0,2.0", "3.0,one,0.0,2.0", "line 34: y is 'one'; give a finite number"),
        ("3.0,1.0,0.0,2.0", "3.0,inf,0.0,2.0", "line 34: y is 'inf'; give a finite"),
        ("3.0,1.0,0.0,2.0", "3.0,1.0,2.0", r"line 34: it has 7 values and the table 8"),
        (",localizable,", ",fine,", "line 33: zone is 'fine'; it should be 'localizable'"),
    ],
)
def test_bad_csv_is_named_by_line_and_value(service, tmp_path, old, new, message):
    route = evaluate_route(
        service, [(1.0, 1.0, 0.0), (3.0, 1.0, 0.0)], Steering(), planner="by hand"
    )
    path = tmp_path / "bad.csv"
    save_route(route, path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=message) as caught:
        load_route(path)
    sentence = str(caught.value)
    assert sentence.startswith(str(path)) and sentence.endswith(".") and "\n" not in sentence


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.csv", "", "no table of poses"),
        ("a.csv", "x,y,theta,distance,cost,level,zone\n", "'planner' is missing"),
        ("a.json", "{", "line 1: not valid JSON"),
        ("a.json", "[1, 2]", r"ambinav\.poses is missing"),
        ("a.json", '{"poses": []}', r"ambinav\.poses is missing"),
        ("a.geojson", '{"type": "Feature", "properties": null}', r"properties\.poses is missing"),
        ("a.json", '{"ambinav": {"poses": [{"x": 1}]}}', r"ambinav\.poses\[0\]: .*'y' is missing"),
        ("a.json", "[" * 100_000, "nested too deeply"),
    ],
)
def test_files_that_are_no_routes(tmp_path, name, text, message):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        load_route(path)


def test_covariances_for_all_or_none(route, tmp_path):
    path = tmp_path / "a.json"
    save_route(route, path)
    whole = json.loads(path.read_text())
    del whole["ambinav"]["poses"][1]["covariance"]
    path.write_text(json.dumps(whole))
    with pytest.raises(InputError, match="only 2 of 3 poses have a covariance"):
        load_route(path)
    whole["ambinav"]["poses"] = whole["ambinav"]["poses"][:1]
    path.write_text(json.dumps(whole))
    with pytest.raises(InputError, match="it has 1 of the poses"):
        load_route(path)


def test_a_route_that_nobody_measured(service, tmp_path):
    bare = Route.through([(1.0, 1.0), (3.0, 1.0), (3.0, 3.0)], planner="survey")
    assert bare.poses[:, 2].tolist() == [0.0, math.pi / 2, math.pi / 2]
    assert math.isnan(bare.cost) and bare.start[:2] == (1.0, 1.0)
    for suffix in (".csv", ".geojson", ".json"):
        with pytest.raises(InputError, match="not measured"):
            save_route(bare, tmp_path / f"bare{suffix}")
    assert not list(tmp_path.iterdir())
    measured = evaluate_route(service, bare.poses, bare.steering, planner=bare.planner)
    save_route(measured, tmp_path / "bare.csv")
    assert load_route(tmp_path / "bare.csv").length == pytest.approx(4.0)


@pytest.mark.parametrize("points", [[(0.0, 0.0)], [(0.0, math.nan), (1.0, 1.0)], [(0.0,), (1.0,)]])
def test_points_that_make_no_route(points):
    with pytest.raises(InputError, match="poses"):
        Route.through(points)


def test_a_format_that_is_only_written(tmp_path, monkeypatch):
    monkeypatch.setattr(EXPORTERS, "_registered", {})
    EXPORTERS.register(Exporter(subject="route", format="kml", title="", write=lambda *_: ()))
    with pytest.raises(
        InputError, match=r"only written as .kml; give one of .csv, .geojson, .json"
    ):
        load_route(tmp_path / "route.kml")
