"""What a map is said to cost, against counts made in another way and against known runs."""

from __future__ import annotations

import itertools
import math

import numba
import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.map_building.estimate import Estimate, coarser, estimate

LASER = an.RangeScanner.from_preset("rplidar-a1")
HALL = an.environment_from_shapes([shapely.box(0, 0, 40, 25)], [shapely.box(5, 5, 15, 15)])


def test_poses_are_those_of_the_map() -> None:
    amap = an.build_map(HALL, LASER, spacing=0.5)
    estimated = estimate(HALL, LASER, spacing=0.5)
    assert estimated.poses == pytest.approx(int(amap.dataset["free"].sum()), rel=0.01)
    assert estimated.beams == 60 and estimated.headings == 1


def test_neighbours_are_the_points_within_the_radius() -> None:
    step = np.arange(-20, 21) * 0.05
    count = int((np.hypot(*np.meshgrid(step, step)) <= 0.5 + 1e-9).sum())
    assert estimate(HALL, LASER, 0.05, 0.5).neighbours == pytest.approx(count, rel=0.15)


def test_it_is_between_the_published_runs_to_a_factor_of_two() -> None:
    """willow_full_005, 136 229 poses in a box of 58 x 47 m, on two processors.

    benchmarks/results/map.md, and the same at commit 04728c3: 1.37 and 3.72 s, 8.05 and 16.7 s.
    """
    floor = shapely.box(0, 0, 58, 47)
    hole = shapely.box(1, 1, 57, 1 + (58 * 47 - 1362.29) / 56)
    willow = an.environment_from_shapes([floor], [hole])
    before = numba.get_num_threads()
    numba.set_num_threads(min(2, before))
    try:
        share = 2 / numba.get_num_threads()
        plain = estimate(willow, LASER)
        turned = estimate(willow, an.RangeScanner.from_preset("hokuyo-urg-04lx"))
    finally:
        numba.set_num_threads(before)
    assert plain.poses == pytest.approx(136229, rel=1e-3)
    assert 0.5 < plain.seconds / share / 2.26 < 2.0
    assert 0.5 < turned.seconds / share / 11.6 < 2.0
    assert 0.5 < plain.bytes / 523e6 < 2.0
    assert 0.5 < turned.bytes / 1022e6 < 2.0


def test_finer_costs_more_and_coarser_less() -> None:
    costs = [estimate(HALL, LASER, spacing) for spacing in (0.025, 0.05, 0.1, 0.2)]
    assert all(a.seconds > 2 * b.seconds for a, b in itertools.pairwise(costs))
    # Neighbours and poses both grow with the square.
    assert costs[0].seconds / costs[1].seconds == pytest.approx(16, rel=0.3)
    wider = coarser(HALL, LASER, 0.01, 0.5, None, 5.0)
    assert wider is not None and wider.seconds < estimate(HALL, LASER, 0.01).seconds
    assert 0.01 < wider.spacing <= 0.5
    assert coarser(HALL, LASER, 0.5, 0.5, None, 5.0) is None


@pytest.mark.parametrize(
    ("seconds", "gigabytes", "words"),
    [
        (30, 0.01, "less than a minute and 0.1 GB"),
        (61, 1.23, "about 1 minute and 1.2 GB"),
        (88, 12.3, "about 1 minute and 12 GB"),
        (720, 3, "about 12 minutes and 3 GB"),
        (80 * 60, 3, "about 80 minutes and 3 GB"),
        (3 * 3600, 163, "about 3 hours and 163 GB"),
        (5 * 86400, 2, "about 5 days and 2 GB"),
    ],
)
def test_words(seconds: float, gigabytes: float, words: str) -> None:
    assert str(Estimate(0.1, 1, 1, 1, 1, seconds, gigabytes * 1e9)) == words


def test_cones_and_headings_count() -> None:
    ring = an.RangeScanner.from_preset("polaroid-6500-ring")
    seconds = [estimate(HALL, LASER, headings=n).seconds for n in (4, 8)]
    assert seconds[1] == pytest.approx(2 * seconds[0])
    assert math.isfinite(estimate(HALL, ring).seconds)
    assert estimate(HALL, an.RangeScanner.from_preset("sick-tim571")).headings == 8
