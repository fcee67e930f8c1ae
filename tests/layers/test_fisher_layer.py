"""The Fisher bound against finite differences of the ray caster and against Censi's formula."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambinav.geometry.segments import FRONTIER, Segments
from ambinav.layers.build import with_layers
from ambinav.layers.context import LayerContext
from ambinav.layers.fisher import fisher, ray_information
from ambinav.layers.marginal import marginal_radii
from ambinav.localization.expected_covariance import expected_covariance
from ambinav.localization.information import scan_information
from ambinav.localization.information_gain import information_gain
from ambinav.map_building.build import build_map
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from tests.geometry import scenes
from tests.layers import brute_rays, oracle_cases

# Shifted, so that no beam meets a corner exactly.
ROOM = scenes.room(5.0, 3.5).transformed(0.13, 0.011, 0.007)
VARIANCE = 0.03**2 + 0.001**2 / 12 + 0.02**2
POSES = np.array([[1.3, 1.1, 0.2], [2.6, 2.2, -1.0], [3.9, 1.2, 2.5]])


def fan(mount: tuple[float, float, float] = (0.0, 0.0, 0.0), reach: float = 2.2) -> RangeScanner:
    sensor = RangeSensor(max_range=reach, std=0.03, resolution=0.001)
    return RangeScanner.planar(sensor, 24, 2 * math.pi, mount=mount)


def differences(scanner: RangeScanner, pose: np.ndarray) -> np.ndarray:
    """Change of each beam's true range by x, y, theta, (B, 3), by casting beside the pose."""
    h = 1e-5
    out = np.empty((scanner.beams, 3))
    for axis in range(3):
        ends = []
        for sign in (1.0, -1.0):
            x, y, theta = pose + sign * h * np.eye(3)[axis]
            c, s = math.cos(theta), math.sin(theta)
            mx, my, yaw = scanner.mounts.T
            ends.append(
                np.asarray(ROOM.cast(x + c * mx - s * my, y + s * mx + c * my, theta + yaw, 100.0))
            )
        out[:, axis] = (ends[0] - ends[1]) / (2 * h)
    return out


@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (0.2, -0.1, 0.4)])
def test_each_ray_against_finite_differences(mount: tuple[float, float, float]) -> None:
    scanner = fan(mount)
    found = ray_information(ROOM, scanner, POSES, 0.02)
    for pose, rays in zip(POSES, found, strict=True):
        hits = np.isfinite(scanner.scan(ROOM, *pose))
        g = differences(scanner, pose)
        expected = g[:, :, None] * g[:, None, :] / VARIANCE * hits[:, None, None]
        np.testing.assert_allclose(rays, expected, rtol=1e-4, atol=1e-3)
        assert 0 < hits.sum() < len(hits)


def censi(pose: np.ndarray, *, incidence: bool) -> np.ndarray:
    """Sum of g g^T / sigma^2 by the paper's formula, with its angles, (3, 3)."""
    look = pose[2] - math.pi + 2 * math.pi * np.arange(24) / 24
    r, hit = scenes.cast_slowly(ROOM.segments.xy, np.full(24, pose[0]), np.full(24, pose[1]), look)
    wall = ROOM.segments.xy[hit]
    a = np.arctan2(wall[:, 3] - wall[:, 1], wall[:, 2] - wall[:, 0]) + math.pi / 2
    b = a - look
    g = np.stack([np.cos(a) / np.cos(b), np.sin(a) / np.cos(b), r * np.tan(b)])
    if not incidence:
        g = np.stack([np.cos(a), np.sin(a), r * np.sin(b)])
    g = g[:, r < 2.2]
    return np.asarray(g @ g.T / VARIANCE)


@pytest.mark.parametrize("incidence", [True, False])
def test_whole_scan_against_the_formula(incidence: bool) -> None:
    whole = ray_information(ROOM, fan(), POSES, 0.02, incidence=incidence).sum(axis=1)
    for pose, found in zip(POSES, whole, strict=True):
        np.testing.assert_allclose(found, censi(pose, incidence=incidence), rtol=1e-6, atol=1e-6)


