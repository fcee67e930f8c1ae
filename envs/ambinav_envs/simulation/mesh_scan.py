"""Simulated scans in a mesh from true poses; Embree runs in the interpreter, not in kernels."""

from __future__ import annotations

import math

import numpy as np

from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.scans import check_rays
from ambinav.casting.space import SpaceRays
from ambinav.drive.world import unicycle
from ambinav.geometry.environment import Environment
from ambinav.runtime.array_types import Ints
from ambinav.runtime.kernels import kernel
from ambinav.sensing.scanner import RangeScanner
from ambinav_envs.simulation.layout import SCANNER, Memory
from ambinav_envs.simulation.scanner_kernel import ScannerArrays, capture
from ambinav_envs.simulation.space_scan import shade_in_space


class MeshScan:
    """The scanner of robots in a mesh.

    Args:
        environment: The floor of the mesh.
        mesh: The mesh.
        scanner: The scanner.
        arrays: The same, as kernels read it.

    Raises:
        InputError: a sensor lies on the floor, or embreex is not installed.
    """

    def __init__(
        self, environment: Environment, mesh: Mesh, scanner: RangeScanner, arrays: ScannerArrays
    ) -> None:
        table = scanner.rays(in_space=True)
        check_rays(environment, table.height, table.elevation)
        origin = np.column_stack([table.origin, table.height + environment.floor])
        self._mesh, self._table, self._scanner = mesh, table, arrays
        self._rays = SpaceRays(origin, table.angle, table.elevation)
        self._reach = scanner.max_range
        self._beam = np.repeat(np.arange(scanner.beams), np.diff(table.start))
        # Before threads start: Embree loads the mesh with the first ray.
        mesh.cast((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 1.0)

    def sense(self, rows: Ints, memory: Memory) -> None:
        """Simulate the scans of some robots at their true poses into their rows of `readings`."""
        settings, table = memory.settings[0], self._table
        truth = memory.state["truth"][rows]
        x, y, theta = np.ascontiguousarray(truth.T)
        crowded = memory.people.shape[1] > 0 or bool(memory.state["boxes"][rows].any())
        poses = np.empty((0, 0, 3))
        if crowded or settings["scan_time"] > 0.0:
            poses = np.empty((len(rows), len(table), 3))
            ago = self._scanner.moment[self._beam] * settings["scan_time"]
            _poses(rows, memory.state, ago, poses)
        if settings["scan_time"] > 0.0:
            x, y, theta = np.moveaxis(poses, -1, 0)
        distance, _, incidence = self._mesh.cast_scans(
            x, y, theta, self._rays, self._reach, incidence=table.specular
        )
        echo = table.echoes(distance, incidence)
        if crowded:
            before = distance.astype(np.float64)
            _shade(
                rows, poses, table.angle, table.elevation, table.origin, self._scanner.height,
                self._scanner.rise, memory, table.max_range, before, echo,
            )  # fmt: skip
        ranges = table.nearest(echo).astype(np.float64)
        _capture(rows, ranges, self._scanner, memory.state, memory.readings)


@kernel
def _poses(rows, states, ago, poses):
    """Write the robot poses at the time of each ray, extrapolating the last step's motion."""
    for k in range(rows.size):
        state = states[rows[k]]
        x, y, theta = state.truth[0], state.truth[1], state.truth[2]
        for j in range(ago.size):
            pose = poses[k, j]
            pose[0], pose[1], pose[2] = unicycle(
                x, y, theta, state.ground[0], state.ground[1], ago[j]
            )


@kernel
def _shade(
    rows, poses, azimuth, elevation, start, height, rise, memory, limit, distance, echo
):  # fmt: skip
    """Shorten the echoes of rays that meet a person or a box first; see `shade_in_space`."""
    settings = memory.settings[0]
    ux, uy = np.empty(azimuth.size), np.empty(azimuth.size)
    hit = np.empty(azimuth.size, dtype=np.int32)
    for k in range(rows.size):
        i = rows[k]
        state = memory.state[i]
        for j in range(azimuth.size):
            flat, turned = math.cos(elevation[j]), poses[k, j, 2] + azimuth[j]
            ux[j], uy[j], hit[j] = flat * math.cos(turned), flat * math.sin(turned), 0
        shade_in_space(
            poses[k], start, height, rise, memory.people, settings.person_radius, memory.boxes,
            state.boxes, state.door, i, (ux, uy, distance[k], hit, hit),
        )  # fmt: skip
        for j in range(azimuth.size):
            if hit[j] < 0:
                echo[k, j] = distance[k, j] if distance[k, j] <= limit[j] else math.inf


@kernel
def _capture(rows, ranges, scanner, states, readings):
    noise = np.empty(ranges.shape[1])
    for k in range(rows.size):
        i = rows[k]
        capture(ranges[k], scanner, states[i].random[SCANNER], noise, readings, i)
