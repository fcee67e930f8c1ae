"""Dubins and Reeds-Shepp curves: against OMPL's, and what must hold of any shortest curve."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ambinav.geometry.motion.curves import (
    DUBINS,
    FACING,
    REEDS_SHEPP,
    STRAIGHT,
    advance,
    curve_pieces,
    motion_length,
)

Pose = tuple[float, float, float]
Curve = Callable[[Pose, Pose, float], tuple[float, Pose]]
CURVES = pytest.mark.parametrize("kind", [DUBINS, REEDS_SHEPP])

coordinates = st.floats(-20.0, 20.0)
headings = st.floats(-math.pi, math.pi)
poses = st.tuples(coordinates, coordinates, headings)
radii = st.floats(0.2, 5.0)


def ompl_curve(kind: int, radius: float) -> Curve:
    """OMPL's distance, and its pose at a share of the way."""
    ob = pytest.importorskip("ompl.base")
    name = "DubinsStateSpace" if kind == DUBINS else "ReedsSheppStateSpace"
    space = getattr(ob, name)(radius)
    bounds = ob.RealVectorBounds(2)
    bounds.setLow(-1e4)
    bounds.setHigh(1e4)
    space.setBounds(bounds)
    information = ob.SpaceInformation(space)
    information.setStateValidityChecker(lambda _: True)
    information.setup()
    states = [information.allocState() for _ in range(3)]

    def curve(a: Pose, b: Pose, share: float) -> tuple[float, Pose]:
        for state, pose in zip(states, (a, b), strict=False):
            state.setXY(pose[0], pose[1])
            state.setYaw(pose[2])
        space.interpolate(states[0], states[1], share, states[2])
        there = states[2]
        distance = space.distance(states[0], states[1])
        return distance, (there.getX(), there.getY(), there.getYaw())

    return curve


def travel(pieces: tuple[float, ...], start: Pose, metres: float = math.inf) -> Pose:
    """Pose after so many metres along a curve."""
    pose = start
    for length, curvature in zip(pieces[:5], pieces[5:], strict=True):
        part = min(abs(length), metres)
        pose = advance(*pose, math.copysign(part, length), curvature)
        metres -= part
    return pose


def apart(a: Pose, b: Pose) -> float:
    """Metres between two poses, plus radians between their headings."""
    turn = (a[2] - b[2] + math.pi) % (2 * math.pi) - math.pi
    return math.hypot(a[0] - b[0], a[1] - b[1]) + abs(turn)


def total(pieces: tuple[float, ...]) -> float:
    return sum(abs(length) for length in pieces[:5])


def is_tie(pieces: tuple[float, ...]) -> bool:
    """Whether the curve is three arcs that all turn the robot the same way.

    L+R-L+ and R-L+R- are then equally long, and rounding decides which of them OMPL takes.
    """
    turned = [length * curvature for length, curvature in zip(pieces[:5], pieces[5:], strict=True)]
    return math.isclose(abs(sum(turned)), sum(map(abs, turned)), abs_tol=1e-9) and 0.0 not in (
        pieces[0] * pieces[5], pieces[1] * pieces[6], pieces[2] * pieces[7]
    )  # fmt: skip


@CURVES
@pytest.mark.parametrize("radius", [0.4, 1.0, 3.0])
@pytest.mark.parametrize("extent", [0.1, 1.0, 4.0, 15.0, 300.0])
def test_curves_are_those_of_ompl(kind: int, radius: float, extent: float) -> None:
    curve = ompl_curve(kind, radius)
    rng = np.random.default_rng(0)
    ties = 0
    for _ in range(500):
        a, b = (
            (*rng.uniform(-extent, extent, 2).tolist(), rng.uniform(-math.pi, math.pi))
            for _ in range(2)
        )
        share = rng.uniform()
        distance, there = curve(a, b, share)
        pieces = curve_pieces(kind, radius, *a, *b)
        assert total(pieces) == pytest.approx(distance, abs=1e-9)
        assert motion_length(kind, radius, *a, *b) == pytest.approx(distance, abs=1e-9)
        assert apart(travel(pieces, a), b) < 1e-9
        if kind == REEDS_SHEPP and is_tie(pieces):
            ties += 1
        else:
            assert apart(travel(pieces, a, share * distance), there) < 1e-6
    assert ties < 500


