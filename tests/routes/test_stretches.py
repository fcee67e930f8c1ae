"""Metres and longest stretches of each bad zone, against sampling that shares no code.

The motions of the oracle are OMPL's, its zones are read from the raw array of the map, and its
stretches are collected one sample after the other.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ambinav.geometry.motion.steering import Steering
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import NOT_FREE
from ambinav.routes.evaluate import evaluate_route
from ambinav.service.service import AmbiguityService
from tests.maps import synthetic

FINE = 2e-3
"""Metres between the oracle's samples."""
SAMPLE = synthetic.SPACING / 4
"""Metres between those of a route's figures: a shorter interruption may pass between them."""

STEERINGS = (
    Steering("r2"), Steering("se2"), Steering("dubins", 0.4), Steering("reeds-shepp", 0.4)
)  # fmt: skip


def striped(headings: int) -> AmbiguityMap:
    """A hall of 26 by 10 m in blocks of 0.8 m, their zones drawn at random, also by heading."""
    dataset = synthetic.dataset(headings=headings)
    rng = np.random.default_rng(5)
    shape = dataset["zone"].shape
    blocks = rng.choice(4, size=(14, 34, *shape[2:]), p=(0.1, 0.1, 0.4, 0.4))
    rows, columns = np.indices(shape[:2]) // 8
    dataset["zone"] = (dataset["zone"].dims, blocks[rows, columns].astype(np.uint8))
    return AmbiguityMap(dataset)


SERVICES = {
    (kind, headings): AmbiguityService(amap)
    for headings in (0, 8)
    for kind, amap in (
        ("building", AmbiguityMap(synthetic.dataset(headings=headings))),
        ("blocks", striped(headings)),
    )
}


def oracle_poses(poses: np.ndarray, steering: Steering) -> tuple[np.ndarray, np.ndarray]:
    """Poses in the middle of fine pieces of the motion (OMPL's), and the metres of each piece."""
    ob = pytest.importorskip("ompl.base")
    spaces: dict[str, Any] = {
        "r2": ob.SE2StateSpace,
        "se2": ob.SE2StateSpace,
        "dubins": lambda: ob.DubinsStateSpace(steering.radius),
        "reeds-shepp": lambda: ob.ReedsSheppStateSpace(steering.radius),
    }
    space = spaces[steering.space]()
    bounds = ob.RealVectorBounds(2)
    bounds.setLow(-100.0)
    bounds.setHigh(100.0)
    space.setBounds(bounds)
    ends, at = [space.allocState() for _ in range(2)], space.allocState()
    found, metres = [], []
    for a, b in pairwise(poses):
        for state, (x, y, theta) in zip(ends, (a, b), strict=True):
            state.setX(x)
            state.setY(y)
            state.setYaw((theta + math.pi) % (2 * math.pi) - math.pi)
        straight = math.hypot(b[0] - a[0], b[1] - a[1])
        length = space.distance(*ends) if steering.turns else straight
        count = max(int(length / FINE), 1)
        for k in range(count):
            space.interpolate(*ends, (k + 0.5) / count, at)
            heading = at.getYaw()
            if steering.space == "r2":
                heading = math.atan2(b[1] - a[1], b[0] - a[0])
            found.append((at.getX(), at.getY(), heading))
            metres.append(length / count)
    return np.array(found), np.array(metres)


def oracle_zones(amap: AmbiguityMap, poses: np.ndarray) -> list[int]:
    """Codes of the cells that poses lie in, from the raw array."""
    zone, x, y = (amap.dataset[name].values for name in ("zone", "x", "y"))
    out = []
    for px, py, theta in poses:
        cell = zone[np.abs(y - py).argmin(), np.abs(x - px).argmin()]
        if cell.ndim:
            turn = np.arange(len(cell)) * 2 * math.pi / len(cell) - theta
            cell = cell[np.abs(np.exp(1j * turn) - 1.0).argmin()]
        out.append(int(cell))
    assert NOT_FREE not in out
    return out


def oracle_longest(inside: list[bool], metres: np.ndarray, bridge: float) -> float:
    """The longest stretch inside, gaps of up to `bridge` metres between two of them included."""
    best = current = gap = 0.0
    for within, length in zip(inside, metres.tolist(), strict=True):
        if within:
            current = current + gap + length if current and gap <= bridge else length
            gap = 0.0
            best = max(best, current)
        else:
            gap += length
    return best


def random_poses(seed: int) -> np.ndarray:
    """2 to 5 poses in the hall."""
    rng = np.random.default_rng(seed)
    low, high = (18.0, 2.0, -6.0), (24.0, 8.0, 6.0)
    return rng.uniform(low, high, (rng.integers(2, 6), 3))


def same_path(steering: Steering, poses: np.ndarray, fine: np.ndarray, metres: np.ndarray) -> bool:
    """Whether OMPL takes the same of two curves that are equally short, as Reeds-Shepp's may be."""
    ours, _, along = steering.dense(poses, FINE)
    at = np.cumsum(metres) - 0.5 * metres
    apart = [np.interp(at, along, ours[:, axis]) - fine[:, axis] for axis in (0, 1)]
    return bool(np.hypot(*apart).max() < FINE)


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    steering=st.sampled_from(STEERINGS),
    where=st.sampled_from(sorted(SERVICES)),
)
def test_stretches_of_any_motion_are_those_of_fine_sampling(seed, steering, where):
    service, poses = SERVICES[where], random_poses(seed)
    route = evaluate_route(service, poses, steering, planner="random")
    fine, metres = oracle_poses(poses, steering)
    assert metres.sum() == pytest.approx(route.length, rel=1e-6)
    assume(same_path(steering, poses, fine, metres))
    zones = oracle_zones(service.map, fine)
    crossings = 2 + np.count_nonzero(np.diff(zones))
    figures = (
        ((2,), route.corridor_metres, route.longest_corridor),
        ((3,), route.open_metres, route.longest_open),
        ((2, 3), route.bad_metres, route.longest_bad),
    )
    for codes, total, longest in figures:
        inside = [zone in codes for zone in zones]
        assert total == pytest.approx(metres[inside].sum(), abs=crossings * SAMPLE)
        # Two samples in a row may both miss an interruption, or see one that is hardly there.
        least = oracle_longest(inside, metres, 0.0)
        most = oracle_longest(inside, metres, 2 * SAMPLE)
        assert least - 2 * SAMPLE <= longest <= most + 2 * SAMPLE
    assert max(route.longest_corridor, route.longest_open) <= route.longest_bad + 1e-9
    assert route.longest_corridor <= route.corridor_metres + 1e-9
    assert route.longest_open <= route.open_metres + 1e-9
