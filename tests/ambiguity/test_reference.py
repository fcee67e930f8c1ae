"""The fast kernel against the plain NumPy reference, for scanners of every kind."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ambinav.ambiguity import reference
from ambinav.ambiguity.model import AmbiguityModel, independent_tau
from ambinav.ambiguity.tensor import relative_radii
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER, Segments
from ambinav.map_building.build import build_map
from ambinav.sensing import RangeScanner, RangeSensor
from ambinav.sensing.curves import Polynomial
from tests.geometry import scenes

TURN = 2 * math.pi
COARSE = RangeScanner.planar(
    RangeSensor(max_range=4.0, std=0.005, resolution=0.15, random_share=0.02), 24, TURN
)
OFF_CENTRE = RangeScanner.planar(
    RangeSensor(max_range=3.0, min_range=0.3, std=0.01, resolution=0.01),
    20, math.radians(200), mount=(0.2, 0.05, 0.3),
)  # fmt: skip
NOISY = RangeSensor(max_range=3.5, std=Polynomial((0.01, 0.015)), resolution=0.02)
SONAR = RangeSensor(
    max_range=5.0, min_range=0.1, std=0.02, resolution=0.1, aperture=math.radians(24),
    max_incidence=math.radians(40), lost_share=0.05,
)  # fmt: skip
MIXED = RangeScanner.mixed(RangeScanner.ring(SONAR, 12, 0.15), RangeScanner.planar(NOISY, 24, TURN))


def worst(
    env: Environment,
    scanner: RangeScanner,
    *,
    spacing: float = 0.25,
    headings: int | None = None,
    poses: int = 6,
    seed: int = 3,
    tau: float | None = None,
) -> float:
    """Largest difference between the map and the reference at random free poses."""
    tau = independent_tau(scanner) if tau is None else tau
    dataset = build_map(env, scanner, spacing=spacing, headings=headings, tau=tau).dataset
    model = AmbiguityModel(radius=0.5, map_std=env.map_std, tau=tau)
    rng = np.random.default_rng(seed)
    cells = np.argwhere(dataset["free"].values)
    greatest = 0.0
    for row, column in cells[rng.permutation(len(cells))[:poses]]:
        k = int(rng.integers(headings)) if headings else 0
        theta = TURN * k / headings if headings else 0.0
        x, y = float(dataset["x"][column]), float(dataset["y"][row])
        expected = relative_radii(
            reference.pose_sums(env, scanner, model, spacing, x, y, theta)[None]
        )
        for name in ("ambiguity", "major", "minor", "level"):
            value = dataset[name].values[row, column]
            value = value[k] if headings else value
            greatest = max(greatest, abs(float(value) - float(expected[name][0])))
    return greatest


@pytest.fixture(scope="module")
def turned(demo: Environment) -> Environment:
    """The demo at an odd angle: no beam passes exactly through a corner."""
    return demo.transformed(0.1234, 0.017, 0.023)


def with_frontiers() -> Environment:
    """A scene of which every third border segment is a frontier, thin walls in it."""
    env = scenes.scene(5, size=9.0, blocks=12, thin=10).transformed(0.1234)
    kind = np.where(np.arange(len(env.segments)) % 3 == 0, FRONTIER, 0)
    return Environment(Segments(env.segments.xy, kind), env.free, name="frontiers", resolution=0.05)


def test_laser(turned: Environment, laser: RangeScanner) -> None:
    assert worst(turned, laser) < 1e-4


@pytest.mark.slow
def test_laser_whose_beams_are_all_independent(turned: Environment, laser: RangeScanner) -> None:
    assert worst(turned, laser, tau=1.0) < 1e-4


@pytest.mark.slow
def test_coarse_bins(turned: Environment) -> None:
    assert worst(turned, COARSE) < 1e-4


@pytest.mark.slow
def test_sonar_ring(turned: Environment) -> None:
    assert worst(turned, RangeScanner.from_preset("polaroid-6500-ring")) < 1e-4


@pytest.mark.slow
def test_partial_scanner_off_the_centre(turned: Environment) -> None:
    assert worst(turned, OFF_CENTRE, headings=3) < 1e-4


@pytest.mark.slow
def test_bias_that_grows_with_the_range(turned: Environment) -> None:
    sensor = RangeSensor(
        max_range=4.0, std=0.02, resolution=0.01, bias=Polynomial((0.02, -0.2, 0.02))
    )
    assert worst(turned, RangeScanner.planar(sensor, 30, TURN)) < 1e-4


@pytest.mark.slow
def test_mixed_scanner(turned: Environment) -> None:
    assert worst(turned, MIXED) < 1e-4


@pytest.mark.slow(kept=("coarse", "off"))
@pytest.mark.parametrize("scanner", [COARSE, MIXED, OFF_CENTRE], ids=["coarse", "mixed", "off"])
def test_frontiers_and_thin_walls(scanner: RangeScanner) -> None:
    env = with_frontiers()
    assert (~env.segments.walls).sum() > 10
    headings = None if scanner.looks_all_around else 2
    assert worst(env, scanner, headings=headings) < 1e-4
