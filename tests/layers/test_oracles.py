"""Layers of single poses against brute force that shares nothing with them (`brute`).

On a drawn building and on a recorded map with unknown space, for two scanners each.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import Environment
from ambinav.layers.clearance import clearance
from ambinav.layers.context import LayerContext
from ambinav.layers.gfm import gfm
from ambinav.layers.perturbation import perturbation
from ambinav.layers.wall_normals import wall_normals
from ambinav.map_building.build import build_map
from ambinav.sensing import RangeScanner, RangeSensor
from tests.geometry import scenes
from tests.layers import brute, oracle_cases
from tests.layers.brute import Floats

POSES = 30
STD = 0.03
LASER = RangeSensor(max_range=4.0, std=STD, resolution=0.001)
SONAR = RangeSensor(
    max_range=3.0, std=STD, resolution=0.01, aperture=math.radians(25), max_incidence=0.7
)
AROUND = RangeScanner.planar(LASER, 60, math.tau, name="around")
# Off the robot's centre, at four headings.
FAN = RangeScanner.planar(LASER, 17, math.pi, (0.1, 0.05, 0.0), name="fan")
RING = RangeScanner.ring(SONAR, 12, 0.15, name="ring")


@pytest.fixture(scope="module", params=oracle_cases.BUILDINGS)
def building(request: pytest.FixtureRequest) -> Environment:
    if request.param == "drawn":
        return scenes.scene(5, size=10.0, blocks=7, thin=4)
    folder: Path = request.getfixturevalue("data_dir")
    env = load_environment(folder / "maps_from_logs" / "freiburg-079.yaml")
    # Beams along the walls of a grid would meet corners exactly, and rounding say on which side.
    return env.transformed(0.3)


def context_of(env: Environment, scanner: RangeScanner) -> LayerContext:
    headings = None if scanner is not FAN else 4
    return LayerContext.of(build_map(env, scanner, spacing=0.5, headings=headings), env)


def chosen(context: LayerContext) -> tuple[np.ndarray, Floats]:
    """Some of the possible poses: cell and heading, (N, 2), and x, y, theta, (N, 3)."""
    rng = np.random.default_rng(2)
    which = rng.permutation(np.argwhere(context.possible))[:POSES]
    x, y = context.points
    return which, np.column_stack([x[which[:, 0]], y[which[:, 0]], context.headings[which[:, 1]]])


def values_at(context: LayerContext, layer: np.ndarray, which: np.ndarray) -> Floats:
    values = layer[context.free]
    return np.asarray(values[which[:, 0], which[:, 1]] if values.ndim == 2 else values[which[:, 0]])


def matched(context: LayerContext, pose: Floats, offset: Floats, size: float) -> Floats:
    """x and y where the match from `pose` + `offset` ends, less those of `pose`."""
    env, scanner, sigma = context.environment, context.scanner, context.model.sigma_theta
    kind, sensor = env.segments.kind, scanner.sensors[0]
    cap = -math.log(context.model.outlier_share + sensor.random_share + sensor.lost_share)
    variance = STD**2 + sensor.resolution**2 / 12 + context.map_std**2
    prior = np.array([size**-2, size**-2, sigma**-2])
    here = brute.scan(env, scanner, pose[None])
    on_wall = (here.segment[0] >= 0) & (kind[here.segment[0]] == brute.WALL)

    def stands(at: Floats) -> bool:
        return bool(brute.is_free(env, *brute.ray_starts(scanner, at[None])).all())

    wall, _ = brute.cast(env, pose[0], pose[1], math.atan2(offset[1], offset[0]))
    believed = pose + offset
    for k in range(7):
        at = pose + offset * (0.5**k if k < 6 else 0.0)
        if k == 6 or (size * 0.5**k < wall[0] and stands(at)):
            break
    room = np.array([size**2, size**2, sigma**2])
    for _ in range(6):
        there = brute.scan(env, scanner, at[None], beyond=1.0)
        J = brute.slopes(env, scanner, at[None], there)[0]
        use = on_wall & (there.segment[0] >= 0) & (kind[there.segment[0]] == brute.WALL)
        r, J = here.distance[0][use] - there.distance[0][use], J[use]
        u = r**2 / (2 * (variance + J**2 @ room))
        W = 1 / variance / (1 + u / cap) ** 2
        pull = J.T @ (W * r) + prior * (believed - at)
        step = np.linalg.solve((J.T * W) @ J + np.diag(prior), pull)
        strayed = math.hypot(*(at + step - believed)[:2]) / (2 * size)
        if strayed > 1.0:
            step[:2] = (believed + (at + step - believed) / strayed - at)[:2]
        if math.hypot(*step[:2]) / size + abs(step[2]) / sigma < 1e-3:
            return np.asarray((at + step - pose)[:2])
        shares = [0.5**k for k in range(6) if stands(at + 0.5**k * step)]
        if not shares:
            break
        step *= shares[0]
        at = at + step
        room = np.array([step[0] ** 2 + step[1] ** 2] * 2 + [step[2] ** 2])
    return np.asarray((at - pose)[:2])


@pytest.mark.slow(kept=("drawn-ring",))
@pytest.mark.parametrize("scanner", [AROUND, FAN, RING], ids=lambda one: one.name)
def test_perturbation(building: Environment, scanner: RangeScanner) -> None:
    context = context_of(building, scanner)
    found = perturbation(context)
    which, poses = chosen(context)
    size = context.radius / 2
    offsets = size * np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    expected = []
    for pose in poses:
        errors = np.array([matched(context, pose, offset, size) for offset in offsets])
        expected.append(np.linalg.svd(errors, compute_uv=False) / math.sqrt(2))
    for name, values in zip(("perturbation", "perturbation_minor"), np.transpose(expected),
                            strict=True):  # fmt: skip
        off = np.abs(values_at(context, found[name], which) - values)
        assert off.max() < 1e-5
        assert values.max() > 0.001


def hit_points(env: Environment, x: float, y: float, limit: float) -> Floats:
    """Where the 64 rays of the map's directions meet walls, (64, 2); nan where they do not."""
    angle = np.arange(64) * math.tau / 64
    d, segment = brute.cast(env, np.full(64, x), np.full(64, y), angle)
    wall = (segment >= 0) & (env.segments.kind[segment] == brute.WALL) & (d <= limit)
    points = np.column_stack([x + d * np.cos(angle), y + d * np.sin(angle)])
    return np.where(wall[:, None], points, np.nan)


