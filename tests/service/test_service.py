"""Cost and reward: against dense numerical integration, and what a user may get wrong."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import ambinav as an
from ambinav.geometry.motion.steering import Steering
from ambinav.layers.build import with_layers
from ambinav.runtime.errors import InputError

DEMO = Path(__file__).parents[2] / "configs" / "demo.geojson"
LASER = an.RangeSensor(max_range=4.0, std=0.03, resolution=0.001)


@pytest.fixture(scope="module")
def env() -> an.Environment:
    return an.load_environment(DEMO)


@pytest.fixture(scope="module")
def plain(env: an.Environment) -> an.AmbiguityMap:
    scanner = an.RangeScanner.planar(sensor=LASER, beams=30, aperture=2 * math.pi)
    return an.build_map(env, scanner, spacing=0.25)


@pytest.fixture(scope="module")
def headed(env: an.Environment) -> an.AmbiguityMap:
    scanner = an.RangeScanner.planar(sensor=LASER, beams=15, aperture=math.pi)
    return an.build_map(env, scanner, spacing=0.5, headings=6)


def dense(
    service: an.AmbiguityService, a: NDArray[np.float64], b: NDArray[np.float64]
) -> tuple[float, bool]:
    """Integral of the cost by a fine trapezoid over single states; whether all of it is free."""
    t = np.linspace(0.0, 1.0, 20_001)
    turn = (b[2] - a[2] + math.pi) % (2 * math.pi) - math.pi
    pose = a + t[:, None] * np.array([b[0] - a[0], b[1] - a[1], turn])
    cost = np.asarray(service.cost(pose[:, 0], pose[:, 1], pose[:, 2]))
    length = math.hypot(b[0] - a[0], b[1] - a[1])
    return float(np.trapezoid(cost, t)) * length, bool(np.isfinite(cost).all())


@pytest.mark.slow
@pytest.mark.parametrize("which", ["plain", "headed"])
def test_a_motion_costs_the_integral_over_its_states(
    which: str, request: pytest.FixtureRequest
) -> None:
    service = an.AmbiguityService(request.getfixturevalue(which), weight=5.0)
    rng = np.random.default_rng(0)
    checked = 0
    for _ in range(150):
        a = np.array([*rng.uniform([0, 0], [44, 28]), rng.uniform(-7, 7)])
        b = a + np.array([*rng.uniform(-4, 4, 2), rng.uniform(-3, 3)])
        expected, free = dense(service, a, b)
        if free:
            got = service.motion_cost(a[0], a[1], b[0], b[1], a[2], b[2])
            assert got == pytest.approx(expected, rel=1e-5)
            checked += 1
    assert checked > 30


def test_an_even_field_costs_so_many_times_the_length(plain: an.AmbiguityMap) -> None:
    constant = plain.dataset.copy()
    constant["level"] = constant["level"] * 0 + 0.75
    service = an.AmbiguityService(an.AmbiguityMap(constant), weight=8.0)
    assert service.motion_cost(1.0, 2.0, 4.0, 6.0) == pytest.approx(7 * 5.0)
    assert service.reward(1.0, 2.0, 4.0, 6.0) == pytest.approx(-0.75 * 5.0)


@settings(max_examples=50, deadline=None)
@given(st.floats(0.0, 1.0), st.floats(0.0, 44.0), st.floats(0.0, 28.0), st.floats(0, 6.3))
def test_a_motion_may_be_cut_and_turned_round(
    plain: an.AmbiguityMap, cut: float, x: float, y: float, angle: float
) -> None:
    service = an.AmbiguityService(plain, weight=3.0)
    x1, y1 = x + 6 * math.cos(angle), y + 6 * math.sin(angle)
    xm, ym = x + cut * (x1 - x), y + cut * (y1 - y)
    whole = service.motion_cost(x, y, x1, y1)
    assert service.motion_cost(x1, y1, x, y) == pytest.approx(whole, rel=1e-6)
    parts = np.asarray(service.motion_cost([x, xm], [y, ym], [xm, x1], [ym, y1]))
    assert parts.sum() == pytest.approx(whole, rel=1e-6)
    assert whole >= 6.0 - 1e-9


def test_cost_is_at_least_one_in_free_space_and_infinite_elsewhere(plain: an.AmbiguityMap) -> None:
    service = an.AmbiguityService(plain, weight=5.0)
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-5, 50, 5000), rng.uniform(-5, 35, 5000)
    cost = np.asarray(service.cost(x, y))
    free = np.asarray(plain.sample("free", x, y)) > 0
    assert np.isinf(cost[~free]).all()
    assert (cost[free] >= 1.0).all()
    level = np.asarray(plain.sample("level", x, y))[free]
    inner = np.asarray(plain.sample("clearance", x, y))[free] > 0.6
    np.testing.assert_allclose(cost[free][inner], 1 + 5 * level[inner], atol=1e-4)
    assert isinstance(service.cost(2.0, 2.0), float)
    assert service.cost(math.nan, 2.0) == math.inf


def test_a_place_that_is_missing_is_no_zero(plain: an.AmbiguityMap) -> None:
    service, none = an.AmbiguityService(plain), None
    assert service.cost(none, 1.0) == math.inf  # type: ignore[call-overload]
    with pytest.raises(an.InputError, match="x0 is not finite"):
        service.reward(none, 1.0, 2.0, 1.0)  # type: ignore[call-overload]


def test_weight_zero_costs_the_length(plain: an.AmbiguityMap) -> None:
    service = an.AmbiguityService(plain, weight=0.0)
    assert service.motion_cost(1.0, 1.0, 4.0, 5.0) == pytest.approx(5.0)
    assert service.reward(2.0, 2.0, 2.0, 2.0) == 0.0
    assert np.asarray(service.reward([1, 2], 1.0, 20.0, 20.0)).max() < 0.0


def test_the_gradient_is_the_slope_of_the_cost(plain: an.AmbiguityMap) -> None:
    service = an.AmbiguityService(plain, weight=5.0)
    rng = np.random.default_rng(2)
    x, y = rng.uniform(0, 44, 3000), rng.uniform(0, 28, 3000)
    step = 1e-4
    slope = service.gradient(x, y)
    with np.errstate(invalid="ignore"):  # inf - inf outside the free space
        east = np.asarray(service.cost(x + step, y)) - np.asarray(service.cost(x - step, y))
        north = np.asarray(service.cost(x, y + step)) - np.asarray(service.cost(x, y - step))
    numeric = np.stack([east, north], axis=1) / (2 * step)
    # Across a lattice line the slope jumps; those points are few.
    near = np.isclose(slope, numeric, atol=2e-2) | ~np.isfinite(numeric)
    assert near.mean() > 0.99


def test_headings_are_read_where_they_matter(headed: an.AmbiguityMap) -> None:
    service = an.AmbiguityService(headed)
    with pytest.raises(an.InputError, match="heading"):
        service.cost(15.0, 21.0)
    costs = np.asarray(service.cost(2.0, 20.0, np.linspace(0, 2 * math.pi, 13)))
    assert costs[0] == pytest.approx(costs[-1])
    assert np.ptp(costs) > 0.0
    assert isinstance(an.AmbiguityService(headed, layer="level_mean").cost(2.0, 20.0), float)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"weight": -1.0}, "weight"),
        ({"weight": math.nan}, "weight"),
        ({"weight": "much"}, "weight is 'much'; give a finite number"),
        ({"power": [1.0]}, "power"),
        ({"layer": "levle"}, "level"),
        ({"layer": "direction"}, "direction"),
        ({"layer": "zone"}, "zone"),
        ({"power": 0.0}, "power"),
        ({"power": math.inf}, "power"),
        ({"clearance_weight": -1.0}, "clearance_weight"),
        ({"comfort": 0.0}, "comfort"),
        ({"weight": 1e39}, "not finite"),
    ],
)
def test_bad_arguments(plain: an.AmbiguityMap, arguments: dict[str, object], word: str) -> None:
    with pytest.raises(an.InputError, match=word):
        an.AmbiguityService(plain, **arguments)  # type: ignore[arg-type]


def test_a_layer_without_end_is_no_cost(plain: an.AmbiguityMap) -> None:
    endless = plain.dataset["level"].where(plain.dataset["level"] < 0.5, math.inf)
    amap = an.AmbiguityMap(plain.dataset.assign(level=endless))
    with pytest.raises(an.InputError, match="'level' holds inf; a cost needs a layer that is fin"):
        an.AmbiguityService(amap)


def test_a_motion_needs_finite_ends(plain: an.AmbiguityMap) -> None:
    with pytest.raises(an.InputError, match="x1"):
        an.AmbiguityService(plain).motion_cost(0.0, 0.0, math.inf, 0.0)


STEERINGS = [
    None, Steering(), Steering("se2"), Steering("dubins", 0.7), Steering("reeds-shepp", 0.7)
]  # fmt: skip
ROUTE = np.array([[2.0, 20.0, 0.0], [4.0, 21.0, 0.5], [4.5, 23.0, 1.5], [2.0, 22.0, 3.0]])


@pytest.mark.parametrize("steering", STEERINGS, ids=str)
def test_a_route_costs_the_sum_of_its_motions(
    headed: an.AmbiguityMap, steering: Steering | None
) -> None:
    service = an.AmbiguityService(headed, weight=5.0)
    a, b = ROUTE[:-1].T, ROUTE[1:].T
    motions = np.asarray(service.motion_cost(a[0], a[1], b[0], b[1], a[2], b[2], steering=steering))
    rewards = np.asarray(service.reward(a[0], a[1], b[0], b[1], a[2], b[2], steering=steering))
    cost, exposure = service.route_cost(ROUTE, steering), service.route_exposure(ROUTE, steering)
    assert cost == pytest.approx(motions.sum())
    assert exposure == pytest.approx(-rewards.sum())
    length = (steering or Steering("se2")).lengths(ROUTE[:-1], ROUTE[1:]).sum()
    assert cost == pytest.approx(length + 5.0 * exposure, rel=1e-5)
    assert service.route_cost(ROUTE[:1], steering) == 0.0


def test_curves_need_headings_and_r2_none(plain: an.AmbiguityMap, headed: an.AmbiguityMap) -> None:
    with pytest.raises(an.InputError, match="theta0"):
        an.AmbiguityService(plain).motion_cost(
            2.0, 20.0, 4.0, 21.0, 0.0, steering=Steering("dubins", 0.5)
        )
    service = an.AmbiguityService(headed)
    along = math.atan2(1.0, 2.0)
    assert service.motion_cost(2.0, 20.0, 4.0, 21.0, steering=Steering()) == pytest.approx(
        service.motion_cost(2.0, 20.0, 4.0, 21.0, along, along)
    )
    with pytest.raises(an.InputError, match="poses"):
        service.route_cost([[0.0, 1.0]])


def test_power_and_clearance(plain: an.AmbiguityMap) -> None:
    service = an.AmbiguityService(
        plain, weight=4.0, power=2.0, clearance_weight=3.0, comfort=0.8
    )  # fmt: skip
    free = service.density.free
    level, clearance = plain.dataset["level"].values, plain.dataset["clearance"].values
    expected = 1 + 4 * level**2 + 3 * np.maximum(0, 1 - clearance / 0.8)
    np.testing.assert_allclose(service.density.values[free, 0], expected[free], rtol=1e-5)
    np.testing.assert_allclose(service.graded.values[free, 0], level[free] ** 2, rtol=1e-5)
    np.testing.assert_array_equal(service.ambiguity.values[free, 0], level[free])
    # Along the middle of a wide room nothing is near: only the layer counts.
    assert service.density.values.min() >= 1.0
    assert an.AmbiguityService(plain, weight=0.0, clearance_weight=1.0).cost(2.0, 2.0) >= 1.0


def test_clearance_counts_with_headings_too(headed: an.AmbiguityMap) -> None:
    near = an.AmbiguityService(headed, weight=0.0, clearance_weight=2.0, comfort=1.0)
    clearance = headed.dataset["clearance"].values
    expected = 1 + 2 * np.maximum(0, 1 - clearance[..., None])
    free = near.density.free
    assert near.density.values.shape[2] == 6
    np.testing.assert_allclose(
        near.density.values[free], np.broadcast_to(expected, (*free.shape, 6))[free], rtol=1e-5
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("added", "layer"),
    [("wall_normals", "wall_normals"), ("coastal_entropy", "coastal_entropy_gain")],
)
def test_a_layer_that_is_high_where_all_is_well_makes_no_cost(
    plain: an.AmbiguityMap, added: str, layer: str
) -> None:
    more = with_layers(plain, [added])
    with pytest.raises(an.InputError, match=rf"'{layer}' is high where .* well localized"):
        an.AmbiguityService(more, layer=layer)


def test_a_metre_outside_of_preferred_floor_costs_more(plain: an.AmbiguityMap) -> None:
    """The cells of a box by their centres, and the integral a cell off its edge at the most."""
    box = shapely.box(0.0, 0.0, 20.07, 30.0)
    usual = an.AmbiguityService(plain, weight=4.0)
    service = an.AmbiguityService(plain, weight=4.0, preferred=box, outside_weight=1.5)
    x, y = np.meshgrid(plain.dataset["x"].values, plain.dataset["y"].values)
    x, y = (axis[plain.dataset["free"].values] for axis in (x, y))
    more = 1.5 * (x > 20.07)
    np.testing.assert_allclose(service.cost(x, y) - usual.cost(x, y), more, atol=1e-5)
    np.testing.assert_allclose(service.with_weight(0.0).cost(x, y), 1.0 + more, atol=1e-5)
    corridor = 7.0, 13.0, 30.0, 13.0
    difference = service.motion_cost(*corridor) - usual.motion_cost(*corridor)
    assert difference == pytest.approx(1.5 * (30.0 - 20.07), abs=1.5 * plain.spacing)


def test_what_is_no_preferred_floor(plain: an.AmbiguityMap) -> None:
    with pytest.raises(InputError, match="hold the centre of no free cell"):
        an.AmbiguityService(plain, preferred=shapely.box(900, 900, 901, 901))
    with pytest.raises(InputError, match="give a shapely geometry"):
        an.AmbiguityService(plain, preferred="box")
    with pytest.raises(InputError, match="outside_weight is -1"):
        an.AmbiguityService(plain, preferred=shapely.box(0, 0, 1, 1), outside_weight=-1.0)