def test_rays_add_up_to_the_information_of_the_localizers() -> None:
    whole = ray_information(ROOM, fan(), POSES, 0.02).sum(axis=1)
    np.testing.assert_allclose(whole, scan_information(ROOM, fan(), POSES, 0.02), rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("incidence", [True, False])
def test_the_layer_is_the_marginal_covariance(incidence: bool) -> None:
    amap = build_map(ROOM, fan(), 0.5, map_std=0.02, tau=1.0)
    options = {"odometry_std": 0.3, "heading_std": 0.02, "incidence": incidence}
    found = with_layers(amap, "fisher", fisher=options)
    for name in ("fisher", "fisher_minor", "fisher_direction"):
        assert np.isnan(found.dataset[name].values).sum() == (~amap.dataset["free"].values).sum()
    x, y = LayerContext.of(amap).points
    for k in range(0, len(x), 3):
        pose = np.array([x[k], y[k], 0.0])
        prior = np.diag([0.3**-2, 0.3**-2, 0.02**-2])
        covariance = np.linalg.inv(censi(pose, incidence=incidence) + prior)[:2, :2]
        values, vectors = np.linalg.eigh(covariance)
        at = {"x": x[k], "y": y[k]}
        layers = {n: float(found.dataset[n].sel(at, method="nearest")) for n in found.layers}
        if np.abs(differences(fan(), pose)).max() > 15.0:
            continue  # a beam grazes: the layer holds 1 / cos b
        assert layers["fisher"] == pytest.approx(math.sqrt(values[1]), rel=1e-4)
        assert layers["fisher_minor"] == pytest.approx(math.sqrt(values[0]), rel=1e-4)
        axis = math.atan2(vectors[1, 1], vectors[0, 1])
        off = math.remainder(layers["fisher_direction"] - axis, math.pi)
        assert abs(off) * (values[1] / values[0] - 1.0) < 1e-3


def test_a_corridor_leaves_the_prior_along_it() -> None:
    angle = 0.3
    corridor = scenes.room(40.0, 2.0).transformed(angle)
    amap = with_layers(build_map(corridor, fan(reach=5.0), 0.5), "fisher")
    x, y = 20 * math.cos(angle) - math.sin(angle), 20 * math.sin(angle) + math.cos(angle)
    assert amap.sample("fisher", x, y) == pytest.approx(0.25, rel=1e-3)
    assert amap.sample("fisher_direction", x, y) == pytest.approx(angle, abs=0.01)
    assert amap.sample("fisher_minor", x, y) < 0.02


def test_a_frontier_tells_nothing() -> None:
    room = scenes.room(2.0, 2.0)
    room.segments = Segments(room.segments.xy, np.full(4, FRONTIER))
    assert not ray_information(room, fan(), [[1.0, 1.0, 0.1]], 0.02).any()


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 1.0), st.floats(0.01, 1.0), st.floats(-3.0, 3.0))
def test_marginal_radii_are_those_of_the_inverse(
    seed: int, place: float, turn: float, angle: float
) -> None:
    root = np.random.default_rng(seed).normal(scale=5.0, size=(2, 3, 3))
    information = root @ root.transpose(0, 2, 1)
    major, minor, direction = marginal_radii(information, place, turn)
    inverse = np.linalg.inv(information + np.diag([place**-2, place**-2, turn**-2]))
    values = np.linalg.eigvalsh(inverse[:, :2, :2])
    np.testing.assert_allclose(major, np.sqrt(values[:, 1]), rtol=1e-6)
    np.testing.assert_allclose(minor, np.sqrt(values[:, 0]), rtol=1e-6)
    assert (major <= place * (1 + 1e-9)).all()
    # Turning the map turns the axis and nothing else.
    c, s = math.cos(angle), math.sin(angle)
    turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    again = marginal_radii(turned @ information @ turned.T, place, turn)
    np.testing.assert_allclose(again[0], major, rtol=1e-6)
    off = np.abs(np.sin(again[2] - direction - angle))
    assert (off * (major / minor - 1.0) < 1e-4).all()


