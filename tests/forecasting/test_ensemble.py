"""Ensembles: as ordinary drives in distribution, whatever threads and numbers of runs."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator

import numba
import numpy as np
import pytest
import shapely
from scipy.stats import ks_2samp

from ambinav.drive.drive import drive_route
from ambinav.drive.metrics import metrics
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.people import People
from ambinav.drive.robot import Robot
from ambinav.drive.shares import Evidence, newcombe
from ambinav.forecasting.ensemble import EnsembleRunner, LostRule, ensemble
from ambinav.forecasting.likelihood_table import likelihood_table, table_factors
from ambinav.forecasting.ray_factors import hit_curve, ray_factors
from ambinav.geometry.environment import Environment
from ambinav.localization.mcl import MonteCarloLocalizer
from ambinav.localization.mcl_update import weigh
from ambinav.localization.parameters import MclParameters
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.sensing import RangeScanner, RangeSensor
from tests.drive.cases import laser, route_through
from tests.geometry.furnished import furnished
from tests.geometry.scenes import environment, room

ROUTE = route_through([[1.5, 1.5], [6.0, 1.5], [6.0, 5.0]])
ACROSS = route_through([[1.5, 6.0], [11.0, 6.0]])
STRAIGHT = route_through([[15.0, 20.0], [25.0, 20.0]])
SCANNER = laser(beams=24)
FIELD = {
    "min_particles": 60, "max_particles": 120,
    "alpha1": 0.0125, "alpha2": 0.0125, "alpha3": 0.0125, "alpha4": 0.0125,
}  # fmt: skip
HALF_LOST = OdometryNoise(scale=0.3)
LOCALIZERS = {
    "sum": MclParameters(**FIELD),
    "product": MclParameters(
        **FIELD, laser_model_type="likelihood_field_prob", importance_factor=0.3, sigma_hit=0.1
    ),
    "bilinear": MclParameters(**FIELD, likelihood_interpolation="bilinear"),
    "rays": MclParameters(**FIELD, laser_model_type="beam_prob"),
    "table": MclParameters(
        **FIELD, laser_model_type="beam_prob", beam_table_resolution=0.1, sigma_hit=0.1
    ),
    "ekf": "ekf",
    "odometry": "odometry",
    "perfect": "perfect",
}
QUICK = ("sum", "odometry", "perfect")
# Each has a kernel of its own, made of what drives and the kernels of the others consist of.
SWEPT = ("bilinear", "rays")


@pytest.fixture(scope="module")
def hall() -> Environment:
    """A room with a pillar off its middle, so that no two places look alike."""
    return environment(shapely.box(0.0, 0.0, 8.0, 6.5) - shapely.box(2.5, 3.0, 3.5, 4.5))


@pytest.fixture(scope="module")
def wide_hall() -> Environment:
    """A hall in whose middle 4 m of range see nothing; half of the robots get lost there."""
    return room(12.5, 12.0)


@pytest.fixture(scope="module")
def empty() -> Environment:
    """A hall in whose middle nothing is in range for 10 m."""
    return room(40.0, 40.0)


@pytest.fixture
def threads() -> Iterator[None]:
    """Two threads, and what was set afterwards."""
    before = numba.get_num_threads()
    yield
    numba.set_num_threads(before)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.sweep if name in SWEPT else pytest.mark.slow)
        if name not in QUICK
        else name
        for name in LOCALIZERS
    ],
)
def test_runs_do_not_depend_on_their_number_nor_on_the_threads(
    hall: Environment, name: str, threads: None
) -> None:
    runner = EnsembleRunner(hall, SCANNER, LOCALIZERS[name])
    assert runner.compiled == (name not in ("odometry", "perfect"))
    numba.set_num_threads(1)
    few = runner.drive(ROUTE, np.random.default_rng(5), 3)
    numba.set_num_threads(2)
    many = runner.drive(ROUTE, np.random.default_rng(5), 18)
    np.testing.assert_array_equal(few.error, many.error[:3])
    batched = runner.drive(ROUTE, np.random.default_rng(5), 18, width=1e-6)
    np.testing.assert_array_equal(batched.error, many.error)
    assert len(np.unique(many.error[:, -1, 0])) == (1 if name == "perfect" else 18)


@pytest.mark.slow(kept=("sum-sonars", "product-lasers", "table-sonars"))
@pytest.mark.parametrize("preset", ["lasers", "sonars"])
@pytest.mark.parametrize("name", ["sum", "product", "table"])
def test_weights_are_those_of_the_localizer(hall: Environment, name: str, preset: str) -> None:
    """Poses all over the hall, and outside of it, in a filter's order of magnitude of weights."""
    scanner = SCANNER if preset == "lasers" else RangeScanner.from_preset("polaroid-6500-ring")
    rng, beams = np.random.default_rng(2), scanner.beams
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        localizer = MonteCarloLocalizer(hall, scanner, LOCALIZERS[name], rng=rng)
    model, cast = localizer.model, localizer.cast
    table, curve = likelihood_table(model), hit_curve(model)
    assert (curve is None) == (name != "table") and (table is None) == (name == "table")
    readings = scanner.read(hall, 1.5, 1.5, 0.3, rng).astype(np.float32)
    readings[:3] = math.inf, -math.inf, 0.1
    ours, theirs = np.zeros((2, 300, 5))
    ours[:, :3] = rng.uniform((-4.0, -4.0, -math.pi), (12.0, 10.0, math.pi), (300, 3))
    ours[:, 3] = rng.random(300)
    theirs[:] = ours
    scratch = np.empty(300)
    expected = weigh(theirs, 300, readings, model, cast, scratch, None, readings)
    if curve is not None:
        base = ray_factors(ours, 300, readings, model, curve, np.empty((4, beams)), scratch)
    else:
        end, cell = np.empty((2, beams), dtype=np.float32), np.empty(beams, dtype=np.int32)
        base = table_factors(ours, 300, readings, model, table, end, cell, scratch)
    assert base == pytest.approx(expected, abs=1e-3)
    np.testing.assert_allclose(
        ours[:, 3] * math.exp(base), theirs[:, 3] * math.exp(expected), rtol=1e-3
    )


