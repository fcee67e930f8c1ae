"""What is left of a displacement: closed forms, a plain match by exact casts, symmetries."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ambinav.ambiguity.reference import beams
from ambinav.geometry.environment import Environment
from ambinav.layers.context import LayerContext
from ambinav.layers.perturbation import perturbation
from ambinav.map_building.build import build_map
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from tests.geometry import scenes

Floats = NDArray[np.float64]

SIZE = 0.25
LASER = RangeScanner.planar(RangeSensor(max_range=4.0, std=0.03, resolution=0.001), 60, 2 * math.pi)


def context_of(env: Environment, scanner: RangeScanner = LASER, **options: float) -> LayerContext:
    return LayerContext.of(build_map(env, scanner, **options), env)  # type: ignore[arg-type]


def at(context: LayerContext, values: NDArray[np.float32], x: float, y: float) -> float:
    """The value of the cell nearest to (x, y)."""
    px, py = context.points
    return float(values[context.free][np.argmin(np.hypot(px - x, py - y))])


def linear(context: LayerContext, x: float, y: float) -> tuple[float, float]:
    """Errors of the worst and the best displacement where the match comes to its end.

    The residual is then nil, and what pulls the estimate off is only what was believed.
    """
    _, gradient, variance, _ = beams(
        context.environment, context.scanner, context.model, x, y, float(context.headings[0])
    )
    ranges = context.scanner.scan(context.environment, x, y, 0.0)
    weight = np.isfinite(ranges) / variance
    prior = np.diag([SIZE**-2, SIZE**-2, context.model.sigma_theta**-2])
    total = (gradient * weight[:, None]).T @ gradient + prior
    left = np.linalg.solve(total, prior)[:2, :2] * SIZE
    worst, best = np.linalg.svd(left, compute_uv=False)
    return float(worst), float(best)


@pytest.mark.parametrize(
    "degrees", [0, 17, *(pytest.param(turn, marks=pytest.mark.slow) for turn in (45, 90, 130))]
)
def test_along_a_straight_corridor_nothing_is_recovered(degrees: float) -> None:
    angle = math.radians(degrees)
    context = context_of(scenes.room(16.0, 2.4).transformed(angle))
    found = perturbation(context)
    x, y = context.points
    along = math.cos(angle) * x + math.sin(angle) * y
    across = -math.sin(angle) * x + math.cos(angle) * y
    middle = (np.abs(along - 8.0) < 2.0) & (np.abs(across - 1.2) < 0.9)
    values = {name: layer[context.free][middle] for name, layer in found.items()}
    assert values["perturbation"] == pytest.approx(SIZE, rel=0.01)
    assert values["perturbation_minor"].max() < 0.005
    apart = np.remainder(values["perturbation_direction"] - angle + math.pi / 2, math.pi)
    assert np.abs(apart - math.pi / 2).max() < math.radians(1.0)


@pytest.mark.slow
def test_in_the_open_nothing_is_recovered_either_way() -> None:
    context = context_of(scenes.room(14.0, 14.0))
    for name in ("perturbation", "perturbation_minor"):
        assert at(context, perturbation(context)[name], 7.0, 7.0) == pytest.approx(SIZE, rel=1e-5)


def test_in_a_square_room_it_is_recovered() -> None:
    context = context_of(scenes.room(4.0, 4.0))
    found = perturbation(context, iterations=10)
    x, y = context.points
    inner = (np.abs(x - 2.0) < 1.5) & (np.abs(y - 2.0) < 1.5)
    assert found["perturbation"][context.free][inner].max() < 0.005


@pytest.mark.slow
@pytest.mark.parametrize(
    ("env", "x", "y"),
    [
        (scenes.room(4.0, 4.0), 1.35, 2.25),
        (scenes.room(16.0, 2.4), 8.05, 0.75),
        (scenes.room(16.0, 2.4).transformed(0.4), 6.5, 4.3),
        (scenes.room(9.0, 9.0), 2.05, 4.55),
    ],
    ids=["room", "corridor", "turned corridor", "wall"],
)
def test_ends_where_only_what_was_believed_pulls(env: Environment, x: float, y: float) -> None:
    context = context_of(env)
    px, py = context.points
    near = np.argmin(np.hypot(px - x, py - y))
    worst, best = linear(context, float(px[near]), float(py[near]))
    found = perturbation(context, iterations=12)
    assert at(context, found["perturbation"], x, y) == pytest.approx(worst, rel=0.02)
    assert at(context, found["perturbation_minor"], x, y) == pytest.approx(best, rel=0.02)


def test_one_step_is_the_regularised_least_squares_step() -> None:
    """One step, without outliers: numpy's solution with exact casts."""
    context = context_of(scenes.room(4.0, 3.0), outlier_share=1e-9)
    x, y = 1.55, 1.35
    here = beams(context.environment, context.scanner, context.model, x, y, 0.0)
    errors = []
    for axis in ((1, 0), (0, 1), (-1, 0), (0, -1)):
        step = SIZE * np.array(axis)
        there = beams(
            context.environment, context.scanner, context.model, x + step[0], y + step[1], 0
        )
        weight = 1.0 / here[2]
        prior = np.diag([SIZE**-2, SIZE**-2, context.model.sigma_theta**-2])
        total = (there[1] * weight[:, None]).T @ there[1] + prior
        pull = there[1].T @ (weight * (here[0] - there[0]))
        errors.append(np.linalg.solve(total, pull)[:2] + step)
    expected = np.linalg.svd(np.array(errors), compute_uv=False) / math.sqrt(2)
    found = perturbation(context, iterations=1)
    values = [at(context, found[name], x, y) for name in ("perturbation", "perturbation_minor")]
    # The caps are wide, not infinite.
    np.testing.assert_allclose(values, expected, rtol=0.25)


