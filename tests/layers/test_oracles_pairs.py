"""Layers that compare poses with each other against brute force that shares nothing with them.

On a drawn building and on a recorded map, for two scanners each.
"""

from __future__ import annotations

import math
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

import ambinav as an
from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import Environment
from ambinav.layers.aliasing.layer import aliased_poses
from ambinav.layers.context import LayerContext
from ambinav.layers.position import position
from ambinav.map_building.build import build_map
from ambinav.sensing import RangeScanner, RangeSensor
from tests.layers import brute, oracle_cases
from tests.layers.brute import Floats

POSES = 24
STD = 0.03


def laser(reach: float) -> RangeSensor:
    return RangeSensor(max_range=reach, std=STD, resolution=0.001)


def around(reach: float) -> RangeScanner:
    return RangeScanner.planar(laser(reach), 36, math.tau)


def fan(reach: float) -> RangeScanner:
    return RangeScanner.planar(laser(reach), 20, 2.0, (0.1, 0.0, 0.0))


# Of the brute-force lattice about a pose: metres, and deviations of the heading.
FINE = 0.02
TURNS = np.linspace(-2.0, 2.0, 5)


@pytest.fixture(scope="module", params=oracle_cases.BUILDINGS)
def building(request: pytest.FixtureRequest) -> Environment:
    if request.param == "drawn":
        # Two rooms, nearly alike, a corridor between them, and a door to unknown space.
        rooms = [shapely.box(0, 0, 2.13, 1.71), shapely.box(5, 0, 7.1, 1.6)]
        hall = shapely.box(1.9, 0.4, 5.2, 1.1)
        return an.environment_from_shapes(
            [shapely.union_all([*rooms, hall])], openings=[shapely.LineString([(0, 0), (0, 1.7)])]
        ).transformed(0.3)
    folder: Path = request.getfixturevalue("data_dir")
    # Beams along the walls of a grid would meet corners exactly, and rounding say on which side.
    return load_environment(folder / "maps" / "nav2_tb3_sandbox.yaml").transformed(0.3)


def context_of(env: Environment, scanner: RangeScanner, spacing: float) -> LayerContext:
    """At four headings where the scanner does not look all around."""
    headings = None if scanner.turns_in_place else 4
    return LayerContext.of(build_map(env, scanner, spacing, headings=headings), env)


def limit_of(context: LayerContext) -> float:
    return context.scanner.sensors[0].max_range


def scans(context: LayerContext, poses: Floats) -> tuple[Floats, Floats, brute.Scan]:
    """Ranges up to a metre beyond the limit, and variances, inf for unknown space; (N, B)."""
    env, scanner, limit = context.environment, context.scanner, limit_of(context)
    found = brute.scan(env, scanner, poses, beyond=1.0)
    frontier = env.segments.kind[found.segment] == brute.FRONTIER
    blind = (found.segment >= 0) & frontier & (found.distance < limit)
    fixed = STD**2 + 0.001**2 / 12 + context.map_std**2
    distance = np.minimum(found.distance, limit + 1.0)
    return distance, np.where(blind, np.inf, fixed), found


def cap_of(context: LayerContext) -> float:
    sensor = context.scanner.sensors[0]
    return -math.log(context.model.outlier_share + sensor.random_share + sensor.lost_share)


