"""The moving parts: robot, estimated pose, scan, goal, trails, boxes and people.

Everything has its own shape and a rim of the opposite lightness, so that it stands out on any
floor and without seeing colours.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Final

import numpy as np
import pygame
from numpy.typing import ArrayLike

from ambinav.plotting.style import BOX, ESTIMATE, GOAL_RING, PERSON, ROBOT, SIGMAS
from ambinav.runtime.array_types import Bools, Floats
from ambinav_envs.rendering.camera import Camera
from ambinav_envs.rendering.floor import stroke

WHITE: Final = "#FFFFFF"
BEAM: Final = (20, 20, 20, 55)
# Pixels of the (large) picture.
LINE = 5
CIRCLE = 48


class Marks:
    """Draws the moving parts on a picture."""

    def __init__(self, picture: pygame.Surface, camera: Camera) -> None:
        self.picture = picture
        self.camera = camera

    def robot(self, pose: ArrayLike, radius: float) -> None:
        """Draw the robot: a filled disc and its direction, at least some pixels large."""
        middle, nose, size = self._body(pose, radius)
        pygame.draw.circle(self.picture, WHITE, middle, size + 3)
        pygame.draw.circle(self.picture, ROBOT, middle, size)
        stroke(self.picture, WHITE, middle, nose, LINE)

    def belief(self, pose: ArrayLike, covariance: ArrayLike | None, radius: float) -> None:
        """Draw a hollow robot, and the ellipse of two standard deviations of its position.

        Args:
            pose: x, y, theta.
            covariance: Covariance of them, shape (3, 3); None: no ellipse.
            radius: Radius of the robot, metres.
        """
        middle, nose, size = self._body(pose, radius)
        if covariance is not None:
            self.ellipse(pose, covariance)
        pygame.draw.circle(self.picture, WHITE, middle, size + 4, LINE + 5)
        pygame.draw.circle(self.picture, ESTIMATE, middle, size + 2, LINE + 1)
        self._cased(np.array([middle, nose]), ESTIMATE, LINE)

    def ellipse(self, pose: ArrayLike, covariance: ArrayLike) -> None:
        """Draw the ellipse of two standard deviations; arguments as for `belief`."""
        rim = rim_of(np.asarray(pose)[:2], np.asarray(covariance)[:2, :2])
        self._cased(self.camera.pixels(rim), ESTIMATE, LINE - 1, closed=True)

    def goal(self, place: ArrayLike, radius: float) -> None:
        """Draw a ring of the goal's radius with a flag in it."""
        x, y = self.camera.pixels(place).tolist()
        size = max(radius * self.camera.scale, 14.0)
        pygame.draw.circle(self.picture, WHITE, (x, y), size + 3)
        pygame.draw.circle(self.picture, GOAL_RING, (x, y), size, LINE)
        foot, top = [x - 0.25 * size, y + 0.55 * size], [x - 0.25 * size, y - 0.6 * size]
        stroke(self.picture, GOAL_RING, foot, top, 4)
        flag = [top, [x + 0.5 * size, y - 0.3 * size], [x - 0.25 * size, y]]
        pygame.draw.polygon(self.picture, GOAL_RING, flag)

    def scan(self, origins: Floats, ends: Floats, echo: Bools) -> None:
        """Draw beams, and a dot at each echo.

        Args:
            origins: Origins of the beams, metres, map frame, shape (B, 2).
            ends: Shape (B, 2).
            echo: Which have one, shape (B,).
        """
        veil = pygame.Surface(self.camera.size, pygame.SRCALPHA)
        starts, stops = self.camera.pixels(origins), self.camera.pixels(ends)
        for a, b, hit in zip(starts.tolist(), stops.tolist(), echo.tolist(), strict=True):
            pygame.draw.line(veil, BEAM if hit else (*BEAM[:3], BEAM[3] // 2), a, b, 2)
        self.picture.blit(veil, (0, 0))
        for place in stops[echo].tolist():
            pygame.draw.circle(self.picture, ROBOT, place, 6)
            pygame.draw.circle(self.picture, WHITE, place, 4)

    def trail(self, places: Floats) -> None:
        """Draw the past true positions as a solid line."""
        self._cased(self.camera.pixels(places), ROBOT, 3)

    def estimated_trail(self, places: Floats) -> None:
        """Draw the estimated poses as dots at even distances."""
        points = self.camera.pixels(places)
        length = np.concatenate([[0.0], np.hypot(*np.diff(points, axis=0).T).cumsum()])
        at = np.arange(0.0, length[-1], 16.0)
        dots = np.stack([np.interp(at, length, points[:, k]) for k in (0, 1)], axis=-1).tolist()
        for colour, size in ((WHITE, 5), (ESTIMATE, 3.5)):
            for dot in dots:
                pygame.draw.circle(self.picture, colour, dot, size)

    def box(self, box: Floats) -> None:
        """Draw an unmapped box, crossed out: its middle and two half edges, shape (6,), metres."""
        middle, a, b = box[:2], box[2:4], box[4:]
        corners = self.camera.pixels([middle + a + b, middle + a - b, middle - a - b,
                                      middle - a + b]).tolist()  # fmt: skip
        pygame.draw.polygon(self.picture, BOX, corners)
        for k in (0, 1):
            stroke(self.picture, WHITE, corners[k], corners[k + 2], 3)
        self._cased(np.array(corners), ROBOT, 3, closed=True)

    def person(self, pose: Floats, radius: float) -> None:
        """Draw a person: a bright disc with a small head."""
        middle, _, size = self._body(pose, radius)
        pygame.draw.circle(self.picture, ROBOT, middle, size + 2)
        pygame.draw.circle(self.picture, PERSON, middle, size - 2)
        pygame.draw.circle(self.picture, ROBOT, middle, 0.45 * size)

    def _body(self, pose: ArrayLike, radius: float) -> tuple[list[float], list[float], float]:
        """Return middle, tip and radius of a disc, pixels."""
        x, y, theta = np.asarray(pose, dtype=np.float64).tolist()
        middle = self.camera.pixels((x, y))
        size = max(radius * self.camera.scale, 9.0)
        nose = middle + size * np.array([math.cos(theta), -math.sin(theta)])
        return middle.tolist(), nose.tolist(), size

    def _cased(self, points: Floats, colour: str, width: int, *, closed: bool = False) -> None:
        """Draw a line with a white rim."""
        listed = (np.concatenate([points, points[:1]]) if closed else points).tolist()
        for shade, wide in ((WHITE, width + 4), (colour, width)):
            for a, b in pairwise(listed):
                stroke(self.picture, shade, a, b, wide)


def rim_of(middle: Floats, covariance: Floats) -> Floats:
    """Return the rim of the ellipse of `SIGMAS` standard deviations, metres, shape (CIRCLE, 2)."""
    values, axes = np.linalg.eigh(covariance)
    angle = np.linspace(0.0, 2.0 * math.pi, CIRCLE, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    rim: Floats = middle + SIGMAS * (circle * np.sqrt(np.maximum(values, 0.0))) @ axes.T
    return rim