def test_beams_that_share_evidence_tell_less() -> None:
    amap = build_map(ROOM, fan(), 0.5)
    one, four = (
        with_layers(amap, "fisher", fisher={"tau": tau, "odometry_std": 1e3, "heading_std": 1e3})
        for tau in (1.0, 4.0)
    )
    mask = one.dataset["fisher"].values < 1.0
    assert mask.sum() > 50
    np.testing.assert_allclose(
        four.dataset["fisher"].values[mask], 2 * one.dataset["fisher"].values[mask], rtol=1e-3
    )
    with pytest.raises(InputError, match=r"tau is 0\.5"):
        with_layers(amap, "fisher", fisher={"tau": 0.5})


@pytest.mark.parametrize("beams", [180, 360, 720])
@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (0.1, 0.05, 0.0)])
def test_the_layer_is_the_covariance_to_expect(
    beams: int, mount: tuple[float, float, float]
) -> None:
    """All beams, thinned as the map is: for the same prior the layer is the bound itself."""
    scanner = RangeScanner.planar(
        RangeSensor(max_range=6.0, std=0.02, resolution=0.01), beams, 2 * math.pi, mount=mount
    )
    amap = build_map(ROOM, scanner, 0.5, map_std=0.05, layers="fisher")
    context = LayerContext.of(amap)
    assert context.scanner.beams == 60
    poses = context.poses()
    prior = np.diag([0.25**2, 0.25**2, context.model.sigma_theta**2])
    # A map without headings is of the scanner in the robot's centre.
    expected = expected_covariance(
        amap, poses, source="fisher", scanner=scanner.centred, prior=prior
    )
    values = np.linalg.eigvalsh(expected[:, :2, :2])
    layers = [amap.dataset[name].values[context.free] for name in ("fisher", "fisher_minor")]
    np.testing.assert_allclose(layers[0], np.sqrt(values[:, 1]), rtol=1e-5)
    np.testing.assert_allclose(layers[1], np.sqrt(values[:, 0]), rtol=1e-5)
    before = np.broadcast_to(np.linalg.inv(prior), (len(poses), 3, 3))
    information = before + scan_information(ROOM, scanner.centred, poses, 0.05)
    np.testing.assert_allclose(np.linalg.inv(information), expected, rtol=1e-9, atol=1e-15)
    gain = information_gain(amap, scanner.centred, poses[3], prior, unit="nats")
    half = 0.5 * (np.linalg.slogdet(prior)[1] - np.linalg.slogdet(expected[3])[1])
    assert gain.total == pytest.approx(half, rel=1e-9)


def test_more_beams_tell_more() -> None:
    """Beside 60 beams a turn 240 halve the bound, which a thinned scan would not."""
    sensor = RangeSensor(max_range=6.0, std=0.02, resolution=0.01)
    few, many = (
        build_map(ROOM, RangeScanner.planar(sensor, n, 2 * math.pi), 0.5, layers="fisher")
        for n in (60, 240)
    )
    ratio = few.dataset["fisher"].values / many.dataset["fisher"].values
    assert np.nanmedian(ratio) == pytest.approx(2.0, rel=0.1)


def to_line(
    pose: np.ndarray, n: np.ndarray, point: np.ndarray, mx: float, my: float, turn: float
) -> float:
    """Length of a ray from a sensor at (mx, my) to the line through a point across n."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    start = np.array([pose[0] + c * mx - s * my, pose[1] + s * mx + c * my])
    u = np.array([math.cos(pose[2] + turn), math.sin(pose[2] + turn)])
    return float(n @ (point - start) / (n @ u))


def to_point(pose: np.ndarray, point: np.ndarray, mx: float, my: float) -> float:
    """Distance from a sensor at (mx, my) to a point."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return math.hypot(point[0] - pose[0] - c * mx + s * my, point[1] - pose[1] - s * mx - c * my)