@pytest.mark.slow(kept=("sum-hall", "ekf-wide_hall"))
@pytest.mark.parametrize("place", ["hall", "wide_hall"])
@pytest.mark.parametrize("name", ["sum", "product", "bilinear", "rays", "table", "ekf"])
def test_is_as_ordinary_drives_in_distribution(
    name: str, place: str, request: pytest.FixtureRequest
) -> None:
    """Lost shares within 5 points, where half get lost; errors within 5 %, where none do."""
    building, localizer, runs = request.getfixturevalue(place), LOCALIZERS[name], 1600
    route, noise = (ROUTE, OdometryNoise()) if place == "hall" else (ACROSS, HALF_LOST)
    ours = ensemble(
        building, SCANNER, route, localizer, np.random.default_rng(1), runs, noise=noise
    )
    theirs = drive_route(
        building, SCANNER, Robot(), route, localizer, np.random.default_rng(2), runs,
        noise=noise, open_loop=True,
    )  # fmt: skip
    lost, figures = ours.lost.mean(), metrics(theirs)
    apart = newcombe(lost, figures.lost.mean(), Evidence(runs, 2.8), Evidence(runs, 2.8))
    assert apart[0] <= 0.0 <= apart[1] and apart[1] - apart[0] < 0.1
    if place == "wide_hall":
        assert 0.3 < lost < 0.7
        at = theirs.travelled()[0][np.rint(10.0 * figures.lost_after[figures.lost]).astype(int)]
        assert ks_2samp(ours.lost_at[ours.lost], at).pvalue > 0.005
        return
    assert lost < 0.02
    for axes in (slice(0, 2), slice(2, 3)):
        logs = [
            0.5 * np.log(np.square(error[..., axes]).sum(axis=-1).mean(axis=1))
            for error in (ours.error, theirs.errors())
        ]
        half = 2.8 * math.sqrt((logs[0].var() + logs[1].var()) / runs)
        assert abs(logs[0].mean() - logs[1].mean()) < half < 0.05


@pytest.mark.slow
def test_losing_is_judged_as_by_the_metrics(wide_hall: Environment) -> None:
    noise = HALF_LOST
    ours = ensemble(
        wide_hall, SCANNER, ACROSS, "odometry", np.random.default_rng(1), 10, noise=noise
    )
    child = np.random.default_rng(1).spawn(1)[0].spawn(1)[0]
    theirs = drive_route(
        wide_hall, SCANNER, Robot(), ACROSS, "odometry", child, 10, noise=noise, open_loop=True
    )
    figures = metrics(theirs)
    assert 0 < ours.lost.sum() < 10
    np.testing.assert_array_equal(ours.lost, figures.lost)
    at = theirs.travelled()[0][np.searchsorted(theirs.time, figures.lost_after[ours.lost])]
    np.testing.assert_allclose(ours.lost_at[ours.lost], at, atol=1e-9)
    assert np.isnan(ours.lost_at[~ours.lost]).all()
    assert ours.lost_share[-1] == ours.lost.mean() and ours.lost_share[0] == 0.0
    np.testing.assert_array_equal(ours.poses, theirs.truth[0])
    assert ours.probability.value == ours.lost.mean() and ours.probability.count == 10
    strict = ensemble(
        wide_hall, SCANNER, ACROSS, "odometry", np.random.default_rng(1), 10, noise=noise,
        lost=LostRule(position=0.01, seconds=0.0),
    )  # fmt: skip
    assert strict.lost.all() and (strict.lost_at[ours.lost] < ours.lost_at[ours.lost]).all()


