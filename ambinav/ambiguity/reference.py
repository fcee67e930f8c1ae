"""Definition up to the tensor in plain NumPy, one pose at a time: the fast kernel's oracle.

Nothing here is clever. Every ray is cast against every segment, every neighbour is found by
walking from cell to cell, every scan is compared beam by beam in float64.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ambinav.ambiguity.feasible_poses import TOUCHING
from ambinav.ambiguity.indistinguishability import FINEST_STD, evidence, most_evidence
from ambinav.ambiguity.model import AmbiguityModel
from ambinav.ambiguity.returns import BEYOND, BLIND, GRAZING, TIE
from ambinav.casting.scans import check_rays, plane_only
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER, REFLECTOR
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor

Vector = NDArray[np.float64]


def cast(env: Environment, x: float, y: float, angle: float) -> tuple[float, int]:
    """Return the distance to the first segment along a ray, and its index; inf, -1 for none."""
    u = np.array([math.cos(angle), math.sin(angle)])
    a = env.segments.xy[:, :2] - (x, y)
    e = env.segments.xy[:, 2:] - env.segments.xy[:, :2]
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = u[0] * e[:, 1] - u[1] * e[:, 0]
        t = (a[:, 0] * e[:, 1] - a[:, 1] * e[:, 0]) / cross
        s = (a[:, 0] * u[1] - a[:, 1] * u[0]) / cross
    t = np.where((t >= 0) & (s >= -1e-9) & (s <= 1 + 1e-9), t, np.inf)
    return float(t.min()), int(t.argmin()) if np.isfinite(t.min()) else -1


def room(env: Environment, x: float, y: float) -> float:
    """Return the distance to the nearest segment, metres."""
    a = env.segments.xy[:, :2] - (x, y)
    e = env.segments.xy[:, 2:] - env.segments.xy[:, :2]
    t = np.clip(-(a * e).sum(axis=1) / (e * e).sum(axis=1), 0.0, 1.0)
    return float(np.hypot(*(a + t[:, None] * e).T).min())


def stands(
    env: Environment, scanner: RangeScanner, model: AmbiguityModel, x: float, y: float, theta: float
) -> bool:
    """Return whether a robot can stand at a pose: no wall in its body, in or before a sensor."""
    # A body meets the occupied cells of a map, a sensor the walls that its rays meet.
    body = env.collision if model.robot_radius > 0.0 else env
    if not (env.is_free(x, y) and body.is_free(x, y)):
        return False
    if room(body, x, y) < model.robot_radius or room(env, x, y) <= TOUCHING:
        return False
    for mx, my in np.unique(scanner.mounts[:, :2], axis=0):
        off, angle = math.hypot(mx, my), theta + math.atan2(my, mx)
        inside = env.is_free(x + off * math.cos(angle), y + off * math.sin(angle))
        if not inside or (off > 1e-9 and cast(env, x, y, angle)[0] <= off + TOUCHING):
            return False
    return True


def finest_std(sensor: RangeSensor, model: AmbiguityModel) -> float:
    """Return the effective deviation of the sensor's most precise reading, metres."""
    span = np.linspace(0, sensor.max_range, 1024)
    finest = float((sensor.std_at(span) ** 2).min()) + model.map_std**2
    return max(math.sqrt(finest + sensor.resolution**2 / 12), FINEST_STD)


