"""Scanners: beam geometry, cones, scans and readings."""

from __future__ import annotations

import itertools
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

import ambinav.casting
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import Segments
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from ambinav.sensing.rays import cone_offsets

LASER = RangeSensor(name="laser", max_range=4.0, std=0.03, resolution=0.001)
SONAR = RangeSensor(
    name="sonar", max_range=6.0, std=0.02, resolution=0.01, aperture=math.radians(30)
)
MIRRORED = RangeSensor(
    name="mirrored",
    max_range=6.0,
    std=0.02,
    resolution=0.01,
    aperture=math.radians(30),
    max_incidence=math.radians(12),
)

Array = NDArray[Any]


def brute_force(
    env: Array,
    x: Array,
    y: Array,
    theta: Array,
    origin: Array,
    angle: Array,
    max_range: float,
    *,
    height: Array,
    elevation: Array,
    incidence: bool = True,
) -> tuple[Array, Array, Array]:
    """Cast rays at segments (N, 4) one by one: the plain stand-in for scans.scan_rays."""
    assert not elevation.any()
    assert not height.any()
    distance = np.full((len(x), len(angle)), np.inf, dtype=np.float32)
    segment = np.full(distance.shape, -1, dtype=np.int32)
    oblique = np.zeros(distance.shape if incidence else (0, 0), dtype=np.float32)
    for (i, t), (r, a) in itertools.product(enumerate(theta), enumerate(angle)):
        ox = x[i] + math.cos(t) * origin[r, 0] - math.sin(t) * origin[r, 1]
        oy = y[i] + math.sin(t) * origin[r, 0] + math.cos(t) * origin[r, 1]
        dx, dy = math.cos(t + a), math.sin(t + a)
        for s, (ax, ay, bx, by) in enumerate(env):
            ex, ey = bx - ax, by - ay
            cross = dx * ey - dy * ex
            if abs(cross) < 1e-12:
                continue
            along = ((ax - ox) * ey - (ay - oy) * ex) / cross
            part = ((ax - ox) * dy - (ay - oy) * dx) / cross
            if 0 <= part <= 1 and 0 <= along <= max_range and along < distance[i, r]:
                distance[i, r], segment[i, r] = along, s
                if incidence:
                    oblique[i, r] = math.acos(min(1.0, abs(cross) / math.hypot(ex, ey)))
    return distance, segment, oblique