def test_exact_odometry_keeps_the_error_of_the_start(empty: Environment) -> None:
    """Nothing in range: a Kalman filter is then dead reckoning."""
    runs = ensemble(
        empty, SCANNER, STRAIGHT, "ekf", np.random.default_rng(3), 40,
        noise=OdometryNoise(scale=0.0), start_std=(0.05, 0.05, 1e-9),
    )  # fmt: skip
    assert runs.probability.value == 0.0
    np.testing.assert_allclose(runs.error[:, -1], runs.error[:, 0], atol=1e-5)
    assert np.std(runs.error[:, 0, :2]) == pytest.approx(0.05, rel=0.3)


@pytest.mark.slow(kept=("ekf",))
@pytest.mark.parametrize("localizer", ["odometry", "ekf"])
def test_without_echoes_errors_grow_as_dead_reckoning_says(
    empty: Environment, localizer: str
) -> None:
    """Variances of `drive.noise` over 10 m along the path, across it, and of the heading."""
    noise, runs, length = OdometryNoise(scale=0.03), 500, 10.0
    error = ensemble(
        empty, SCANNER, STRAIGHT, localizer, np.random.default_rng(3), runs, noise=noise,
        start_std=(1e-6, 1e-6, 1e-6),
    ).error[:, -1]  # fmt: skip
    turns = noise.scale**2 * noise.alpha2 * noise.distance
    expected = turns * np.array([length, 2.0 / 3.0 * length**3, 2.0 * length])
    np.testing.assert_allclose(error.var(axis=0) / expected, 1.0, atol=3.0 * math.sqrt(2.0 / runs))
    # Along the path errors of the heading shorten it, to second order.
    np.testing.assert_allclose(error[:, 1:].mean(axis=0), 0.0, atol=0.1 * np.sqrt(expected[1]))


def test_stops_when_the_share_is_clear(wide_hall: Environment) -> None:
    poor = EnsembleRunner(wide_hall, SCANNER, "odometry", noise=OdometryNoise(scale=1.0))
    sure = poor.drive(ACROSS, np.random.default_rng(1), 400, until=0.3)
    assert sure.side == "above" and len(sure) == 16 and sure.probability.low > 0.3
    exact = EnsembleRunner(wide_hall, SCANNER, "perfect")
    fine = exact.drive(ACROSS, np.random.default_rng(1), 400, until=0.3)
    assert fine.side == "below" and len(fine) == 16
    unclear = exact.drive(ACROSS, np.random.default_rng(1), 32, until=0.01)
    assert unclear.side is None and len(unclear) == 32
    narrow = exact.drive(ACROSS, np.random.default_rng(1), 400, width=0.1)
    assert 16 < len(narrow) < 400 and narrow.probability.high <= 0.1 and narrow.side is None


def test_people_and_other_worlds_play_a_part(hall: Environment) -> None:
    with_people = EnsembleRunner(hall, SCANNER, LOCALIZERS["sum"], people=People(2))
    assert not with_people.compiled
    assert len(with_people.drive(ROUTE, np.random.default_rng(1), 2)) == 2
    moved = environment(shapely.box(0.0, 0.0, 8.0, 6.5) - shapely.box(2.2, 3.3, 3.2, 4.8))
    same, other = (
        ensemble(hall, SCANNER, ROUTE, LOCALIZERS["sum"], np.random.default_rng(1), 4, world=world)
        for world in (None, moved)
    )
    assert (same.error != other.error).any()


def test_refuses_what_it_cannot_use(hall: Environment) -> None:
    runner = EnsembleRunner(hall, SCANNER, "odometry")
    rng = np.random.default_rng(1)
    with pytest.raises(InputError, match="its start"):
        runner.drive(route_through([[3.0, 3.5], [6.0, 5.0]]), rng)
    for wrong in ({"runs": 0}, {"until": 1.5}, {"width": 0.0}, {"level": 1.0}):
        with pytest.raises(InputError):
            runner.drive(ROUTE, rng, **wrong)
    with pytest.raises(InputError, match="position"):
        LostRule(position=-1.0)
    with pytest.raises(InputError, match="rate"):
        EnsembleRunner(hall, SCANNER, "odometry", rate=0.0)
    with pytest.raises(InputError, match="localizer"):
        EnsembleRunner(hall, SCANNER, "no such")


@pytest.mark.slow
def test_a_kalman_filter_is_driven_in_a_mesh_as_in_prisms() -> None:
    """There outside of kernels, with other random numbers."""
    sensor = RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
    raised = RangeScanner.planar(sensor, 60, math.tau, (0.0, 0.0, 0.003)).raised(0.4)
    route = Route.through([(1.0, 0.6), (4.5, 0.6)])
    spreads = []
    for env, compiled in zip(furnished(), (True, False), strict=True):
        runner = EnsembleRunner(env, raised, "ekf")
        assert runner.compiled == compiled
        errors = runner.drive(route, np.random.default_rng(1), 32).error
        spreads.append(float(np.sqrt((errors[:, 5:, :2] ** 2).sum(axis=-1).mean())))
    assert spreads[1] == pytest.approx(spreads[0], rel=0.5)
    assert max(spreads) < 0.05