def beams(
    env: Environment, scanner: RangeScanner, model: AmbiguityModel, x: float, y: float, theta: float
) -> tuple[Vector, Vector, Vector, Vector]:
    """Return mean readings (B,), gradients (B, 3), effective variances (B,), bin widths (B,).

    In a building with reflectors the intensities follow, of the beams that read them.

    Raises:
        InputError: the building or a beam is not in the plane.
    """
    plane_only(env, "the reference of a scan")
    check_rays(env, scanner.upright[:, 0], scanner.upright[:, 1])
    ranges, gradients, variances, widths = [], [], [], []
    intensities, blur = [], []
    rays = scanner.rays()
    for b in range(scanner.beams):
        sensor = scanner.sensors[scanner.sensor_of_beam[b]]
        best, gradient = sensor.max_range + BEYOND, np.zeros(3)
        ends_unknown, reflects = False, False
        for r in range(rays.start[b], rays.start[b + 1]):
            angle = theta + rays.angle[r]
            c, s = math.cos(theta), math.sin(theta)
            mx, my = rays.origin[r]
            sx, sy = x + c * mx - s * my, y + s * mx + c * my
            d, k = cast(env, sx, sy, angle)
            if k < 0 or d >= best:
                continue
            u, n = np.array([math.cos(angle), math.sin(angle)]), env.normals(k)
            if math.acos(min(abs(float(n @ u)), 1.0)) > (sensor.max_incidence or math.inf):
                continue
            if rays.start[b] < r < rays.start[b + 1] - 1:
                # Nearest within its cone: a foot or an end of the wall, at rest as the robot turns.
                n = -u
            facing = math.copysign(max(abs(float(n @ u)), GRAZING), float(n @ u))
            turn = np.array([-s * mx - c * my, c * mx - s * my]) + d * np.array([-u[1], u[0]])
            best, gradient = d, -np.array([n[0], n[1], n @ turn]) / facing
            ends_unknown = bool(env.segments.kind[k] == FRONTIER and d < sensor.max_range)
            reflects = bool(env.segments.kind[k] == REFLECTOR)
        channel = sensor.intensity
        if channel is not None and env.has_reflectors:
            nearest = max(channel.min_range, sensor.min_range)
            has_intensity = nearest <= best < sensor.max_range and not ends_unknown
            intensities.append(channel.reflector if has_intensity and reflects else channel.wall)
            blur.append(channel.std**2 if has_intensity else BLIND)
        if best < sensor.min_range:
            best, gradient = sensor.min_range, np.zeros(3)
        noise = sensor.std_at(min(best, sensor.max_range)) ** 2 + model.map_std**2
        low, high = (float(sensor.bias_at(max(best + e, 0.0))) for e in (-1e-4, 1e-4))
        ranges.append(best + float(sensor.bias_at(best)))
        gradients.append(gradient * (1.0 + (high - low) / 2e-4))
        blurred = max(float(noise) + sensor.resolution**2 / 12, FINEST_STD**2)
        variances.append(BLIND if ends_unknown else blurred)
        widths.append(sensor.resolution / finest_std(sensor, model))
    still = np.zeros((len(intensities), 3))
    return (
        np.array(ranges + intensities), np.vstack([*gradients, still]),
        np.array(variances + blur), np.array(widths + [0.0] * len(blur)),
    )  # fmt: skip


def compare(
    p: tuple[Vector, ...], q: tuple[Vector, ...], limit: Vector, cap: Vector, tau: float, C: Vector
) -> tuple[float, Vector, Vector]:
    """Return I(p, q) over q's cell, the best offset (3,) and its covariance (3, 3)."""
    s2 = (p[2] + q[2]) / 2
    seen, J = np.minimum(p[0], limit), q[1]

    def laplace(w: Vector, z: Vector) -> tuple[Vector, Vector]:
        L = (J * w[:, None]).T @ J / (2 * tau) + np.linalg.inv(C)
        S = np.asarray(np.linalg.inv(L))
        return S, np.asarray(S @ (J.T @ (w * z))) / (2 * tau)

    # First step: each beam's residual, seen through what the cell can move it.
    z = seen - q[0]
    silent = (p[0] >= limit) & (z < 0)
    z = np.where(silent, 0.0, z)
    u = z**2 / (4 * s2) / (1 + np.einsum("bi,ij,bj->b", J, C, J) / (2 * s2))
    _, offset = laplace(np.where(silent, 0.0, 1 / s2 / (1 + u / cap) ** 2), z)
    # Second step: at that offset, the evidence, capped, and the quadratic that touches it.
    moved = J @ offset
    z = seen - q[0] - moved
    silent = z <= seen - limit + TIE
    z = np.maximum(z, seen - limit)
    proof = np.array([float(evidence(v, w)) for v, w in zip(z / np.sqrt(s2), p[3], strict=True)])
    near = np.maximum(np.abs(z) / np.sqrt(s2), 1e-2)
    slope = np.array([float(evidence(v, w)) for v, w in zip(near, p[3], strict=True)])
    slope /= near**2 / 4 * s2
    t = 1 / np.sqrt(1 + (proof / cap) ** 2)
    w = np.where(silent, 0.0, slope * t**3)
    S, best = laplace(w, z + moved)
    total = float(np.sum(proof * t + w * ((z + moved) ** 2 - z**2) / 4))
    gain = float(best @ (J.T @ (w * (z + moved)))) / (4 * tau)
    alike = math.exp(min(gain - total / tau, 0.0)) * math.sqrt(np.linalg.det(S) / np.linalg.det(C))
    return alike, best, S