def lattice_poses(radius: float) -> list[Pose]:
    """Poses whose circles touch or coincide, ahead and behind, with square headings."""
    steps = [0.0, 1e-12, 1e-7, 1e-3, 1.0, 2.0, 4.0, -1e-7, -1.0, -2.0, -4.0, 1e5]
    turns = [0.0, 1e-12, 1e-7, math.pi / 2, -math.pi / 2, math.pi, -math.pi, 1.0]
    return [(x * radius, y * radius, t) for x in steps for y in steps for t in turns]


@CURVES
@pytest.mark.parametrize("radius", [0.5, 2.0])
def test_edge_cases(kind: int, radius: float) -> None:
    start = (0.0, 0.0, 0.0)
    curve = ompl_curve(kind, radius)
    for goal in lattice_poses(radius):
        pieces = curve_pieces(kind, radius, *start, *goal)
        distance, _ = curve(start, goal, 0.5)
        # OMPL's classes of Dubins words are right to 1e-9 of the way, where it is far.
        assert total(pieces) == pytest.approx(distance, rel=1e-9, abs=1e-6), goal
        assert apart(travel(pieces, start), goal) < 5e-6
        assert kind == REEDS_SHEPP or min(pieces[:5]) >= 0.0


def test_known_lengths() -> None:
    def dubins(*goal: float) -> float:
        return float(motion_length(DUBINS, 2.0, 0.0, 0.0, 0.0, *goal))

    def reeds_shepp(*goal: float) -> float:
        return float(motion_length(REEDS_SHEPP, 2.0, 0.0, 0.0, 0.0, *goal))

    assert dubins(5.0, 0.0, 0.0) == reeds_shepp(5.0, 0.0, 0.0) == 5.0
    assert reeds_shepp(-5.0, 0.0, 0.0) == 5.0
    assert dubins(-1e-3, 0.0, 0.0) > 4 * math.pi - 0.01
    assert dubins(0.0, 4.0, math.pi) == pytest.approx(2 * math.pi)  # half a circle
    assert dubins(2.0, 2.0, math.pi / 2) == pytest.approx(math.pi)  # a quarter
    assert reeds_shepp(2.0, -2.0, -math.pi / 2) == pytest.approx(math.pi)
    # A turn on the spot by three arcs of a third of it each.
    assert reeds_shepp(0.0, 0.0, math.pi) == pytest.approx(2 * math.pi)
    assert dubins(1.0, 2.0, 3.0) >= reeds_shepp(1.0, 2.0, 3.0)
    for kind in (FACING, STRAIGHT):
        assert motion_length(kind, 0.0, 1.0, 2.0, 0.3, 4.0, 6.0, 2.0) == pytest.approx(5.0)
    for kind in (FACING, STRAIGHT, DUBINS, REEDS_SHEPP):
        assert motion_length(kind, 1.0, 1.0, 2.0, 0.3, 1.0, 2.0, 0.3) == 0.0


@pytest.mark.slow
@CURVES
def test_part_of_a_shortest_curve_is_shortest(kind: int) -> None:
    """Rounding must not make a loop: the joints of the pieces are among the ends tried."""
    rng = np.random.default_rng(1)
    for _ in range(2000):
        radius, extent = rng.uniform(0.2, 3.0), rng.choice([1.0, 5.0, 100.0])
        a, b = (
            (*rng.uniform(-extent, extent, 2).tolist(), rng.uniform(-7.0, 7.0)) for _ in range(2)
        )
        pieces = curve_pieces(kind, radius, *a, *b)
        joints = np.cumsum(np.abs(pieces[:5]))
        first, second = np.sort(rng.choice([*joints, *rng.uniform(0, joints[-1], 3), 0.0], 2))
        part = motion_length(
            kind, radius, *travel(pieces, a, first), *travel(pieces, a, second)
        )  # fmt: skip
        assert part == pytest.approx(second - first, abs=1e-6)


