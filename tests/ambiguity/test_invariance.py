"""Turning, shifting, sampling finer, rasterising and permuting change (nearly) nothing."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from PIL import Image

from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import Segments
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.sensing import RangeScanner
from tests.geometry import scenes

pytestmark = pytest.mark.slow  # they share maps that take seconds

# Medians and 95th percentiles a little above those of benchmarks/results/invariance.md.
TURNED, HALVED, DOUBLED = (0.0025, 0.04), (0.0025, 0.025), (0.005, 0.07)
RASTERISED, BY_DEFAULT = 0.001, 0.012
SHIFT = (0.037, 0.061)
CELL = 0.05

Points = NDArray[np.float64]


@pytest.fixture(scope="module")
def points(demo: Environment) -> Points:
    """3000 points anywhere in the free space, shape (2, N)."""
    xmin, ymin, xmax, ymax = demo.bounds
    xy = np.random.default_rng(0).uniform((xmin, ymin), (xmax, ymax), (9000, 2))
    return xy[np.asarray(demo.is_free(*xy.T, 0.05))][:3000].T


@pytest.fixture(scope="module")
def coarse_map(demo: Environment, laser: RangeScanner) -> AmbiguityMap:
    """The demo building at twice the usual spacing."""
    return build_map(demo, laser, spacing=0.2)


def differences(one: AmbiguityMap, at: Points, other: AmbiguityMap, there: Points) -> Points:
    """How far `level` differs at the same physical points."""
    found = np.abs(np.asarray(one.sample("level", *at)) - np.asarray(other.sample("level", *there)))
    # A point beside a wall may have no free cell in one of the two lattices.
    assert np.isnan(found).mean() < 0.01
    return found[np.isfinite(found)]


def agree(found: Points, most: tuple[float, float]) -> None:
    median, high = np.median(found), np.percentile(found, 95)
    print(f"median {median:.4f}, 95th percentile {high:.4f}")
    assert median <= most[0] and high <= most[1]


@pytest.mark.slow(kept=("30",))
@pytest.mark.parametrize("degrees", [0, 6, 18, 30, 42])
def test_turned_and_shifted(
    demo: Environment, demo_map: AmbiguityMap, laser: RangeScanner, points: Points, degrees: float
) -> None:
    angle = math.radians(degrees)
    other = build_map(demo.transformed(angle, *SHIFT), laser)
    c, s = math.cos(angle), math.sin(angle)
    there = np.array([[c, -s], [s, c]]) @ points + np.array(SHIFT)[:, None]
    agree(differences(demo_map, points, other, there), TURNED)


def test_direction_turns_with_the_building(
    demo: Environment, demo_map: AmbiguityMap, laser: RangeScanner, points: Points
) -> None:
    angle = math.radians(42)
    other = build_map(demo.transformed(angle), laser, spacing=0.2)
    there = (
        np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]) @ points
    )
    weak = np.asarray(demo_map.sample("zone", *points)) == 2
    turned = np.asarray(other.sample("direction", *there))
    off = turned - np.asarray(demo_map.sample("direction", *points)) - angle
    off = np.degrees(np.abs(np.arctan(np.tan(off))))[weak & np.isfinite(off)]
    assert np.percentile(off, 95) < 2.0


@pytest.mark.sweep
def test_half_the_spacing(demo: Environment, laser: RangeScanner, points: Points) -> None:
    # A quarter of the building; walls stand along the cut.
    xmin, ymin, xmax, ymax = demo.bounds
    quarter = shapely.box(xmin, ymin, (xmin + xmax) / 2, (ymin + ymax) / 2)
    xy = np.vstack([demo.segments.xy, scenes.rings(quarter)])
    kind = np.concatenate([demo.segments.kind, np.zeros(4, dtype=np.uint8)])
    part = Environment(Segments(xy, kind), demo.free & quarter)
    inside = points[:, np.asarray(part.is_free(*points, 0.05))]
    assert inside.shape[1] > 500
    one, other = (build_map(part, laser, spacing=spacing) for spacing in (0.1, 0.05))
    agree(differences(one, inside, other, inside), HALVED)


def test_twice_the_spacing(
    demo_map: AmbiguityMap, coarse_map: AmbiguityMap, points: Points
) -> None:
    agree(differences(demo_map, points, coarse_map, points), DOUBLED)


def test_permuted_beams(demo: Environment, laser: RangeScanner) -> None:
    shuffled = np.random.default_rng(4).permutation(laser.beams)
    permuted = RangeScanner.from_mounts(laser.sensors, laser.mounts[shuffled])
    one, other = (
        build_map(demo, scanner, spacing=0.3, tau=4.0).dataset for scanner in (laser, permuted)
    )
    for layer in ("ambiguity", "major", "minor", "level", "heading"):
        # The kernel sums in float32, in the order of the beams.
        assert np.nanmax(np.abs(one[layer].values - other[layer].values)) < 2e-4, layer


def rasterise(env: Environment, folder: Path) -> Path:
    """Draw the environment as a map_server map: walls of two cells around the free space."""
    xmin, ymin, xmax, ymax = env.bounds
    x0, y0 = xmin - 0.5, ymin - 0.5
    columns, rows = (
        math.ceil((high - low + 1.0) / CELL) for low, high in ((xmin, xmax), (ymin, ymax))
    )
    x, y = np.meshgrid(x0 + (np.arange(columns) + 0.5) * CELL, y0 + (np.arange(rows) + 0.5) * CELL)
    free = shapely.contains_xy(env.free, x, y)
    walls = shapely.multilinestrings(shapely.linestrings(env.segments.xy.reshape(-1, 2, 2)))
    shapely.prepare(walls)
    # Half a cell to either side catches walls without thickness.
    near = shapely.dwithin(walls, shapely.points(x, y), 0.5 * CELL * math.sqrt(2))
    thin = near & shapely.contains_xy(env.free.buffer(-CELL), x, y)
    around = ~free & shapely.dwithin(env.free, shapely.points(x, y), 2 * CELL)
    pixels = np.full(free.shape, 205, dtype=np.uint8)
    pixels[free] = 254
    pixels[around | thin] = 0
    Image.fromarray(pixels[::-1]).save(folder / "demo.pgm")
    (folder / "demo.yaml").write_text(
        f"image: demo.pgm\nresolution: {CELL}\norigin: [{x0}, {y0}, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return folder / "demo.yaml"


@pytest.mark.sweep
def test_through_a_rasterised_map(
    demo: Environment, coarse_map: AmbiguityMap, laser: RangeScanner, points: Points, tmp_path: Path
) -> None:
    drawn = load_environment(rasterise(demo, tmp_path))
    # The same uncertainty of the walls on both sides.
    one = build_map(demo, laser, spacing=0.2, map_std=drawn.map_std)
    other = build_map(drawn, laser, spacing=0.2)
    clear = points[:, np.asarray(demo.clearance(*points)) > 0.15]
    found = differences(one, clear, other, clear)
    print(f"median {np.median(found):.4f}, 95th percentile {np.percentile(found, 95):.4f}")
    assert np.median(found) <= RASTERISED
    # By the default map_std as well.
    found = differences(coarse_map, clear, other, clear)
    print(f"default map_std: median {np.median(found):.4f}")
    assert np.median(found) <= BY_DEFAULT