@pytest.mark.slow(kept=("drawn-0.01-around", "drawn-0.01-fan", "recorded-0.1-fan"))
@pytest.mark.parametrize("scanner", [around(2.0), fan(2.0)], ids=["around", "fan"])
@pytest.mark.parametrize("least", [0.01, 0.1])
def test_aliasing(building: Environment, scanner: RangeScanner, least: float) -> None:
    """Every pose and every turn of it, without any search."""
    context = context_of(building, scanner, 0.3)
    found, limit = aliased_poses(context, least=least), limit_of(context)
    x, y = context.points
    if scanner.turns_in_place:
        poses, possible = np.column_stack([x, y, np.zeros(len(x))]), np.ones(len(x), bool)
        turn = math.pi / scanner.beams
    else:
        poses = np.array([(*at, t) for at, t in product(zip(x, y, strict=True), context.headings)])
        possible, turn = context.possible.ravel(), context.model.sigma_theta
    distance, variance, met = scans(context, poses)
    slope = brute.slopes(building, context.scanner, poses, met)
    explored = possible & (np.isinf(variance).mean(axis=1) < 0.5)
    cell = np.array([(context.spacing / 2) ** 2] * 2 + [turn**2])
    rng = np.random.default_rng(4)
    share, area = (
        values[:, : len(poses) // len(x)].ravel() for values in (found.share, found.area)
    )
    assert (share[possible & ~explored] == 1.0).all()
    others = np.flatnonzero(explored)
    off = []
    for p in rng.permutation(others)[:POSES]:
        far = np.hypot(*(poses[others, :2] - poses[p, :2]).T) > context.radius * (1 + 1e-9)
        mass = np.zeros(2)
        for k in range(scanner.beams if scanner.turns_in_place else 1):
            # Turned by k beams, the robot's beam 0 looks where its beam k did.
            turned = [np.roll(part[others], -k, axis=1) for part in (distance, slope, variance)]
            pooled = (turned[2] + variance[p]) / 2
            alike, _, phi = brute.laplace(
                np.minimum(distance[p], limit), turned[0], turned[1], pooled, limit,
                cap_of(context), context.model.tau, cell,
            )  # fmt: skip
            counts = phi <= -math.log(least)
            mass += alike[counts & ~far].sum(), alike[counts & far].sum()
        off.append((share[p] - mass[1] / mass.sum(), area[p] - mass[1] * context.spacing**2))
        assert mass[0] > 0.0
    # In single precision a pair may fall to either side of `least`.
    assert np.abs(off).max() < 2e-3
    assert np.median(np.abs(off)) < 1e-5
    assert 0.005 < np.mean(share[others]) < 0.98


@pytest.mark.slow(kept=("drawn-fan",))
@pytest.mark.parametrize("scanner", [around(4.0), fan(4.0)], ids=["around", "fan"])
def test_position(building: Environment, scanner: RangeScanner) -> None:
    """Every pose of a fine lattice and heading is scanned as it stands: no cell, no derivative."""
    context = context_of(building, scanner, 0.1)
    found = position(context)
    x, y = context.points
    assert not context.has_theta or len(context.headings) == 4
    inside = np.flatnonzero(context.possible.all(axis=1))
    chosen = np.random.default_rng(6).permutation(inside)[: 10 if scanner.turns_in_place else 5]
    off = []
    for p in chosen:
        expected = radius_about(context, float(x[p]), float(y[p]))
        off.append(found["position_radius"][context.free][p] - expected)
        share = min(expected / (context.radius / math.sqrt(2)), 1.0)
        assert found["position"][context.free][p] == pytest.approx(share, abs=0.06)
    assert np.median(np.abs(off)) < 0.01
    assert np.abs(off).max() < 0.03


def radius_about(context: LayerContext, x: float, y: float) -> float:
    """Root of the trace of what is left when two scans' worth of all headings is known."""
    steps = FINE * np.arange(-round(context.radius / FINE), round(context.radius / FINE) + 1)
    dx, dy = (part.ravel() for part in np.meshgrid(steps, steps))
    near = dx**2 + dy**2 <= context.radius**2 * (1 + 1e-9)
    dx, dy = dx[near], dy[near]
    reached = connected(context.environment, x, y, dx, dy)
    information = []
    for heading in context.headings:
        stands = reached & free_sensors(context, x + dx, y + dy, float(heading))
        M, F = moments(context, x, y, dx[stands], dy[stands], float(heading))
        if not context.has_theta:
            return math.sqrt(np.trace(M))
        values, axes = np.linalg.eigh(M)
        share = np.minimum(values / np.einsum("ik,ij,jk->k", axes, F, axes), 1.0)
        information.append((axes * ((2.0 * (1.0 - share) + share) / values)) @ axes.T)
    return math.sqrt(np.trace(np.linalg.inv(np.mean(information, axis=0))))


def connected(env: Environment, x: float, y: float, dx: Floats, dy: Floats) -> NDArray[np.bool_]:
    """Whether points lie in the piece of the free disc that holds its centre."""
    disc = shapely.Point(x, y).buffer(np.hypot(dx, dy).max() + FINE)
    walls = shapely.intersection(disc, brute.lines_of(env)).buffer(1e-6)
    pieces = shapely.get_parts(shapely.difference(shapely.intersection(disc, env.free), walls))
    mine = pieces[shapely.distance(pieces, shapely.Point(x, y)).argmin()]
    return np.asarray(shapely.contains_xy(mine, x + dx, y + dy))


def free_sensors(context: LayerContext, x: Floats, y: Floats, theta: float) -> NDArray[np.bool_]:
    poses = np.column_stack([x, y, np.full(len(x), theta)])
    return brute.is_free(context.environment, *brute.ray_starts(context.scanner, poses)).all(axis=1)


def moments(
    context: LayerContext, x: float, y: float, dx: Floats, dy: Floats, heading: float
) -> tuple[Floats, Floats]:
    """Second moments about (x, y) of the poses with the same scan, and of all, (2, 2) each."""
    here, mine, _ = scans(context, np.array([[x, y, heading]]))
    weight = np.zeros(len(dx))
    for t in TURNS:
        turned = heading + t * context.model.sigma_theta
        poses = np.column_stack([x + dx, y + dy, np.full(len(dx), turned)])
        there, variance, _ = scans(context, poses)
        z = np.minimum(here, limit_of(context)) - np.minimum(there, limit_of(context))
        u = z**2 / (2 * (mine + variance))
        u /= np.sqrt(1 + (u / cap_of(context)) ** 2)
        weight += math.exp(-(t**2) / 2) * np.exp(-u.sum(axis=1) / context.model.tau)
    step = np.stack([dx, dy])
    free = step @ step.T / len(dx)
    return (step * weight) @ step.T / weight.sum(), free