@pytest.mark.slow
@CURVES
@settings(max_examples=200, deadline=None)
@given(poses, poses, radii, coordinates, coordinates, headings)
def test_a_moved_and_turned_building_changes_nothing(
    kind: int, a: Pose, b: Pose, radius: float, x: float, y: float, angle: float
) -> None:
    def moved(pose: Pose) -> Pose:
        c, s = math.cos(angle), math.sin(angle)
        return x + c * pose[0] - s * pose[1], y + s * pose[0] + c * pose[1], pose[2] + angle

    before = motion_length(kind, radius, *a, *b)
    after = motion_length(kind, radius, *moved(a), *moved(b))
    if kind == DUBINS:  # jumps by a loop where the goal is beside the curve by a rounding
        nudged = [
            motion_length(kind, radius, *a, b[0] + i * 1e-6, b[1] + j * 1e-6, b[2] + k * 1e-6)
            for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)
        ]  # fmt: skip
        if max(nudged) - min(nudged) > 1e-2:
            return
    # Steep where two circles touch: there a rounding counts with its square root.
    assert after == pytest.approx(before, abs=1e-5)


@pytest.mark.slow
@CURVES
@settings(max_examples=200, deadline=None)
@given(poses, poses, radii)
def test_mirrored_and_turned_round(kind: int, a: Pose, b: Pose, radius: float) -> None:
    length = motion_length(kind, radius, *a, *b)

    def mirrored(pose: Pose) -> Pose:
        return pose[0], -pose[1], -pose[2]

    assert motion_length(kind, radius, *mirrored(a), *mirrored(b)) == pytest.approx(
        length, abs=1e-6
    )
    assert length >= math.hypot(b[0] - a[0], b[1] - a[1]) - 1e-6
    if kind == REEDS_SHEPP:
        assert motion_length(kind, radius, *b, *a) == pytest.approx(length, abs=1e-5)
        # Time flipped: the same way with forwards for backwards.
        ahead = motion_length(kind, radius, 0.0, 0.0, 0.0, *b)
        assert motion_length(kind, radius, 0.0, 0.0, 0.0, -b[0], b[1], -b[2]) == pytest.approx(
            ahead, abs=1e-5
        )


def test_of_equally_long_words_the_one_that_begins_forwards() -> None:
    rng = np.random.default_rng(2)
    ties = 0
    for _ in range(500):
        goal = (*rng.uniform(-0.2, 0.2, 2), rng.uniform(-2.0, 2.0))
        pieces = curve_pieces(REEDS_SHEPP, 1.0, 0.0, 0.0, 0.0, *goal)
        if is_tie(pieces) and pieces[1] < 0.0:
            ties += 1
            assert pieces[0] > 0.0
    assert ties > 100


def test_advance_is_exact_on_slight_bends() -> None:
    x, y, _ = advance(1.0, 2.0, 0.5, 10.0, 1e-12)
    assert (x, y) == pytest.approx((1 + 10 * math.cos(0.5), 2 + 10 * math.sin(0.5)))
    steps = (1.0, 2.0, 0.5)
    for _ in range(1000):
        steps = advance(*steps, -0.003, 0.7)
    assert apart(advance(1.0, 2.0, 0.5, -3.0, 0.7), steps) < 1e-12


def test_what_is_not_finite_ends() -> None:
    bad: NDArray[np.float64] = np.array([math.nan, math.inf])
    for kind in (DUBINS, REEDS_SHEPP):
        for value in bad:
            assert not math.isfinite(motion_length(kind, 1.0, 0.0, 0.0, 0.0, value, 1.0, 0.0))
