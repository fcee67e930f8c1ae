"""The lattice of free poses and which neighbours a wall parts."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import STEPS, Lattice
from ambinav.runtime.errors import InputError
from tests.geometry import scenes


def parted(env: Environment, a: scenes.Array, b: scenes.Array) -> bool:
    step = shapely.LineString([a, b])
    lines = shapely.linestrings(env.segments.xy.reshape(-1, 2, 2))
    return bool(shapely.intersects(lines, step).any())


@pytest.mark.slow(kept=("2",))
@pytest.mark.parametrize("seed", [1, 2])
def test_links_are_those_that_no_segment_crosses(seed: int) -> None:
    env = scenes.scene(seed, size=8.0, blocks=15, thin=8).transformed(0.1234)
    lattice = Lattice.over(env, 0.25)
    x, y = lattice.points
    seen = crossed = 0
    for i, (row, column) in enumerate(lattice.rows_columns):
        for k, (dx, dy) in enumerate(STEPS):
            r, c = row + dy, column + dx
            linked = bool(lattice.links[i] >> k & 1)
            if not (0 <= r < len(lattice.y) and 0 <= c < len(lattice.x)) or not lattice.free[r, c]:
                assert not linked
                continue
            wall = parted(env, (x[i], y[i]), (lattice.x[c], lattice.y[r]))
            assert linked != wall
            seen += 1
            crossed += wall
    assert seen > 1000 and crossed > 20


def test_links_are_symmetric() -> None:
    lattice = Lattice.over(scenes.scene(3, size=20.0), 0.3)
    for i, (row, column) in enumerate(lattice.rows_columns):
        for k in range(8):
            if lattice.links[i] >> k & 1:
                j = lattice.index[row + STEPS[k, 1], column + STEPS[k, 0]]
                assert lattice.links[j] >> (k + 4) % 8 & 1


def test_a_thin_wall_parts_neighbours_that_are_both_free() -> None:
    env = scenes.room(2.0, 1.0, np.array([1.0, 0.0, 1.0, 1.0]))
    lattice = Lattice.over(env, 0.2)
    assert lattice.free[:5, :10].all()
    left = lattice.index[2, np.flatnonzero(lattice.x < 1.0)[-1]]
    east, west = 1 << 0, 1 << 4
    assert not lattice.links[left] & east
    assert not lattice.links[left + 1] & west
    assert lattice.links[left] & west and lattice.links[left + 1] & east


def test_points_lie_at_multiples_of_the_spacing_plus_half() -> None:
    lattice = Lattice.over(scenes.room(2.0, 1.0), 0.1)
    assert lattice.x == pytest.approx(np.arange(21) * 0.1 + 0.05)
    assert lattice.free.shape == (11, 21)
    assert lattice.free[:10, :20].all() and not lattice.free[10:].any()
    assert lattice.index.max() == 199 and (lattice.index[10] == -1).all()
    x, y = lattice.points
    assert x[:3] == pytest.approx([0.05, 0.15, 0.25]) and (y[:20] == y[0]).all()


def test_free_is_what_the_environment_says() -> None:
    env = scenes.scene(2, size=20.0)
    lattice = Lattice.over(env, 0.17)
    x, y = np.meshgrid(lattice.x, lattice.y)
    assert (lattice.free == env.is_free(x, y)).all()
    assert lattice.clearance(math.inf) == pytest.approx(np.asarray(env.clearance(*lattice.points)))


@pytest.mark.parametrize("spacing", [0.0, -1.0, math.nan, math.inf])
def test_spacing_must_be_a_positive_number(spacing: float) -> None:
    with pytest.raises(InputError, match=r"^spacing is .*; give (metres above 0|a finite number)"):
        Lattice.over(scenes.room(2.0, 1.0), spacing)


def test_spacing_larger_than_the_building() -> None:
    with pytest.raises(InputError, match=r"spacing is 5 m but the free space of scene is only 2"):
        Lattice.over(scenes.room(2.0, 1.0), 5.0)


def test_spacing_that_misses_every_free_point() -> None:
    sliver = scenes.environment(shapely.box(0.0, 0.0, 3.0, 0.01))
    with pytest.raises(InputError, match="no point of that lattice is free"):
        Lattice.over(sliver, 0.5)


def test_spacing_too_small_for_the_memory() -> None:
    with pytest.raises(InputError, match=r"which makes .* cells of scene"):
        Lattice.over(scenes.room(200.0, 100.0), 1e-3)
