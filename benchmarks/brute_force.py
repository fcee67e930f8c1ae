"""The ambiguity level by brute force, an oracle for the kernel; it shares no code with it.

Every pose of a fine lattice of neighbours and headings is scanned and compared as it stands: no
cell, no derivative, no offset. Slow, and right but for the lattice's own step.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER
from ambinav.sensing.scanner import RangeScanner

STEP = 0.02
HEADINGS = 7
WIDEST = 2.5

Floats = NDArray[np.float64]


def level(
    env: Environment, scanner: RangeScanner, x: float, y: float, *, map_std: float, tau: float,
    outlier_share: float = 0.05, sigma_theta: float = 0.05, radius: float = 0.5,
) -> float:  # fmt: skip
    """Return `level` at (x, y): see `radii`."""
    return float(
        radii(
            env, scanner, x, y, map_std=map_std, tau=tau, outlier_share=outlier_share,
            sigma_theta=sigma_theta, radius=radius,
        ).mean()
    )  # fmt: skip


def radii(
    env: Environment,
    scanner: RangeScanner,
    x: float,
    y: float,
    *,
    map_std: float,
    tau: float,
    outlier_share: float = 0.05,
    sigma_theta: float = 0.05,
    radius: float = 0.5,
    step: float = STEP,
    headings: int = HEADINGS,
) -> Floats:
    """Return `major` and `minor` at (x, y) for equal lasers in the robot's centre.

    Args:
        env: The environment; it has no wall without thickness.
        scanner: The scanner, all of its beams; no effective deviation is below 2 cm.
        x: Metres, map frame.
        y: Metres.
        map_std: As for `build_map`, and so are the others.
        tau: Beams per independent piece of evidence.
        outlier_share: Share of beams that hit unmapped objects; the sensor's random and lost
            readings add to it.
        sigma_theta: Radians.
        radius: Radius of the neighbourhood, metres.
        step: Spacing of the lattice, metres.
        headings: Out to `WIDEST` deviations to both sides.
    """
    half = int(radius / step)
    steps = step * np.arange(-half, half + 1)
    dx, dy = np.meshgrid(steps, steps)
    free = np.asarray(env.is_free(x + dx, y + dy)) & (dx**2 + dy**2 <= radius**2)
    pieces, _ = ndimage.label(free, structure=np.ones((3, 3)))
    near = free & (pieces == pieces[half, half])
    dx, dy = dx[near], dy[near]
    scan, hidden = _scan(env, scanner, np.array([x]), np.array([y]), 0.0)
    turns = sigma_theta * np.linspace(-WIDEST, WIDEST, headings)
    weights = np.exp(-0.5 * (turns / sigma_theta) ** 2)
    alike = np.zeros(len(dx))
    sensor = scanner.sensors[0]
    cap = -math.log(outlier_share + sensor.random_share + sensor.lost_share)
    for turn, weight in zip(turns, weights / weights.sum(), strict=True):
        neighbour, unknown = _scan(env, scanner, x + dx, y + dy, turn)
        pooled = (_variance(scanner, scan, map_std) + _variance(scanner, neighbour, map_std)) / 2
        evidence = np.where(hidden | unknown, 0.0, (neighbour - scan) ** 2 / (4 * pooled))
        evidence /= np.sqrt(1 + (evidence / cap) ** 2)
        alike += weight * np.exp(-evidence.sum(axis=1) / tau)
    M = _moment(dx, dy, alike / alike.sum())
    F = _moment(dx, dy, np.full(len(dx), 1 / len(dx)))
    values, axes = np.linalg.eigh(M)
    along = np.einsum("ik,ij,jk->k", axes, F, axes)
    return np.asarray(np.minimum(np.sqrt(values / along), 1.0)[::-1])


def _moment(dx: Floats, dy: Floats, weight: Floats) -> Floats:
    step = np.stack([dx, dy])
    return np.asarray((step * weight) @ step.T)


def _variance(scanner: RangeScanner, ranges: Floats, map_std: float) -> Floats:
    sensor = scanner.sensors[0]
    return np.asarray(sensor.std_at(ranges)) ** 2 + sensor.resolution**2 / 12 + map_std**2


def _scan(
    env: Environment, scanner: RangeScanner, x: Floats, y: Floats, theta: float
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return true ranges, limited, and whether each ends in unknown space; shape (N, B)."""
    limit = scanner.sensors[0].max_range
    angle = theta + scanner.mounts[:, 2]
    distance, segment = env.cast_hits(x[:, None], y[:, None], angle, limit)
    unknown = (segment >= 0) & (env.segments.kind[segment] == FRONTIER) & (distance < limit)
    return np.minimum(distance, limit), unknown