def test_quarter_turn_turns_the_layer() -> None:
    env = scenes.environment(shapely.Polygon(
        [(-1.97, -0.97), (1.97, -0.97), (1.97, 0.43), (0.63, 0.43), (0.63, 1.77), (-1.97, 1.77)]
    ))  # fmt: skip
    found = perturbation(context_of(env))["perturbation"]
    turned = perturbation(context_of(env.transformed(math.pi / 2)))["perturbation"]
    # Rays to a corner fall to either side, and a match that such a ray tips ends elsewhere.
    apart = np.abs(turned - np.rot90(found, -1))
    assert np.nanquantile(apart, 0.95) < 0.002
    np.testing.assert_array_equal(np.isnan(turned), np.isnan(np.rot90(found, -1)))


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(width=st.floats(0.5, 7.0), depth=st.floats(0.5, 7.0), displacement=st.floats(0.02, 0.4))
def test_bounds(width: float, depth: float, displacement: float) -> None:
    context = context_of(scenes.room(width, depth), spacing=0.2, radius=0.4)
    found = perturbation(context, displacement=displacement)
    major, minor = found["perturbation"], found["perturbation_minor"]
    for values in found.values():
        assert (np.isnan(values) == ~context.free).all()
    assert np.nanmin(minor) >= 0.0
    assert (minor <= major)[context.free].all()
    # The window is two displacements about where the robot believes it is.
    assert np.nanmax(major) <= 3.0 * displacement * math.sqrt(2) + 1e-6


def test_a_fan_has_an_error_for_each_heading() -> None:
    fan = RangeScanner.planar(
        RangeSensor(max_range=4.0, std=0.03, resolution=0.001), 30, math.radians(120)
    )
    context = context_of(scenes.room(9.0, 3.0), fan, headings=4)
    layer = perturbation(context, iterations=10)["perturbation"]
    assert layer.shape == (*context.free.shape, 4)
    # Facing the near end both walls' ends are seen, facing along the corridor only the sides.
    x, y = context.points
    p = int(np.argmin(np.hypot(x - 1.5, y - 1.5)))
    values = layer[context.free][p]
    assert values[2] < 0.01
    assert values[0] == pytest.approx(SIZE, rel=0.02)


@pytest.mark.slow
def test_the_spacing_of_the_map_changes_nothing(demo: Environment) -> None:
    """The poses of a lattice are among those of one three times as fine."""
    fine, coarse = (context_of(demo, spacing=spacing, radius=0.8) for spacing in (0.25, 0.75))
    here, there = perturbation(fine), perturbation(coarse)
    x, y = coarse.points
    column = np.rint((x - fine.lattice.x[0]) / 0.25).astype(int)
    row = np.rint((y - fine.lattice.y[0]) / 0.25).astype(int)
    np.testing.assert_allclose(fine.lattice.x[column], x)
    assert len(x) > 1000
    for name, values in there.items():
        np.testing.assert_array_equal(values[coarse.free], here[name][row, column])


@pytest.mark.slow
def test_no_start_behind_a_wall() -> None:
    """The next room, 4 cm away, is where the robot believes it is, but not where it looks."""
    env = scenes.environment(
        shapely.union_all([shapely.box(0, 0, 3, 3), shapely.box(3.04, 0, 7, 3)])
    )
    alone = context_of(scenes.room(3.0, 3.0))
    found, expected = perturbation(context_of(env)), perturbation(alone)
    for x in (2.75, 2.85, 2.95):
        one, other = (
            at(context, layer["perturbation"], x, 1.45)
            for context, layer in ((context_of(env), found), (alone, expected))
        )
        assert one == pytest.approx(other, abs=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"displacement": 0.0}, "displacement is 0"),
        ({"displacement": math.nan}, "displacement"),
        ({"iterations": 0}, "iterations"),
        ({"tau": 0.5}, "tau is 0.5"),
    ],
)
def test_refuses_what_makes_no_sense(options: dict[str, float], message: str) -> None:
    context = context_of(scenes.room(1.0, 1.0))
    with pytest.raises(InputError, match=message):
        perturbation(context, **options)  # type: ignore[arg-type]
