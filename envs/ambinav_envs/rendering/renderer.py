"""Pictures of a simulation's robots, as arrays or in a window."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any, Final
from weakref import WeakSet

import numpy as np
import pygame
from gymnasium.error import ResetNeeded

from ambinav.runtime.array_types import Bools, Bytes, Floats
from ambinav_envs.buildings.building import Building
from ambinav_envs.rendering.camera import Camera
from ambinav_envs.rendering.floor import floor_picture
from ambinav_envs.rendering.marks import Marks
from ambinav_envs.rendering.panel import panel
from ambinav_envs.simulation.layout import LOCALIZERS, ODOMETRY, OUTCOMES, PERFECT
from ambinav_envs.simulation.simulation import Simulation
from ambinav_envs.simulation.site import Site

SIZE: Final = (960, 640)
"""Width and height of a picture, pixels: the same for all buildings, even, as videos want it."""

# Everything is drawn larger by this and then made smaller, which smoothes all edges.
FINE = 2
PANEL = 240
# Number of cached floor pictures.
KEPT = 6

# The renderers whose robots are in the window.
_shown: WeakSet[Renderer] = WeakSet()


class Renderer:
    """Draws a simulation.

    Args:
        simulation: The simulation to draw.
        view: See `camera.VIEWS`.
    """

    def __init__(self, simulation: Simulation, view: str = "auto") -> None:
        self._simulation = simulation
        self._view = view
        self._trails: list[list[Floats]] = [[] for _ in range(simulation.count)]
        self._floors: OrderedDict[tuple[Building, Camera], pygame.Surface] = OrderedDict()
        self._window: pygame.Surface | None = None
        self._clock: pygame.time.Clock | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without pygame's objects, which are created again; trails are kept."""
        return self.__dict__ | {"_floors": OrderedDict(), "_window": None, "_clock": None}

    def note(self) -> None:
        """Record the robots' poses; call it after every step and reset."""
        state = self._simulation.state
        for i, trail in enumerate(self._trails):
            if state["steps"][i] == 0:
                trail.clear()
            trail.append(np.concatenate([state["truth"][i], state["mean"][i]]))

    def frame(self, row: int = 0) -> Bytes:
        """Return the picture of a robot, shape (height, width, 3).

        Raises:
            ResetNeeded: it has no episode yet.
        """
        small = pygame.transform.smoothscale(self._picture(row), SIZE)
        return np.ascontiguousarray(pygame.surfarray.array3d(small).transpose(1, 0, 2))

    def show(self, rate: float, row: int = 0) -> None:
        """Show a robot in a window, and wait until the next picture is due.

        Args:
            rate: Pictures a second.
            row: Which robot.

        Raises:
            ResetNeeded: it has no episode yet.
        """
        picture = self._picture(row)
        # Anyone may have closed it with `pygame.quit`, and another renderer opened it again.
        if self._window is None or pygame.display.get_surface() is not self._window:
            pygame.display.init()
            pygame.display.set_caption("ambinav")
            self._window = pygame.display.set_mode(SIZE)
            self._clock = pygame.time.Clock()
            _shown.add(self)
        self._window.blit(pygame.transform.smoothscale(picture, SIZE), (0, 0))
        pygame.event.pump()
        pygame.display.flip()
        assert self._clock is not None
        self._clock.tick(rate)

    def close(self) -> None:
        """Close the window."""
        if self._window is not None:
            _shown.discard(self)
            self._window = None
            # All renderers share one window.
            if not _shown:
                pygame.display.quit()
        self._floors.clear()

    def _picture(self, row: int) -> pygame.Surface:
        """Draw floor, moving parts and panel, `FINE` times as large."""
        simulation, p = self._simulation, self._simulation.parameters
        site, state = simulation.sites[row], simulation.state[row]
        if site is None:
            raise ResetNeeded("there is nothing to render yet; call reset first.")
        size = FINE * (SIZE[0] - PANEL), FINE * SIZE[1]
        camera = Camera.on(site.building.environment, self._view, state["truth"], size)
        floor = self._floor(site, camera).copy()
        marks = Marks(floor, camera)
        trail = np.array(self._trails[row]).reshape(-1, 6)
        if len(trail) > 1:
            marks.trail(trail[:, :2])
            marks.estimated_trail(trail[:, 3:5])
        marks.goal(state["goal"], p.goal_radius)
        marks.scan(*self._beams(row))
        for box in simulation.boxes[row, : state["boxes"]]:
            marks.box(box)
        for person in simulation.people[row]:
            marks.person(person, p.people.radius)
        has_covariance = LOCALIZERS.index(p.localizer) not in (PERFECT, ODOMETRY)
        marks.robot(state["truth"], p.robot.radius)
        marks.belief(state["mean"], state["covariance"] if has_covariance else None, p.robot.radius)
        shown = {"ellipse"} if has_covariance else set()
        shown |= {"boxes"} if state["boxes"] else set()
        shown |= {"people"} if p.people.count else set()
        shown |= {"unexplored"} if site.building.amap.unmapped.any() else set()
        surface = pygame.Surface((FINE * SIZE[0], FINE * SIZE[1]))
        surface.blit(floor, (0, 0))
        beside = FINE * PANEL, FINE * SIZE[1]
        figures = self._figures(row)
        surface.blit(panel(beside, site.building.key, figures, camera.scale, shown), (size[0], 0))
        return surface

    def _floor(self, site: Site, camera: Camera) -> pygame.Surface:
        key = site.building, camera
        if key not in self._floors:
            self._floors[key] = floor_picture(site.building.amap, site.world.environment, camera)
        self._floors.move_to_end(key)
        while len(self._floors) > KEPT:
            self._floors.popitem(last=False)
        return self._floors[key]

    def _beams(self, row: int) -> tuple[Floats, Floats, Bools]:
        """Return start and end of the latest beams, shape (B, 2), and which returned an echo."""
        scanner = self._simulation.parameters.scanner
        x, y, theta = self._simulation.state["truth"][row]
        readings = self._simulation.readings[row]
        mounts, co, si = scanner.mounts, np.cos(theta), np.sin(theta)
        origins = np.stack(
            [x + co * mounts[:, 0] - si * mounts[:, 1], y + si * mounts[:, 0] + co * mounts[:, 1]],
            axis=-1,
        )
        reach = np.array([sensor.max_range for sensor in scanner.sensors])[scanner.sensor_of_beam]
        far = np.where(np.isfinite(readings), readings, np.where(readings > 0.0, reach, 0.0))
        angle = theta + mounts[:, 2]
        ends = origins + far[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return origins, ends, np.isfinite(readings)

    def _figures(self, row: int) -> dict[str, str]:
        state, p = self._simulation.state[row], self._simulation.parameters
        outcome = OUTCOMES[int(state["outcome"])]
        if outcome == "running" and state["lost"]:
            outcome = "lost"
        error = float(np.hypot(*(state["mean"] - state["truth"])[:2]))
        return {
            "state": outcome,
            "time": f"{state['steps'] * p.dt:.1f} s",
            "driven": f"{state['travelled']:.1f} m",
            "to goal": f"{state['distance']:.1f} m",
            "error": f"{error:.2f} m",
            "exposure": f"{state['exposure']:.2f} m",
        }