@pytest.fixture
def plain_rays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cast by brute force, on environments that are plain arrays of segments."""
    stand_in = SimpleNamespace(scan_rays=brute_force)
    monkeypatch.setattr(ambinav.casting, "scans", stand_in, raising=False)


class Walls(np.ndarray):
    """Segments ax, ay, bx, by that stand in for a plan."""

    space = None


# A room of 6 m x 4 m about the origin.
ROOM: Any = np.array(
    [[-3, -2, 3, -2], [3, -2, 3, 2], [3, 2, -3, 2], [-3, 2, -3, -2]], dtype=np.float64
).view(Walls)
# One wall at x = 2 that runs on both sides as far as anything sees.
WALL: Any = np.array([[2.0, -50.0, 2.0, 50.0]]).view(Walls)


# -- beams -------------------------------------------------------------------------------------


def test_full_circle_has_the_angles_of_the_design() -> None:
    scanner = RangeScanner.planar(
        sensor=LASER, beams=60, aperture=2 * math.pi, mount=(0.1, 0.2, 0.3)
    )
    expected = 0.3 - math.pi + 2 * math.pi * np.arange(60) / 60
    assert scanner.mounts[:, 2] == pytest.approx(expected)
    assert (scanner.mounts[:, :2] == [0.1, 0.2]).all()
    assert scanner.sensors == (LASER,)
    assert scanner.beams == 60
    assert scanner.max_range == 4.0


def test_partial_fan_includes_both_ends_and_one_beam_looks_ahead() -> None:
    fan = RangeScanner.planar(LASER, 5, math.pi / 2, mount=(0, 0, 1.0))
    assert fan.mounts[:, 2] - 1.0 == pytest.approx(np.deg2rad([-45, -22.5, 0, 22.5, 45]))
    for aperture in (0.0, 1.0, 2 * math.pi):
        assert RangeScanner.planar(LASER, 1, aperture).mounts.tolist() == [[0, 0, 0]]


def test_ring_faces_outward() -> None:
    ring = RangeScanner.ring(SONAR, 4, 0.5, start=math.pi / 2)
    assert ring.mounts == pytest.approx(
        np.array([[0, 0.5, 90], [-0.5, 0, 180], [0, -0.5, 270], [0.5, 0, 360]])
        * [1, 1, math.pi / 180]
    )


def test_mixed_keeps_order_and_names_each_sensor_once() -> None:
    ring, fan = RangeScanner.ring(SONAR, 16, 0.2), RangeScanner.planar(LASER, 7, 1.0)
    both = RangeScanner.mixed(ring, fan, ring)
    assert both.sensors == (SONAR, LASER)
    assert both.sensor_of_beam.tolist() == [0] * 16 + [1] * 7 + [0] * 16
    assert both.kind == "mixed"
    assert (ring.kind, fan.kind) == ("sonar", "laser")
    assert both.max_range == 6.0


def test_arrays_are_read_only() -> None:
    scanner = RangeScanner.planar(LASER, 8, 1.0)
    with pytest.raises(ValueError, match="read-only"):
        scanner.mounts[0, 0] = 1.0


# -- rays and scans ----------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [0, 1, 4, 15, 30, 31])
def test_cone_rays_are_odd_fine_and_include_edges_and_axis(degrees: int) -> None:
    offsets = np.rad2deg(cone_offsets(math.radians(degrees)))
    assert len(offsets) % 2 == 1
    assert offsets[len(offsets) // 2] == pytest.approx(0.0, abs=1e-12)
    if degrees:
        assert offsets[[0, -1]] == pytest.approx([-degrees / 2, degrees / 2])
        assert np.diff(offsets).max() <= 2.0 + 1e-9
    else:
        assert len(offsets) == 1


def test_ray_table() -> None:
    both = RangeScanner.mixed(
        RangeScanner.ring(MIRRORED, 3, 0.2), RangeScanner.planar(LASER, 2, 1.0)
    )
    rays = both.rays()
    assert rays.start.tolist() == [0, 17, 34, 51, 52, 53]
    assert len(rays) == 53
    assert rays.angle[8] == both.mounts[0, 2]
    assert rays.origin[17:34] == pytest.approx(np.tile(both.mounts[1, :2], (17, 1)))
    assert rays.max_range[[0, -1]].tolist() == [6.0, 4.0]
    assert np.isinf(rays.max_incidence[-1])


@pytest.mark.usefixtures("plain_rays")
def test_scan_of_a_room() -> None:
    scanner = RangeScanner.planar(LASER, 4, 2 * math.pi)  # looks to 180, -90, 0, 90 degrees
    ranges = scanner.scan(ROOM, 0.5, 0.25, 0.0)
    assert ranges.dtype == np.float32
    assert ranges == pytest.approx([3.5, 2.25, 2.5, 1.75])
    # Turned by 90 degrees and shifted: 180 -> -90, -90 -> 0, 0 -> 90, 90 -> 180.
    assert scanner.scan(ROOM, 0.5, 0.25, math.pi / 2) == pytest.approx([2.25, 2.5, 1.75, 3.5])


@pytest.mark.usefixtures("plain_rays")
def test_scan_broadcasts_and_nothing_in_range_is_inf() -> None:
    scanner = RangeScanner.planar(LASER, 4, 2 * math.pi)
    x, theta = np.zeros((3, 1)), np.zeros(5)
    assert scanner.scan(ROOM, x, 0.0, theta).shape == (3, 5, 4)
    assert scanner.scan(ROOM, np.zeros(0), 0.0, 0.0).shape == (0, 4)
    far = scanner.scan(WALL, -3.0, 0.0, 0.0)
    assert np.isinf(far).all()


@pytest.mark.usefixtures("plain_rays")
def test_mount_moves_and_turns_the_beam() -> None:
    scanner = RangeScanner.from_mounts(LASER, [[0.5, 0.0, 0.0], [0.0, 0.5, math.pi / 2]])
    assert scanner.scan(ROOM, 0, 0, 0) == pytest.approx([2.5, 1.5])


@pytest.mark.usefixtures("plain_rays")
def test_a_cone_sees_the_smallest_over_its_rays() -> None:
    cone = RangeScanner.from_mounts(SONAR, [[0, 0, math.radians(40)]])
    # Against a wall at 2 m, the ray nearest to the normal is the one at 40 - 15 degrees.
    assert cone.scan(WALL, 0, 0, 0) == pytest.approx([2 / math.cos(math.radians(25))])
    # The same from the definition, ray by ray.
    rays = cone.rays()
    single = RangeScanner.from_mounts(
        RangeSensor(max_range=6.0, std=0.02, resolution=0.01),
        np.column_stack([rays.origin, rays.angle]),
    )
    for theta in np.linspace(-1.0, 1.0, 9):
        of_rays = single.scan(ROOM, 0.3, -0.4, theta)
        assert cone.scan(ROOM, 0.3, -0.4, theta) == pytest.approx([of_rays.min()])


@pytest.mark.usefixtures("plain_rays")
def test_oblique_surfaces_return_no_echo_and_hide_what_is_behind() -> None:
    cone = RangeScanner.from_mounts(MIRRORED, [[0, 0, 0]])
    assert cone.scan(WALL, 0, 0, 0) == pytest.approx([2.0])
    # Turned by 20 degrees the normal is outside the cone, but 5 degrees off its edge: echo.
    edge = 2 / math.cos(math.radians(5))
    assert cone.scan(WALL, 0, 0, math.radians(20)) == pytest.approx([edge])
    # By 28 degrees every ray meets the wall at 13 degrees or more: no echo.
    assert np.isinf(cone.scan(WALL, 0, 0, math.radians(28))).all()
    # A screen at 45 degrees before the wall echoes nothing, and hides the wall all the same.
    hidden: Any = np.vstack([WALL, [[0.5, -1.0, 2.5, 1.0]]]).view(Walls)
    assert np.isinf(cone.scan(hidden, 0, 0, 0)).all()


@pytest.mark.usefixtures("plain_rays")
def test_each_sensor_has_its_own_range() -> None:
    both = RangeScanner.from_mounts([LASER, SONAR], np.zeros((2, 3)), [0, 1])
    ranges = both.scan(WALL, -3.0, 0.0, 0.0)  # the wall is 5 m away: beyond 4, within 6
    assert np.isinf(ranges[0])
    assert ranges[1] == pytest.approx(5.0)


@pytest.mark.usefixtures("plain_rays")
def test_permuting_the_beams_permutes_the_scan() -> None:
    platform = RangeScanner.mixed(
        RangeScanner.ring(MIRRORED, 8, 0.2), RangeScanner.planar(LASER, 9, 3.0, (0.1, 0, 0))
    )
    order = np.random.default_rng(5).permutation(platform.beams)
    shuffled = RangeScanner.from_mounts(
        platform.sensors, platform.mounts[order], platform.sensor_of_beam[order]
    )
    assert [shuffled.sensors[i].name for i in shuffled.sensor_of_beam] == [
        platform.sensors[i].name for i in platform.sensor_of_beam[order]
    ]
    x, theta = np.array([0.0, 0.4, -1.0]), np.array([0.1, 2.0, 4.0])
    expected = platform.scan(ROOM, x, 0.3, theta)[:, order]
    assert (shuffled.scan(ROOM, x, 0.3, theta) == expected).all()


@pytest.mark.usefixtures("plain_rays")
def test_scanning_in_pieces_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    ring = RangeScanner.ring(SONAR, 4, 0.1)
    x = np.linspace(-2, 2, 11)
    whole = ring.scan(ROOM, x, 0.0, 0.3)
    monkeypatch.setattr("ambinav.sensing.casting.RAYS_AT_ONCE", 3 * len(ring.rays()))
    assert (ring.scan(ROOM, x, 0.0, 0.3) == whole).all()


@pytest.mark.slow
@pytest.mark.usefixtures("plain_rays")
def test_read_uses_each_sensor_and_gives_inf_for_no_echo() -> None:
    both = RangeScanner.from_mounts([LASER, SONAR], np.zeros((2, 3)), [0, 1])
    rng = np.random.default_rng(2)
    readings = both.read(WALL, np.full(4000, -3.0), 0.0, 0.0, rng)
    assert np.isinf(readings[:, 0]).mean() == pytest.approx(0.99, abs=0.01)
    echoes = readings[:, 1][np.abs(readings[:, 1] - 5.0) < 0.2]
    assert len(echoes) > 3900
    assert echoes.mean() == pytest.approx(5.0, abs=2e-3)
    assert echoes.std() == pytest.approx(0.02, rel=0.1)
    again = both.read(WALL, np.full(4000, -3.0), 0.0, 0.0, np.random.default_rng(2))
    assert (again == readings).all()


@pytest.mark.usefixtures("plain_rays")
def test_bad_poses_and_ranges() -> None:
    scanner = RangeScanner.planar(LASER, 4, 2 * math.pi)
    with pytest.raises(InputError, match="pose: theta is nan"):
        scanner.scan(ROOM, 0.0, 0.0, [0.0, math.nan])
    with pytest.raises(InputError, match="the last axis must be the 4 beams"):
        scanner.capture(np.zeros((2, 3)), np.random.default_rng(0))
    with pytest.raises(InputError, match="rng is 0; give a numpy Generator"):
        scanner.read(ROOM, 0.0, 0.0, 0.0, 0)  # type: ignore[arg-type]


def test_the_real_caster_agrees_with_brute_force_and_closed_forms() -> None:
    box = shapely.box(-3.0, -2.0, 3.0, 2.0)
    env = Environment(Segments(ROOM, np.zeros(4, dtype=np.uint8)), box, name="room")
    platform = RangeScanner.mixed(
        RangeScanner.ring(MIRRORED, 8, 0.2), RangeScanner.planar(LASER, 40, 4.0, (0.1, 0, 0.2))
    )
    rng = np.random.default_rng(11)
    x, y = rng.uniform(-2.5, 2.5, 20), rng.uniform(-1.5, 1.5, 20)
    theta = rng.uniform(-4, 4, 20)
    rays = platform.rays()
    up = {"height": rays.height, "elevation": rays.elevation}
    distance, _, incidence = brute_force(ROOM, x, y, theta, rays.origin, rays.angle, 6.0, **up)
    expected = rays.nearest(rays.echoes(distance, incidence))
    assert platform.scan(env, x, y, theta) == pytest.approx(expected, abs=1e-5)
    assert np.isinf(expected).any()
    four = RangeScanner.planar(LASER, 4, 2 * math.pi)
    assert four.scan(env, 0.5, 0.25, 0.0) == pytest.approx([3.5, 2.25, 2.5, 1.75])


def test_a_sensor_outside_the_free_space_reads_nothing() -> None:
    box = shapely.box(-3.0, -2.0, 3.0, 2.0)
    env = Environment(Segments(ROOM, np.zeros(4, dtype=np.uint8)), box, name="room")
    ring = RangeScanner.ring(SONAR, 4, 0.2)
    assert np.isnan(ring.scan(env, 2.9, 0.0, 0.0)).tolist() == [True, False, False, False]
    with pytest.raises(InputError, match=r"at x = 2\.9, y = 0 a sensor .* outside the free space"):
        ring.read(env, [0.0, 2.9], 0.0, 0.0, np.random.default_rng(0))