def reachable(
    env: Environment,
    x: float,
    y: float,
    spacing: float,
    radius: float,
    possible: Callable[[float, float], bool] | None = None,
) -> set[tuple[int, int]]:
    """Return lattice steps from (x, y) in the disc, reached by free steps over possible poses.

    `possible` decides where a pose is possible; None: anywhere in the free space.
    """
    if possible is None:

        def possible(a: float, b: float) -> bool:
            return bool(env.is_free(a, b))

    reached, todo = {(0, 0)}, [(0, 0)]
    while todo:
        i, j = todo.pop()
        for di, dj in ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)):
            to = (i + di, j + dj)
            if to in reached or math.hypot(*to) * spacing > radius * (1 + 1e-9):
                continue
            if not possible(x + to[0] * spacing, y + to[1] * spacing):
                continue
            step = math.hypot(di, dj) * spacing
            if cast(env, x + i * spacing, y + j * spacing, math.atan2(dj, di))[0] < step:
                continue
            reached.add(to)
            todo.append(to)
    return reached


def pose_sums(
    env: Environment,
    scanner: RangeScanner,
    model: AmbiguityModel,
    spacing: float,
    x: float,
    y: float,
    theta: float = 0.0,
) -> Vector:
    """Compute `neighbourhood_sums` of the pose, shape (7,); nan where it is impossible."""
    if not stands(env, scanner, model, x, y, theta):
        return np.full(7, np.nan)
    C = np.diag([spacing**2 / 4, spacing**2 / 4, model.sigma_theta**2])
    sensors = [scanner.sensors[i] for i in scanner.sensor_of_beam]
    limits = [s.max_range for s in sensors]
    if env.has_reflectors:
        with_intensity = [s for s in sensors if s.intensity is not None]
        sensors, limits = sensors + with_intensity, limits + [math.inf] * len(with_intensity)
    limit = np.array(limits)
    odd = [min(model.outlier_share + s.random_share + s.lost_share, 0.99) for s in sensors]
    cap = -np.log(odd)
    for b in range(scanner.beams):
        cap[b] = most_evidence(odd[b], finest_std(sensors[b], model))
    at_pose = beams(env, scanner, model, x, y, theta)
    weight, alike_moment, free_moment = 0.0, np.zeros((2, 2)), np.zeros((2, 2))
    cells = reachable(
        env, x, y, spacing, model.radius, lambda a, b: stands(env, scanner, model, a, b, theta)
    )
    for i, j in sorted(cells):
        step = np.array([i, j]) * spacing
        beside = beams(env, scanner, model, x + step[0], y + step[1], theta)
        alike, offset, S = compare(at_pose, beside, limit, cap, model.tau, C)
        to = step + offset[:2]
        weight += alike
        alike_moment += alike * (np.outer(to, to) + S[:2, :2])
        free_moment += np.outer(step, step) + C[:2, :2]
    a, f = alike_moment / weight, free_moment / len(cells)
    return np.array([weight / len(cells), a[0, 0], a[0, 1], a[1, 1], f[0, 0], f[0, 1], f[1, 1]])
