"""Neighbours in batches, headings as windows of a panorama, turns as shifts: against one by one."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ambinav.ambiguity import returns
from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.feasible_poses import can_stand
from ambinav.ambiguity.gaussian import FAST
from ambinav.ambiguity.heading import turn_cells, turning_moments, turns
from ambinav.ambiguity.indistinguishability import evidence_table
from ambinav.ambiguity.kernel import neighbourhood_sums
from ambinav.ambiguity.pair import compare
from ambinav.ambiguity.returns import Returns, beam_returns, panorama_returns, pose_returns
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.map_building.build import build_map
from ambinav.runtime.kernels import kernel
from ambinav.runtime.lanes import LANES
from ambinav.sensing import RangeScanner, RangeSensor
from tests.geometry import scenes

SPACING, RADIUS, TAU = 0.25, 0.8, 3.0
CELL = (SPACING**2 / 4, 0.05**2)
COARSE = RangeSensor(max_range=4.0, std=0.005, resolution=0.15)


@kernel(fastmath=FAST)
def _pair(data, p, q, limit, icap, use, evidence, tau, c0, c2, out):  # type: ignore[no-untyped-def]
    a, b, c, d, e, f, g, h = compare(data, p, q, limit, icap, use, evidence, tau, c0, c2)
    out[0], out[1], out[2], out[3], out[4], out[5], out[6], out[7] = a, b, c, d, e, f, g, h


@pytest.fixture(scope="module")
def env() -> Environment:
    return scenes.scene(7, size=9.0, blocks=10, thin=4).transformed(0.1234)


@pytest.fixture(scope="module")
def lattice(env: Environment) -> Lattice:
    return Lattice.over(env, SPACING)


def disc() -> NDArray[np.int64]:
    steps = np.arange(-3, 4)
    rows, columns = (one.ravel() for one in np.meshgrid(steps, steps, indexing="ij"))
    near = np.hypot(rows, columns) * SPACING <= RADIUS
    return np.stack([rows[near], columns[near]], axis=1)


def scans(
    lattice: Lattice, scanner: RangeScanner, headings: NDArray[np.float64]
) -> tuple[BeamTable, NDArray[np.float32]]:
    table = BeamTable.of(scanner, 0.03, 0.05)
    x, y = lattice.points
    data = np.empty((len(headings), len(x), 5, len(table.limit)), dtype=np.float32)
    panorama_returns(lattice.environment, scanner, table, x, y, headings, data)
    return table, data


def sums(
    lattice: Lattice, table: BeamTable, data: NDArray[np.float32], links: NDArray[np.uint8],
    evidence: NDArray[np.float32] | None = None, begin: int = 0, end: int | None = None,
) -> NDArray[np.float64]:  # fmt: skip
    end = data.shape[1] if end is None else end
    return neighbourhood_sums(
        np.arange(begin, end), 0, lattice.rows_columns, lattice.index, links, disc(), SPACING,
        data, table, evidence, TAU, CELL,
    )  # fmt: skip


@pytest.mark.parametrize("coarse", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_batch_is_its_pairs(lattice: Lattice, laser: RangeScanner, coarse: bool) -> None:
    scanner = RangeScanner.planar(COARSE, 24, 2 * math.pi) if coarse else laser
    table, data = scans(lattice, scanner, np.zeros(1))
    evidence = None
    if coarse:
        padded = np.pad(table.width, (0, len(table.limit) - table.beams), mode="edge")
        evidence = evidence_table(padded)
    # Every link is there: all free points of the disc that such steps reach are neighbours.
    found = sums(lattice, table, data, lattice.links[None], evidence)[:, 0]
    open_floor = np.flatnonzero(np.asarray(lattice.clearance(RADIUS + SPACING)) > RADIUS + 0.1)
    assert len(disc()) > 2 * LANES
    for p in open_floor[:: max(len(open_floor) // 5, 1)]:
        row, column = lattice.rows_columns[p]
        total, moments = 0.0, np.zeros(3)
        for step in disc():
            q = lattice.index[row + step[0], column + step[1]]
            pair = np.empty(8)
            _pair(
                data[0], int(p), int(q), table.limit, table.inverse_cap, table.use, evidence, TAU,
                *CELL, pair,
            )  # fmt: skip
            alike, ox, oy, _, sxx, sxy, syy, _ = pair
            x, y = step[1] * SPACING + ox, step[0] * SPACING + oy
            total += alike
            moments += alike * np.array([x * x + sxx, x * y + sxy, y * y + syy])
        np.testing.assert_allclose(found[p, 0], total / len(disc()), rtol=1e-6)
        np.testing.assert_allclose(found[p, 1:4], moments / total, rtol=1e-5, atol=1e-9)


def test_headings_together_are_headings_one_by_one(lattice: Lattice) -> None:
    fan = RangeScanner.planar(COARSE, 21, math.radians(120))
    headings = 2 * math.pi * np.arange(3) / 3
    table, data = scans(lattice, fan, headings)
    together = sums(lattice, table, data, lattice.links[None])
    for h in range(3):
        alone = sums(lattice, table, data[h : h + 1], lattice.links[None])
        assert np.array_equal(together[:, h], alone[:, 0])
    apart = sums(lattice, table, data, np.repeat(lattice.links[None], 3, axis=0))
    assert np.array_equal(together, apart)
    some = sums(lattice, table, data, lattice.links[None], begin=17, end=140)
    assert np.array_equal(some, together[17:140])


@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (0.15, -0.05, 0.4)])
@pytest.mark.parametrize("aperture", [0.0, math.radians(20)])
def test_a_panorama_holds_what_each_heading_sees(
    env: Environment, mount: tuple[float, float, float], aperture: float
) -> None:
    sensor = RangeSensor(
        max_range=3.0, min_range=0.2, std=0.02, resolution=0.01, aperture=aperture,
        max_incidence=math.radians(60) if aperture else None,
    )  # fmt: skip
    scanner = RangeScanner.planar(sensor, 13, math.radians(120), mount)
    table = BeamTable.of(scanner, 0.03, 0.05)
    rng = np.random.default_rng(2)
    x, y = rng.uniform(1, 8, (2, 400))
    inside = np.asarray(env.is_free(x, y, 0.3))
    x, y = x[inside], y[inside]
    headings = 2 * math.pi * np.arange(6) / 6
    data = np.full((6, len(x) + 2, 5, len(table.limit)), 7.0, dtype=np.float32)
    panorama_returns(env, scanner, table, x, y, headings, data, 2)
    assert (data[:, :2] == 7.0).all(), "rows before the first are left alone"
    for h, heading in enumerate(headings):
        alone = np.empty((len(x), 5, len(table.limit)), dtype=np.float32)
        beam_returns(env, scanner, table, x, y, float(heading), alone)
        # A ray through a corner may take either side of it.
        same = np.isclose(data[h, 2:], alone, rtol=1e-4, atol=1e-4).all(axis=1)
        assert same.mean() > 0.999
        assert (data[h, 2:, :4, table.beams :] == 0.0).all()
        assert (data[h, 2:, 4, table.beams :] == 1.0).all()


@pytest.mark.parametrize("aperture", [0.0, math.radians(20)])
def test_poses_with_headings_of_their_own(env: Environment, aperture: float) -> None:
    sensor = RangeSensor(max_range=3.0, std=0.02, resolution=0.01, aperture=aperture)
    scanner = RangeScanner.planar(sensor, 13, math.radians(120), (0.15, -0.05, 0.4))
    table = BeamTable.of(scanner, 0.03, 0.05)
    x, y, theta = np.random.default_rng(3).uniform(1, 8, (3, 200))
    data = np.empty((200, 5, len(table.limit)), dtype=np.float32)
    pose_returns(env, scanner, table, x, y, theta, data)
    stands = can_stand(env, scanner, x, y, theta, 0.1)
    alone = np.empty((1, *data.shape[1:]), dtype=np.float32)
    for i in np.flatnonzero(env.is_free(x, y, 0.2)):
        at, heading = slice(i, i + 1), float(theta[i])
        beam_returns(env, scanner, table, x[at], y[at], heading, alone)
        np.testing.assert_array_equal(data[i], alone[0])
        assert stands[i] == can_stand(env, scanner, x[at], y[at], heading, 0.1)[0]


def test_rays_that_headings_share_are_cast_once(
    env: Environment, monkeypatch: pytest.MonkeyPatch
) -> None:
    cast: list[int] = []
    real = returns.scan_rays

    def counted(*args: Any, **options: Any) -> Any:
        cast.append(len(args[5]))
        return real(*args, **options)

    monkeypatch.setattr(returns, "scan_rays", counted)
    # A beam every 10 degrees, headings every 90: all are among 36 directions.
    scanner = RangeScanner.planar(COARSE, 13, math.radians(120))
    table = BeamTable.of(scanner, 0.03, 0.05)
    data = np.empty((4, 1, 5, len(table.limit)), dtype=np.float32)
    headings = math.pi / 2 * np.arange(4)
    panorama_returns(env, scanner, table, np.array([4.0]), np.array([4.5]), headings, data)
    spacing = np.diff(np.sort(scanner.rays().angle))
    directions = np.round((headings[:, None] + scanner.rays().angle) % (2 * math.pi), 6)
    assert spacing == pytest.approx(spacing[0])
    assert cast == [len(np.unique(directions))]


@pytest.mark.parametrize("coarse", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", ["ring", "laser", "mixed"])
def test_turns_are_compared_one_by_one(lattice: Lattice, kind: str, coarse: bool) -> None:
    sensor = COARSE if coarse else RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
    ring = RangeScanner.ring(sensor, 12, 0.1)
    laser = RangeScanner.planar(sensor, 24, math.tau)
    scanner = {"ring": ring, "laser": laser, "mixed": RangeScanner.mixed(ring, laser)}[kind]
    table, data = scans(lattice, scanner, np.zeros(1))
    beams = turns(scanner)
    assert all(np.array_equal(np.sort(one), np.arange(scanner.beams)) for one in beams)
    begin, end = 5, 43
    found = turning_moments(
        Returns(data[0]), np.arange(begin, end), beams, table, table.evidence, TAU, SPACING
    )
    for p in range(begin, end, 6):
        weight = moment = turned = 0.0
        for k, mean, variance, times, advance in turn_cells(len(beams)):
            turned += advance
            pair = data[0, [p, p]].copy()
            pair[1, :, : scanner.beams] = data[0, p][:, beams[int(k)]]
            # As the kernel has it: the range moves, the reading stays what it is.
            pair[1, 0] += turned * pair[1, 3]
            one = np.empty(8)
            _pair(
                pair, 0, 1, table.limit, table.inverse_cap, table.use, table.evidence, TAU,
                SPACING**2, variance, one,
            )  # fmt: skip
            angle = mean + one[3]
            weight += times * one[0]
            moment += times * one[0] * (angle * angle + one[7])
        # Turns that are hardly alike are left out.
        assert found[p - begin, 0] == pytest.approx(math.sqrt(moment / weight), abs=2e-3)


@pytest.mark.sweep
def test_turns_of_a_scanner_with_thousands_of_beams() -> None:
    """A turn a degree, and a map in seconds: one of 7200 beams did not end."""
    sensor = RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
    few, many = (RangeScanner.planar(sensor, beams, 2 * math.pi) for beams in (360, 7200))
    found = turns(many)
    assert found.shape == (360, 7200)
    np.testing.assert_array_equal(found[:, 0], np.arange(0, 7200, 20))
    np.testing.assert_array_equal(np.sort(found[77]), np.arange(7200))
    prime = RangeScanner.planar(sensor, 367, 2 * math.pi)
    assert turns(prime).shape == (367, 367)
    env = scenes.room(4.0, 3.0)
    levels = [
        build_map(env, scanner, 0.4, max_beams=scanner.beams, store=False).dataset
        for scanner in (few, many)
    ]
    for name in ("level", "heading"):
        np.testing.assert_allclose(levels[0][name], levels[1][name], atol=0.03)