def brute_information(
    context: LayerContext, pose: np.ndarray, scanner: RangeScanner, heading: float
) -> np.ndarray:
    """Each beam, moved a little: (3, 3).

    A ray, and the edge of a cone, against the line that it ends on; within a cone what is nearest
    stays the point that it is.
    """
    env, h = context.environment, 1e-5
    total = np.zeros((3, 3))
    for sensor, (mx, my, yaw) in zip(
        (scanner.sensors[i] for i in scanner.sensor_of_beam), scanner.mounts, strict=True
    ):
        c, s = math.cos(heading), math.sin(heading)
        found, which, look = brute_rays.cone(
            env.segments.xy, pose[0] + c * mx - s * my, pose[1] + s * mx + c * my, heading + yaw,
            sensor.aperture, sensor.max_range, sensor.max_incidence or math.inf,
        )  # fmt: skip
        k = int(which)
        if k < 0 or not found > sensor.min_range or env.segments.kind[k] == FRONTIER:
            continue
        x0, y0, x1, y1 = env.segments.xy[k]
        n = np.array([y0 - y1, x1 - x0]) / math.hypot(x1 - x0, y1 - y0)
        here = np.array([*pose[:2], heading])
        u = np.array([math.cos(float(look)), math.sin(float(look))])
        measure: Callable[[np.ndarray], float]
        if abs(float(look) - heading - yaw) < 0.5 * sensor.aperture - 1e-9:
            start = np.array([pose[0] + c * mx - s * my, pose[1] + s * mx + c * my])
            measure = partial(to_point, point=start + float(found) * u, mx=mx, my=my)
        else:
            line = {"n": n, "point": np.array([x0, y0]), "turn": float(look) - heading}
            measure = partial(to_line, mx=mx, my=my, **line)
        g = np.array([measure(here + d) - measure(here - d) for d in h * np.eye(3)]) / (2 * h)
        g *= min(abs(n @ u) / 0.05, 1.0)  # 1 / cos b is held at 20
        total += np.outer(g, g) / (
            sensor.std_at(float(found)) ** 2 + sensor.resolution**2 / 12 + context.map_std**2
        )
    return total


@pytest.mark.slow(kept=("scanner1-recorded",))
@pytest.mark.parametrize("which", oracle_cases.BUILDINGS)
@pytest.mark.parametrize("scanner", [oracle_cases.laser(), oracle_cases.sonars()])
def test_against_brute_force(
    which: str, scanner: RangeScanner, request: pytest.FixtureRequest
) -> None:
    env = oracle_cases.building(which, request)
    context = LayerContext.of(build_map(env, scanner, 0.5, map_std=0.03), env)
    found = fisher(context)
    x, y = context.points
    rows, columns = np.nonzero(context.free)
    off = []
    for p, h in oracle_cases.some(context, 40, 7):
        heading = float(context.headings[h])
        information = brute_information(context, np.array([x[p], y[p]]), scanner, heading)
        prior = np.diag([0.25**-2, 0.25**-2, context.model.sigma_theta**-2])
        values = np.linalg.eigvalsh(np.linalg.inv(information + prior)[:2, :2])
        at = (rows[p], columns[p], h) if context.has_theta else (rows[p], columns[p])
        layer = [float(found[name][at]) for name in ("fisher", "fisher_minor")]
        off.append(np.abs(np.log(layer) - 0.5 * np.log(values[::-1])).max())
    print(np.sort(off)[-5:])
    # A ray into a corner may end on either wall.
    assert np.quantile(off, 0.9) < 1e-6
    assert np.max(off) < 0.05
