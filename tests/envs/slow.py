"""The environment over again, one robot, slowly: NumPy and the core's own pieces.

Only random numbers are drawn as the environment draws them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambinav.drive.follower import limited
from ambinav.drive.localizers import compose_motion
from ambinav.drive.world import moved, unicycle
from ambinav.geometry.segments import FRONTIER
from ambinav.localization.random import normals, uniform, ziggurat
from ambinav.sensing import RangeSensor
from ambinav.service.service import AmbiguityService
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.simulation.layout import MOTION_NOISE, SCANNER, TERMS

Floats = NDArray[np.float64]


class SlowNavigation:
    """Follows a `NavigationEnv` that has just been reset."""

    def __init__(self, env: NavigationEnv) -> None:
        simulation = env.simulation
        site, task = simulation.sites[0], simulation.tasks[0]
        assert site is not None and task is not None
        state = simulation.state[0]
        self.p, self.building, self.task = simulation.parameters, site.building, task
        self.truth, self.odometry = state["truth"].copy(), state["odometry"].copy()
        self.mean, self.cov = state["mean"].copy(), state["covariance"].copy()
        self.speeds, self.distance, self.steps = np.zeros(2), float(state["distance"]), 0
        self.motion_random, self.scanner_random = (
            state["random"][MOTION_NOISE].copy(),
            state["random"][SCANNER].copy(),
        )
        self.exposure = self.travelled = 0.0
        self.level = AmbiguityService(self.building.amap, self.p.cost_layer)
        self.fisher = AmbiguityService(self.building.amap, "fisher")

    def step(self, action: Floats) -> tuple[dict[str, Floats], float, dict[str, Any]]:
        p, robot = self.p, self.p.robot
        want = p.min_speed + 0.5 * (action[0] + 1.0) * (robot.max_speed - p.min_speed)
        turn = action[1] * robot.max_turn_rate
        self.speeds[:] = limited(*self.speeds, want, turn, robot.limits, p.dt)
        before, reported = self.truth.copy(), self.odometry.copy()
        *pose, met = moved(
            *before, *self.over_ground(), p.dt, robot.radius, *self.building.checker.arrays[:2]
        )
        self.truth = np.array(pose)
        # What is left of the step at a wall is seen of the turn that is left.
        share = 1.0
        if met:
            turned = math.remainder(self.truth[2] - before[2], 2.0 * math.pi)
            share = turned / (self.ground[1] * p.dt)
        self.odometry = np.array(unicycle(*reported, *self.speeds, share * p.dt))
        self.cov = p.odometry.spread(
            self.mean[None], self.cov[None], reported[None], self.odometry[None]
        )[0]
        self.mean = compose_motion(self.mean[None], reported[None], self.odometry[None])[0]
        self.steps += 1
        readings = self.read()
        self.update(readings)
        line = (before[0], before[1], self.truth[0], self.truth[1], before[2], self.truth[2])
        error = float(np.hypot(*(self.mean - self.truth)[:2]))
        # An arc, whose chord is shorter by far less than a millimetre.
        driven = (
            abs(self.ground[0]) * p.dt if not met else float(np.hypot(*(self.truth - before)[:2]))
        )
        here = self.building.lattice.distance(self.task.cost_to_go.costs, *self.truth[:2])
        terms = dict.fromkeys(TERMS, 0.0)
        terms["progress"] = self.distance - p.gamma * here
        terms["collision"] = -float(met)
        terms["time"] = -p.dt
        terms["ambiguity"] = float(self.level.reward(*line))
        terms["fisher"] = float(self.fisher.reward(*line))
        terms["error"] = -error * driven
        self.distance = here
        self.exposure -= terms["ambiguity"]
        self.travelled += driven
        reward = sum(weight * terms[term] for weight, term in zip(p.weights, TERMS, strict=True))
        info = {"terms": terms, "error": error, "met": met, "estimate": self.mean.copy()}
        return self.observation(readings), reward, info

    def over_ground(self) -> Floats:
        """Speeds of the robot, given those of its wheels, which odometry measures."""
        noise, dt = self.p.true_odometry.packed, self.p.dt
        a, b = normals(self.motion_random)
        trans, turn = np.abs(self.speeds) * dt
        along = math.sqrt(noise.trans_trans * trans + noise.trans_turn * turn) * a
        turned = math.sqrt(noise.turn_turn * turn + 2.0 * noise.turn_trans * trans) * b
        self.ground = self.speeds + np.array([along, turned]) / dt
        return self.ground

    def read(self) -> Floats:
        """Readings: true ranges, bias, noise, bins."""
        scanner = self.p.scanner
        sensors = [scanner.sensors[k] for k in scanner.sensor_of_beam]
        # In full precision: a reading hangs on which bin it is in.
        true, _ = self.building.environment.cast_hits(
            self.truth[0], self.truth[1], self.truth[2] + scanner.mounts[:, 2], 99.0
        )
        true = np.where(true <= [s.max_range for s in sensors], true, math.inf)
        out = np.empty_like(true)
        noises = [ziggurat(self.scanner_random) for _ in true]
        for b, (d, s, noise) in enumerate(zip(true, sensors, noises, strict=True)):
            value = d + float(s.bias_at(d)) + float(s.std_at(d)) * noise
            if value >= s.max_range:
                out[b] = math.inf
            elif value < s.min_range:
                out[b] = -math.inf
            else:
                out[b] = middle(s, value)
        share = sensors[0].random_share + sensors[0].lost_share
        b = -1
        while True:
            b += 1 + int(math.log(1.0 - uniform(self.scanner_random)) / math.log1p(-share))
            if b >= len(out):
                return out
            chance = share * uniform(self.scanner_random) / sensors[b].random_share
            low = sensors[b].min_range + sensors[b].resolution * chance * sensors[b].bins
            out[b] = middle(sensors[b], low) if chance < 1.0 else math.inf

    def update(self, readings: Floats) -> None:
        """Iterated Kalman update for lasers at the robot's centre.

        Later rounds stay on the walls met at first, with the gradients that they had there.
        """
        env, scanner = self.building.environment, self.p.scanner
        yaw = scanner.mounts[:, 2]
        reach = np.array([scanner.sensors[k].max_range for k in scanner.sensor_of_beam])
        angle = self.mean[2] + yaw
        first, segment = env.cast_hits(self.mean[0], self.mean[1], angle, float(reach.max()))
        n, ends = env.normals(segment), env.segments.xy[segment, :2]
        sensor = scanner.sensors[0]
        seen = np.isfinite(readings) & (segment >= 0) & (first <= reach)
        seen &= env.segments.kind[segment] != FRONTIER
        prior, cov, at, spread = self.mean.copy(), self.cov.copy(), self.mean.copy(), self.cov

        def on_lines(pose: Floats) -> tuple[Floats, Floats, Floats]:
            u = np.stack([np.cos(pose[2] + yaw), np.sin(pose[2] + yaw)], axis=1)
            facing = (n * u).sum(axis=1)
            return ((ends - pose[:2]) * n).sum(axis=1) / facing, facing, u

        d, facing, u = on_lines(prior)
        facing = np.copysign(np.maximum(np.abs(facing), 0.05), facing)
        side = np.stack([-u[:, 1], u[:, 0]], axis=1) * d[:, None]
        g = -np.column_stack([n, (n * side).sum(axis=1)]) / facing[:, None]
        variance = sensor.std_at(d) ** 2 + sensor.resolution**2 / 12.0 + env.map_std**2
        for _ in range(self.p.iterations):
            off = readings - on_lines(at)[0] - sensor.bias_at(d)
            expected = variance + np.einsum("bi,ij,bj->b", g, spread, g)
            use = seen & (off**2 <= self.p.gate**2 * expected)
            G, w = g[use], 1.0 / variance[use]
            spread = np.linalg.inv(np.linalg.inv(cov) + (G.T * w) @ G)
            at = prior + spread @ (G.T * w) @ (off[use] + G @ (at - prior))
        self.mean, self.cov = at, spread
        self.mean[2] = (at[2] + math.pi) % (2.0 * math.pi) - math.pi

    def observation(self, readings: Floats) -> dict[str, Floats]:
        robot, (x, y, theta) = self.p.robot, self.mean
        turned = np.array([[math.cos(theta), math.sin(theta)], [-math.sin(theta), math.cos(theta)]])
        to_goal = turned @ (self.task.goal - self.mean[:2])
        away = float(np.hypot(*to_goal))
        values, axes = np.linalg.eigh(turned @ self.cov[:2, :2] @ turned.T)
        weak = 2.0 * math.atan2(axes[1, 1], axes[0, 1])
        deviations = np.sqrt([values[1], values[0], self.cov[2, 2]])
        reach = np.array(
            [self.p.scanner.sensors[k].max_range for k in self.p.scanner.sensor_of_beam]
        )
        return {
            "scan": np.clip(readings / reach, 0.0, 1.0),
            "goal": np.array([away / 10.0, *(to_goal / away)]),
            "velocity": self.speeds / (robot.max_speed, robot.max_turn_rate),
            "uncertainty": np.array(
                [*deviations[:2], math.cos(weak), math.sin(weak), deviations[2]]
            ),
            "window": self.window(x, y, theta),
            "remaining": np.array([1.0 - self.steps / self.p.max_steps]),
        }

    def window(self, x: float, y: float, theta: float) -> Floats:
        cells, spacing = self.p.window_cells, self.p.window_spacing
        amap = self.building.amap
        values, free = amap.dataset[self.p.cost_layer].values, amap.dataset["free"].values
        left, low = float(amap.dataset["x"][0]), float(amap.dataset["y"][0])
        table, bound = self.building.checker.arrays[:2]
        out = np.zeros((2, cells, cells))
        out[0] = 1.0
        for r in range(cells):
            for c in range(cells):
                ahead, aside = ((cells - 1) / 2 - k for k in (r, c))
                px = x + spacing * (ahead * math.cos(theta) - aside * math.sin(theta))
                py = y + spacing * (ahead * math.sin(theta) + aside * math.cos(theta))
                # The clearance at the nearest point of the checker's lattice, 0.1 m apart.
                column = math.floor((px - table[14]) / table[16] + 0.5)
                row = math.floor((py - table[15]) / table[16] + 0.5)
                inside = 0 <= row < bound.shape[0] and 0 <= column < bound.shape[1]
                if not inside or bound[row, column] < spacing / 2:
                    continue
                column = math.floor((px - left) / amap.spacing + 0.5)
                row = math.floor((py - low) / amap.spacing + 0.5)
                if 0 <= row < free.shape[0] and 0 <= column < free.shape[1]:
                    out[1, r, c] = 1.0
                    if free[row, column]:
                        out[0, r, c] = values[row, column]
        return out.ravel()


def middle(sensor: RangeSensor, value: float) -> float:
    """Of the bin that a range is in."""
    low = math.floor((value - sensor.min_range) / sensor.resolution) * sensor.resolution
    low += sensor.min_range
    return (low + min(low + sensor.resolution, sensor.max_range)) / 2.0