def ranks_of(env: Environment, x: float, y: float, limit: float, step: float, tol: float) -> Floats:
    """Rank of the hit points' differences in each of the 64 directions."""
    own = hit_points(env, x, y, limit)
    lines = brute.lines_of(env)

    def at(dx: float, dy: float) -> Floats:
        path = shapely.LineString([(x, y), (x + dx, y + dy)])
        if path.intersects(lines) or not brute.is_free(env, x + dx, y + dy):
            return own
        there = hit_points(env, x + dx, y + dy, limit)
        return np.where(np.isnan(there), own, there)

    def beside(turn: int) -> Floats:
        there = np.roll(own, turn, axis=0)
        return np.where(np.isnan(there), own, there)

    rows = np.stack([
        at(step, 0) - at(-step, 0), at(0, step) - at(0, -step), beside(-1) - beside(1)
    ], axis=1)  # fmt: skip
    ranks = np.linalg.matrix_rank(np.nan_to_num(rows), tol=tol)
    return np.where(np.isnan(own[:, 0]), 0, ranks)


@pytest.mark.slow(kept=("recorded-0.1-fan",))
@pytest.mark.parametrize("scanner", [AROUND, FAN], ids=lambda one: one.name)
@pytest.mark.parametrize("step", [0.1, 0.3])
def test_gfm(building: Environment, scanner: RangeScanner, step: float) -> None:
    context = context_of(building, scanner)
    layer = gfm(context, step=step)["gfm"]
    which, poses = chosen(context)
    limit, std = scanner.sensors[0].max_range, context.map_std
    # A beam of the fan stands for half the way to the next, 17 of them over half a turn.
    half = math.pi / 2 + math.pi / 32 if scanner is FAN else math.pi
    expected = []
    for x, y, theta in poses:
        ranks = ranks_of(building, x, y, limit, step, std)
        off = np.mod(np.arange(64) * math.tau / 64 - theta + math.pi, math.tau) - math.pi
        expected.append((ranks[np.abs(off) <= half + 1e-6] < 2).mean())
    found = values_at(context, layer, which)
    # A ray that meets a corner exactly may take either side.
    assert np.abs(found - expected).max() < 1.5 / 32
    assert np.abs(found - expected).mean() < 0.001
    assert 0.0 < found.min() < found.max()


@pytest.mark.parametrize("reach", [2.0, 5.0])
@pytest.mark.parametrize("beams", [24, 60])
def test_wall_normals(building: Environment, reach: float, beams: int) -> None:
    """The walls cut with the disc exactly; the layer takes pieces in cells."""
    sensor = RangeSensor(max_range=reach, std=STD, resolution=0.001)
    context = context_of(building, RangeScanner.planar(sensor, beams, math.tau))
    found = wall_normals(context)
    which, poses = chosen(context)
    lines = building.segments.xy[building.segments.kind == brute.WALL]
    for pose, cell in zip(poses, which, strict=True):
        exact = normals_within(lines, pose[:2], reach)
        values = np.linalg.eigvalsh(exact)
        # A piece lies in the cell of its middle: half a diagonal off, and a quarter cell long.
        edge = (math.sqrt(0.5) + 0.25) * context.spacing
        most = np.trace(normals_within(lines, pose[:2], reach + edge)) - np.trace(
            normals_within(lines, pose[:2], max(reach - edge, 0.0))
        )
        for name, value in zip(("wall_normals", "wall_normals_strong"), values, strict=True):
            # Eigenvalues move by no more than what is added or taken (Weyl).
            assert abs(values_at(context, found[name], cell[None])[0] - value) <= most + 1e-4


def normals_within(lines: Floats, at: Floats, reach: float) -> Floats:
    """Sum of n n^T over the metres of wall within a disc, (2, 2), by the roots of a quadratic."""
    a, e = lines[:, :2] - at, lines[:, 2:] - lines[:, :2]
    length = np.hypot(*e.T)
    u = e / length[:, None]
    middle, off = -(a * u).sum(axis=1), a[:, 0] * u[:, 1] - a[:, 1] * u[:, 0]
    half = np.sqrt(np.maximum(reach**2 - off**2, 0.0))
    metres = np.maximum(np.minimum(middle + half, length) - np.maximum(middle - half, 0.0), 0.0)
    n = np.column_stack([-u[:, 1], u[:, 0]])
    return np.asarray(np.einsum("k,ki,kj->ij", metres, n, n))


@pytest.mark.parametrize("scanner", [AROUND, RING], ids=lambda one: one.name)
def test_clearance(building: Environment, scanner: RangeScanner) -> None:
    context = context_of(building, scanner)
    x, y = context.points
    expected = shapely.distance(brute.lines_of(building), shapely.points(x, y))
    np.testing.assert_allclose(clearance(context)["clearance"][context.free], expected, atol=1e-5)
