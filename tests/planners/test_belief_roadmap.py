"""Transfer functions against the filter step by step; the search against all paths."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ambinav.drive.noise import OdometryNoise
from ambinav.forecasting.information_field import InformationField
from ambinav.geometry.motion.steering import Steering
from ambinav.runtime.errors import InputError
from ambinav_planners.belief.roadmap import BeliefRoadmap
from ambinav_planners.belief.roadmap_search import deviation, search_roadmap
from ambinav_planners.belief.transfer import carried, compose
from ambinav_planners.search.graph import MotionGraph
from tests.planners.small_graphs import (
    chain,
    even_information,
    graph_of,
    graphs,
    landmarks,
    odometry,
    paths_up_to,
    random_information,
)

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow

Matrix = NDArray[np.float64]
Step = tuple[Matrix, Matrix, Matrix]
NOISE = odometry(along=0.1, drift=0.08, turn=0.1, slip=0.05)
START = np.diag([0.1, 0.2, 0.1]) ** 2


def predicted_and_updated(covariance: Matrix, step: Step) -> Matrix:
    """One step of the extended Kalman filter, in the form of Joseph; L L^T is the information."""
    jacobian, noise, information = step
    s = jacobian @ covariance @ jacobian.T + noise
    values, axes = np.linalg.eigh(information)
    h = (axes * np.sqrt(values.clip(0.0))).T
    gain = s @ h.T @ np.linalg.inv(h @ s @ h.T + np.eye(3))
    rest = np.eye(3) - gain @ h
    return rest @ s @ rest.T + gain @ gain.T


def half_definite(rng: np.random.Generator, size: float) -> Matrix:
    """A random symmetric matrix of rank 0 to 3, none of its eigenvalues below 0."""
    root = rng.normal(size=(3, rng.integers(4)))
    return size * root @ root.T


def random_step(rng: np.random.Generator) -> Step:
    angle = rng.uniform(-0.5, 0.5)
    jacobian = np.eye(3)
    jacobian[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    jacobian[:2, 2] = rng.normal(size=2)
    return jacobian, half_definite(rng, 0.01), half_definite(rng, 10 ** rng.uniform(-1, 3))


def folded(steps: list[Step]) -> Step:
    """The blocks F, N, O of steps of the filter, each a motion and then a scan."""
    nothing, unchanged = np.zeros((3, 3)), np.eye(3)
    whole = unchanged, nothing, nothing
    for jacobian, noise, information in steps:
        motion = compose(*whole, jacobian, noise, nothing)
        whole = compose(*motion, unchanged, nothing, information)
    return whole


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 60))
def test_composed_equals_step_by_step(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    steps = [random_step(rng) for _ in range(count)]
    covariance = half_definite(rng, 0.1)
    expected = covariance
    for step in steps:
        expected = predicted_and_updated(expected, step)
    found = carried(*folded(steps), covariance)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * max(expected.max(), 1.0))
    np.testing.assert_array_equal(found, found.T)
    assert np.linalg.eigvalsh(found)[0] >= -1e-12 * max(found.max(), 1.0)


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_associative(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b, c = (folded([random_step(rng) for _ in range(rng.integers(1, 8))]) for _ in range(3))
    left, right = compose(*compose(*a, *b), *c), compose(*a, *compose(*b, *c))
    for one, other in zip(left, right, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * max(np.abs(one).max(), 1.0))


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_equals_the_form_of_prentice_and_roy(seed: int) -> None:
    """S = B C^-1 with the 2n x 2n matrices of one step multiplied, on a chain short enough."""
    rng = np.random.default_rng(seed)
    steps = [random_step(rng) for _ in range(3)]
    covariance = half_definite(rng, 0.1)
    product, nothing, one = np.eye(6), np.zeros((3, 3)), np.eye(3)
    for jacobian, noise, information in steps:
        back = np.linalg.inv(jacobian.T)
        motion = np.block([[nothing, back], [jacobian, noise @ back]])
        scan = np.block([[nothing, one], [one, information]])
        product = scan @ motion @ product
    b, c = np.split(product @ np.vstack([covariance, one]), 2)
    expected = b @ np.linalg.inv(c)
    found = carried(*folded(steps), covariance)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * max(expected.max(), 1.0))


def test_thousands_of_scans_overflow_nothing() -> None:
    """Along a corridor: much information across, none along, so the forms grow far apart."""
    turn = 0.3
    c, s = math.cos(turn), math.sin(turn)
    across = np.array([[s * s, -c * s, 0.0], [-c * s, c * c, 0.0], [0.0, 0.0, 0.5]])
    step = (np.eye(3), 1e-3 * np.eye(3), 1e4 * across)
    expected = START
    for _ in range(3000):
        expected = predicted_and_updated(expected, step)
    found = carried(*folded([step] * 3000), START)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    assert deviation(found) == pytest.approx(math.sqrt(3.0), rel=0.01)


def steps_along(
    poses: Matrix, length: float, count: int, information: InformationField, noise: OdometryNoise
) -> list[Step]:
    """The steps of one motion from its poses, written out."""
    ds = length / count
    out = []
    for before, after in itertools.pairwise(poses):
        dx, dy, turn = after - before
        turn = abs((turn + np.pi) % (2 * np.pi) - np.pi)
        # By the definition of the alphas: every variance grows with metres or with radians.
        per = noise.scale**2 * np.array([noise.distance, noise.angle])
        heading = 2 * noise.alpha2 * per[0] * ds + noise.alpha1 * per[1] * turn
        along = noise.alpha3 * per[0] * ds + noise.alpha4 * per[1] * turn
        local = np.diag([along, heading * ds**2 / 3, heading])
        local[1, 2] = local[2, 1] = heading * ds / 2
        travel = math.atan2(dy, dx)
        c, s = math.cos(travel), math.sin(travel)
        axes = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        jacobian = np.array([[1, 0, -dy], [0, 1, dx], [0, 0, 1]])
        out.append((jacobian, axes @ local @ axes.T, information.at(after[np.newaxis])[0] * ds))
    return out


@pytest.mark.parametrize(
    ("space", "accuracy"), [("r2", 1e-9), ("se2", 1e-9), ("dubins", 1e-5), ("reeds-shepp", 1e-5)]
)
def test_motions_equal_the_filter_along_them(space: str, accuracy: float) -> None:
    """Straight motions to 1e-9; curves with poses read off a dense route."""
    steering = Steering(space, 0.5 if accuracy > 1e-9 else 0.0)
    rng = np.random.default_rng(5)
    poses = np.column_stack([rng.uniform(1, 3, (6, 2)), rng.uniform(-np.pi, np.pi, 6)])
    graph = graph_of(poses, [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (1, 4)], steering)
    information = random_information(rng)
    roadmap = BeliefRoadmap.of(graph, information, NOISE, step=0.25)
    for e, (a, b) in enumerate(zip(graph.source, graph.target, strict=True)):
        count = math.ceil(graph.length[e] / 0.25)
        dense, _, along = steering.dense(poses[[a, b]], 1e-4)
        at = np.linspace(0.0, graph.length[e], count + 1)
        heading = np.unwrap(dense[:, 2])
        read = np.column_stack(
            [np.interp(at, along, value) for value in (dense[:, 0], dense[:, 1], heading)]
        )
        expected = START
        for step in steps_along(read, float(graph.length[e]), count, information, NOISE):
            expected = predicted_and_updated(expected, step)
        found = roadmap.along(np.array([e]), START)[1]
        np.testing.assert_allclose(found, expected, rtol=0, atol=accuracy)


def test_the_cut_of_a_straight_line_does_not_matter() -> None:
    ends = []
    for x, step in ((np.array([0.0, 3.0]), 5.0), (np.linspace(0.0, 3.0, 7), 0.11)):
        graph = chain(x)
        roadmap = BeliefRoadmap.of(graph, even_information(0.0), NOISE, step=step)
        ends.append(roadmap.along(np.flatnonzero(graph.target > graph.source), START)[-1])
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("space", ["r2", "dubins"])
def test_prediction_is_the_spread_of_simulated_robots(space: str) -> None:
    """20 000 robots with the simulated odometry, which know nothing but where they start."""
    noise = OdometryNoise(scale=0.3)
    steering = Steering(space, 0.5 if space == "dubins" else 0.0)
    corners = np.array([[0, 0, 0], [1.5, 0, 0.8], [1.5, 1.5, 2.0]], dtype=float)
    graph = graph_of(corners, [(0, 1), (1, 2)], steering)
    motions = np.array([int(np.flatnonzero((graph.source == a) & (graph.target == a + 1))[0])
                        for a in range(2)])  # fmt: skip
    roadmap = BeliefRoadmap.of(graph, even_information(0.0), noise, step=0.05)
    found = roadmap.along(motions, np.zeros((3, 3)))[-1]
    truth = small_steps(steering, corners)
    ends = dead_reckoned(truth, noise, 20_000)
    np.testing.assert_allclose(found, np.cov((ends - truth[-1]).T), rtol=0.08, atol=8e-4)


def small_steps(steering: Steering, corners: Matrix) -> Matrix:
    """Poses along a route some millimetres apart; in r2 with the turns on the spot."""
    if steering.space != "r2":
        dense, _, _ = steering.dense(corners, 0.01)
        dense[:, 2] = np.unwrap(dense[:, 2])
        return dense[np.concatenate([[True], np.abs(np.diff(dense, axis=0)).max(axis=1) > 0])]
    share = np.linspace(0.0, 1.0, 100)[1:, np.newaxis]
    poses = [np.zeros((1, 3))]
    for a, b in itertools.pairwise(corners):
        heading = math.atan2(*(b - a)[1::-1])
        here = poses[-1][-1]
        for there in (np.array([*a[:2], heading]), np.array([*b[:2], heading])):
            poses.append(here + share * (there - here))
            here = there
    return np.vstack(poses)


def dead_reckoned(truth: Matrix, noise: OdometryNoise, count: int) -> Matrix:
    """Where so many robots believe they end that go by odometry alone, shape (count, 3).

    Written from the definition: the variances of both turns and of the distance.
    """
    rng = np.random.default_rng(0)
    at = np.tile(truth[0], (count, 1))
    square = noise.scale**2
    for before, after in itertools.pairwise(truth):
        path = float(np.hypot(*(after - before)[:2]))
        turn = float(after[2] - before[2])
        turning = square * noise.alpha1 * noise.angle * abs(turn)
        going = square * noise.alpha2 * noise.distance * path
        along = square * (
            noise.alpha3 * noise.distance * path + noise.alpha4 * noise.angle * abs(turn)
        )
        half = 0.5 if path > 0 else 0.0
        first = math.sqrt(turning * half + going) * rng.normal(size=count)
        second = math.sqrt(turning * (1 - half) + going) * rng.normal(size=count)
        gone = path + math.sqrt(along) * rng.normal(size=count)
        ahead = math.atan2(after[1] - before[1], after[0] - before[0]) if path > 0 else before[2]
        heading = at[:, 2] + (ahead - before[2]) + first
        at[:, 0] += gone * np.cos(heading)
        at[:, 1] += gone * np.sin(heading)
        at[:, 2] += turn + first + second
    return at


def test_corners_add_what_a_turn_on_the_spot_adds() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0]], dtype=float)
    line = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]], dtype=float)
    noise = odometry(turn=0.3)
    ends = []
    for poses in (square, line):
        graph = graph_of(poses, [(0, 1), (1, 2)])
        roadmap = BeliefRoadmap.of(graph, even_information(0.0), noise)
        there = np.flatnonzero(graph.target > graph.source)
        ends.append(roadmap.along(there, np.zeros((3, 3)))[-1])
    assert ends[0][2, 2] == pytest.approx(0.09 * math.pi / 2)
    np.testing.assert_array_equal(ends[1], 0.0)


def test_another_odometry_is_another_prediction() -> None:
    graph = chain(np.array([0.0, 2.0, 4.0]))
    there = np.flatnonzero(graph.target > graph.source)
    ends = []
    for noise in (OdometryNoise(scale=0.1), OdometryNoise(scale=0.4)):
        roadmap = BeliefRoadmap.of(graph, even_information(4.0), noise)
        ends.append(math.sqrt(np.trace(roadmap.along(there, START)[-1, :2, :2])))
    assert ends[1] > 1.3 * ends[0]


def best_of_all(
    roadmap: BeliefRoadmap, goal: int, weight: float, most: float, longest: float
) -> float:
    best = math.inf
    for motions in paths_up_to(roadmap.graph, 0, goal, longest):
        covariances = roadmap.along(np.array(motions, dtype=np.intp), START)
        along = [deviation(covariance) for covariance in covariances]
        if max(along) <= most:
            length = float(roadmap.graph.length[motions].sum())
            best = min(best, length + weight * along[-1])
    return best


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(
    graph=graphs(5),
    seed=st.integers(0, 2**32 - 1),
    weight=st.sampled_from([0.0, 2.0, 8.0]),
    most=st.sampled_from([math.inf, 0.35]),
)
def test_no_path_is_better_than_the_best_of_all(
    graph: MotionGraph, seed: int, weight: float, most: float
) -> None:
    roadmap = BeliefRoadmap.of(graph, random_information(np.random.default_rng(seed)), NOISE)
    goal, longest = len(graph.poses) - 1, 6.0
    found = search_roadmap(roadmap, 0, goal, START, weight=weight, max_std=most)
    if found is None:
        assert most < math.inf or not paths_up_to(graph, 0, goal, longest)
        return
    along = [deviation(covariance) for covariance in found.covariances]
    assert found.path.cost == pytest.approx(
        graph.length[found.path.motions].sum() + weight * along[-1]
    )
    assert max(along) <= most
    assert np.linalg.eigvalsh(found.covariances).min() >= -1e-15
    if graph.length[found.path.motions].sum() <= longest:
        best = best_of_all(roadmap, goal, weight, most, longest)
        assert found.path.cost >= best - 1e-9
        if weight == 0.0 and most == math.inf:
            assert found.path.cost == pytest.approx(best, rel=1e-9)


def test_it_goes_by_the_landmarks_if_that_is_worth_it() -> None:
    poses = np.array([[0, 0, 0], [4, 0, 0], [0, 1, 0], [4, 1, 0]], dtype=float)
    graph = graph_of(poses, [(0, 1), (0, 2), (2, 3), (3, 1)])
    information = landmarks(100.0)
    roadmap = BeliefRoadmap.of(graph, information, NOISE)
    for weight, before in ((0.0, 0), (50.0, 3)):
        found = search_roadmap(roadmap, 0, 1, START, weight=weight)
        assert found is not None
        assert found.path.nodes[-2] == before


def test_a_roadmap_of_nothing_but_start_and_goal_is_searched() -> None:
    """The bound at the goal once went to and fro between two nodes for ever."""
    for count in (2, 3):
        graph = chain(np.linspace(0.0, 2.0, count))
        roadmap = BeliefRoadmap.of(graph, even_information(4.0), NOISE)
        found = search_roadmap(roadmap, 0, count - 1, START)
        assert found is not None
        assert found.path.nodes.tolist() == list(range(count))


def test_deviations() -> None:
    assert deviation(np.diag([9.0, 16.0, 100.0])) == pytest.approx(4.0)


def test_bad_input() -> None:
    graph = chain(np.array([0.0, 1.0]))
    roadmap = BeliefRoadmap.of(graph, even_information(1.0), NOISE)
    with pytest.raises(InputError, match="weight is inf"):
        search_roadmap(roadmap, 0, 1, START, weight=math.inf)
    with pytest.raises(InputError, match="max_std is 0"):
        search_roadmap(roadmap, 0, 1, START, max_std=0.0)
    with pytest.raises(InputError, match="eigenvalue -1"):
        search_roadmap(roadmap, 0, 1, -np.eye(3))
    with pytest.raises(InputError, match="not symmetric"):
        search_roadmap(roadmap, 0, 1, np.triu(np.ones((3, 3))))
    with pytest.raises(InputError, match="3 x 3"):
        search_roadmap(roadmap, 0, 1, np.eye(2))
    with pytest.raises(InputError, match="scan_distance is 0"):
        BeliefRoadmap.of(graph, even_information(1.0), NOISE, scan_distance=0.0)
