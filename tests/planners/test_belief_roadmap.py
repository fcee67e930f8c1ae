"""Transfer functions against the filter step by step; the search against all ways."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ambinav.errors import InputError
from ambinav.geometry.steering import Steering
from ambinav_planners.belief_roadmap import BeliefRoadmap, OdometryNoise
from ambinav_planners.graph import MotionGraph
from ambinav_planners.information import Information
from ambinav_planners.roadmap_search import deviation, search_roadmap
from ambinav_planners.transfer import Transfer
from tests.planners.small_graphs import (
    chain,
    even_information,
    graph_of,
    graphs,
    random_information,
    ways_up_to,
)

Matrix = NDArray[np.float64]
Step = tuple[Matrix, Matrix, Matrix]
NOISE = OdometryNoise(along=0.1, across=0.05, drift=0.08, turn=0.1)
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
    jacobian[:2, :2] = [
        [math.cos(angle), -math.sin(angle)],
        [math.sin(angle), math.cos(angle)],
    ]
    jacobian[:2, 2] = rng.normal(size=2)
    return jacobian, half_definite(rng, 0.01), half_definite(rng, 10 ** rng.uniform(-1, 3))


def folded(steps: list[Step]) -> Transfer:
    whole = Transfer.step(*steps[0])
    for step in steps[1:]:
        whole = whole.then(Transfer.step(*step))
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
    found = folded(steps)(covariance)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * max(expected.max(), 1.0))
    np.testing.assert_array_equal(found, found.T)
    assert np.linalg.eigvalsh(found)[0] >= -1e-12 * max(found.max(), 1.0)


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_associative(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b, c = (folded([random_step(rng) for _ in range(rng.integers(1, 8))]) for _ in range(3))
    left, right = a.then(b).then(c), a.then(b.then(c))
    for name in ("carry", "noise", "seen"):
        one, other = getattr(left, name), getattr(right, name)
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
    found = folded(steps)(covariance)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * max(expected.max(), 1.0))


def test_thousands_of_scans_overflow_nothing() -> None:
    """Along a corridor: much is told across, nothing along, so the forms grow far apart."""
    turn = 0.3
    c, s = math.cos(turn), math.sin(turn)
    across = np.array([[s * s, -c * s, 0.0], [-c * s, c * c, 0.0], [0.0, 0.0, 0.5]])
    step = (np.eye(3), 1e-3 * np.eye(3), 1e4 * across)
    expected = START
    for _ in range(3000):
        expected = predicted_and_updated(expected, step)
    found = folded([step] * 3000)(START)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    assert deviation(found, "weak") == pytest.approx(math.sqrt(3.0), rel=0.01)


def steps_along(
    poses: Matrix, length: float, count: int, information: Information, noise: OdometryNoise
) -> list[Step]:
    """The steps of one motion from its poses, written out."""
    ds = length / count
    out = []
    for before, after in itertools.pairwise(poses):
        dx, dy, turn = after - before
        turn = abs((turn + np.pi) % (2 * np.pi) - np.pi)
        heading = noise.drift**2 * ds + noise.turn**2 * turn
        local = np.diag([noise.along**2 * ds, noise.across**2 * ds + heading * ds**2 / 3, heading])
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


def test_noise_is_that_of_a_simulated_odometry() -> None:
    """20 000 robots that drive 2 m straight on with white errors, in steps of 2 cm."""
    rng = np.random.default_rng(0)
    pose, ds = np.zeros((20_000, 3)), 0.02
    for _ in range(100):
        forward = ds + NOISE.along * math.sqrt(ds) * rng.normal(size=len(pose))
        side = NOISE.across * math.sqrt(ds) * rng.normal(size=len(pose))
        pose[:, 2] += NOISE.drift * math.sqrt(ds) * rng.normal(size=len(pose))
        c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        pose[:, 0] += c * forward - s * side
        pose[:, 1] += s * forward + c * side
    graph = chain(np.array([0.0, 2.0]))
    roadmap = BeliefRoadmap.of(graph, even_information(0.0), NOISE)
    found = roadmap.along(np.array([0]), np.zeros((3, 3)))[1]
    np.testing.assert_allclose(found, np.cov(pose.T), rtol=0.05, atol=2e-4)


def best_of_all(
    roadmap: BeliefRoadmap, goal: int, weight: float, measure: str, most: float, longest: float
) -> float:
    best = math.inf
    for motions in ways_up_to(roadmap.graph, 0, goal, longest):
        along = deviation(roadmap.along(np.array(motions, dtype=np.intp), START), measure)
        if along.max() <= most:
            length = float(roadmap.graph.length[motions].sum())
            best = min(best, length + weight * float(along[-1]))
    return best


@settings(max_examples=60, deadline=None)
@given(
    graph=graphs(5),
    seed=st.integers(0, 2**32 - 1),
    weight=st.sampled_from([0.0, 2.0, 8.0]),
    measure=st.sampled_from(["trace", "weak"]),
    most=st.sampled_from([math.inf, 0.35]),
)
def test_best_of_all_ways(
    graph: MotionGraph, seed: int, weight: float, measure: str, most: float
) -> None:
    roadmap = BeliefRoadmap.of(graph, random_information(np.random.default_rng(seed)), NOISE)
    goal, longest = len(graph.poses) - 1, 6.0
    best = best_of_all(roadmap, goal, weight, measure, most, longest)
    found = search_roadmap(
        roadmap, 0, goal, START, weight=weight, measure=measure, max_std=most, exact=True
    )
    if found is None:
        assert best == math.inf
        return
    along = deviation(found.covariances, measure)
    assert found.way.cost == pytest.approx(
        graph.length[found.way.motions].sum() + weight * along[-1]
    )
    assert along.max() <= most
    assert np.linalg.eigvalsh(found.covariances).min() >= -1e-15
    if found.way.cost <= longest:  # a longer way could not be better
        assert found.way.cost == pytest.approx(best, rel=1e-9)
    else:
        assert found.way.cost <= best + 1e-9
    quick = search_roadmap(roadmap, 0, goal, START, weight=weight, measure=measure, max_std=most)
    assert quick is None or quick.way.cost >= found.way.cost - 1e-12


def test_it_goes_by_the_landmarks_if_that_is_worth_it() -> None:
    poses = np.array([[0, 0, 0], [4, 0, 0], [0, 1, 0], [4, 1, 0]], dtype=float)
    graph = graph_of(poses, [(0, 1), (0, 2), (2, 3), (3, 1)])
    plane = np.zeros((9, 17, 1), dtype=np.float32)
    plane[3:] = 100.0
    none = np.zeros_like(plane)
    information = Information(plane, none, plane, none, plane, (0.0, 0.0), 0.25)
    roadmap = BeliefRoadmap.of(graph, information, NOISE)
    for weight, exact, nodes in ((0.0, True, [0, 1]), (50.0, True, None), (50.0, False, None)):
        found = search_roadmap(roadmap, 0, 1, START, weight=weight, exact=exact)
        assert found is not None
        if nodes is None:
            assert found.way.nodes[-2] == 3
        else:
            assert found.way.nodes.tolist() == nodes


def test_deviations() -> None:
    covariance = np.diag([9.0, 16.0, 100.0])
    assert deviation(covariance) == pytest.approx(5.0)
    assert deviation(covariance, "weak") == pytest.approx(4.0)


def test_bad_input() -> None:
    graph = chain(np.array([0.0, 1.0]))
    roadmap = BeliefRoadmap.of(graph, even_information(1.0), NOISE)
    with pytest.raises(InputError, match="measure is 'size'"):
        search_roadmap(roadmap, 0, 1, START, measure="size")
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
    with pytest.raises(InputError, match="turn is -1"):
        OdometryNoise(turn=-1.0)
    with pytest.raises(InputError, match="scan_distance is 0"):
        BeliefRoadmap.of(graph, even_information(1.0), NOISE, scan_distance=0.0)
