"""A window of a panorama is the scanner itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import ambinav as an
from ambinav.ambiguity import panorama
from ambinav.ambiguity.feasible_poses import standing
from ambinav.ambiguity.model import AmbiguityModel, independent_tau
from ambinav.ambiguity.panorama import View, panoramas, view_radii
from ambinav.geometry.lattice import Lattice
from ambinav.geometry.obstacle import Obstacle
from ambinav.sensing.intensity import Intensity
from ambinav.sensing.mounting import Mount
from tests.geometry import scenes

SPACING, RADIUS = 0.1, 0.5
LASER = an.RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
SONAR = an.RangeSensor(
    max_range=3.0,
    std=0.05,
    resolution=0.01,
    aperture=math.radians(20),
    max_incidence=1.0,
    bias=0.02,
)
BRIGHT = replace(LASER, intensity=Intensity(wall=500, reflector=2000, std=200))
EIGHT = 2 * math.pi * np.arange(8) / 8


def fan(
    beams: int,
    aperture: float,
    yaw: float,
    x: float = 0.0,
    *,
    max_range: float = 4.0,
    std: float = 0.03,
) -> an.RangeScanner:
    mount: Mount = (x, 0.0, math.radians(yaw))
    sensor = replace(LASER, max_range=max_range, std=std)
    return an.RangeScanner.planar(sensor, beams, math.radians(aperture), mount)


SCANNERS = [
    [fan(12, 180, 0), fan(12, 180, 45), fan(7, 90, 10), fan(12, 180, 0, max_range=2.0)],
    [fan(12, 180, 0, 0.15), fan(12, 180, 90, 0.15), fan(12, 180, 90, 0.15, std=0.1)],
    [
        an.RangeScanner.mixed(an.RangeScanner.ring(SONAR, 4, 0.1), fan(9, 120, 0)),
        an.RangeScanner.mixed(an.RangeScanner.ring(SONAR, 4, 0.1, 0.3), fan(9, 120, 0)),
    ],
    # One that hears reflectors beside one that does not.
    [
        an.RangeScanner.mixed(fan(5, 90, 0), an.RangeScanner.planar(BRIGHT, 9, 2.0)),
        an.RangeScanner.planar(BRIGHT, 9, 2.0),
    ],
]


@pytest.mark.slow(kept=("scanners1-2048", "scanners3-20"))
@pytest.mark.parametrize(
    ("scanners", "most"),
    [(SCANNERS[0], 20), (SCANNERS[1], 2048), (SCANNERS[2], 30), (SCANNERS[3], 20)],
)
def test_every_view_is_the_map_of_its_scanner(
    scanners: Sequence[an.RangeScanner], most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(panorama, "MOST_BEAMS", most)
    monkeypatch.setattr(panorama, "TILE_BYTES", 1_000_000)
    env = scenes.scene(3, size=4.0, blocks=4, thin=2)
    # Its ends in no line of a ray: which side such a ray passes is left to rounding.
    env = env.edited(add=[Obstacle.panel(1.013, 0.0, 1.407, 0.0, reflective=True)])
    lattice = Lattice.over(env, SPACING)
    # A ring that is turned stands elsewhere.
    possible = np.hstack([standing(lattice, one, EIGHT) for one in scanners])
    point = np.random.default_rng(1).permutation(len(possible))[:80]
    views = [
        View(one, theta, independent_tau(one), 8 * k + h)
        for k, one in enumerate(scanners)
        for h, theta in enumerate(EIGHT)
    ]
    model = AmbiguityModel(radius=RADIUS, map_std=env.map_std, tau=1.0)
    found = np.full((len(views), len(point)), -1.0)
    for numbers, at, major, minor in view_radii(lattice, possible, point, views, model):
        for i in numbers:
            found[i, at] = (major + minor) / 2
    for k, one in enumerate(scanners):
        amap = an.build_map(env, one, SPACING, RADIUS, headings=8, store=False)
        expected = amap.dataset["level"].values[lattice.free][point].T
        np.testing.assert_allclose(found[8 * k : 8 * k + 8], expected, atol=1e-6)


def shared(views: Sequence[View], most: int = 2048) -> list[tuple[int, list[tuple[int, ...]]]]:
    """Beams of each panorama, and which views are one."""
    return [(one.scanner.beams, [row.views for row in one.rows]) for one in panoramas(views, most)]


def test_a_turned_scanner_is_a_turned_robot() -> None:
    views = [View(fan(12, 180, 0), math.pi / 2, 1.0), View(fan(12, 180, 90), 0.0, 1.0)]
    assert shared(views) == [(12, [(0, 1)])]
    # Not where it is mounted off the centre.
    views = [View(fan(12, 180, 0, 0.1), math.pi / 2, 1.0), View(fan(12, 180, 90, 0.1), 0.0, 1.0)]
    assert shared(views) == [(24, [(0,), (1,)])]
    # A whole turn is none.
    views = [View(fan(12, 180, 360), 0.0, 1.0), View(fan(12, 180, 0), 0.0, 1.0)]
    assert shared(views) == [(12, [(0, 1)])]


def test_a_panorama_takes_on_views_while_it_has_room() -> None:
    views = [View(fan(10, 90, 3.0 * yaw), 0.0, 1.0) for yaw in range(4)]
    # Ten beams, ten degrees apart.
    assert shared(views) == [(40, [(0,), (1,), (2,), (3,)])]
    assert shared(views, 20) == [(20, [(0,), (1,)]), (20, [(2,), (3,)])]
    assert shared(views, 1) == [(10, [(i,)]) for i in range(4)]


def test_a_longer_range_is_another_beam() -> None:
    views = [View(fan(5, 90, 0), 0.0, 1.0), View(fan(5, 90, 0, max_range=2.0), 0.0, 1.0)]
    assert shared(views) == [(10, [(0,), (1,)])]
    assert len(panoramas(views, 2048)[0].scanner.parts) == 2


def test_views_of_another_tau_share_beams_alone() -> None:
    views = [View(fan(5, 90, 0), 0.0, 1.0), View(fan(5, 90, 0), 0.0, 2.0)]
    assert shared(views) == [(5, [(0,), (1,)])]


def levels(views: Sequence[View]) -> NDArray[np.float64]:
    """Mean level of each view in a small room."""
    env = scenes.room(2.0, 1.5)
    lattice = Lattice.over(env, SPACING)
    possible = standing(lattice, views[0].scanner, np.zeros(1))
    model = AmbiguityModel(radius=RADIUS, map_std=env.map_std, tau=1.0)
    found = np.zeros(len(views))
    point = np.arange(len(possible))
    for numbers, _, major, minor in view_radii(lattice, possible, point, views, model):
        found[list(numbers)] += float((major + minor).sum())
    return found / (2 * len(point))


def test_a_turn_by_the_beams_spacing_changes_nothing_for_a_scanner_that_looks_all_around() -> None:
    views = [View(fan(24, 360, yaw), 0.0, 1.6) for yaw in (0, 15, 90, 165)]
    found = levels(views)
    np.testing.assert_allclose(found, found[0], atol=1e-6)
