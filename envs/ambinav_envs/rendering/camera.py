"""The visible part of a building, and the conversion of map points to pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import nearest
from ambinav.geometry.environment import Environment
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError

VIEWS: Final = ("auto", "whole", "follow")
"""The whole building, the surroundings of the robot, or (auto) that if the building is large."""

# Metres to a side that "follow" shows, and from which "auto" follows.
SURROUNDINGS = 18.0
LARGE = 32.0
# The picture moves on by so many metres at once, so that most steps show the same floor.
STRIDE = 3.0
# Share of the building's size that is left free around it.
MARGIN = 0.03


@dataclass(frozen=True)
class Camera:
    """Conversion from the map to pixels, north up.

    Attributes:
        x: Middle of the picture, metres, map frame.
        y: The same.
        scale: Pixels per metre.
        size: Width and height, pixels.
    """

    x: float
    y: float
    scale: float
    size: tuple[int, int]

    @classmethod
    def on(
        cls, environment: Environment, view: str, place: ArrayLike, size: tuple[int, int]
    ) -> Camera:
        """Create the camera of a view.

        Args:
            environment: The building.
            view: One of `VIEWS`.
            place: Position of the robot, x and y, metres.
            size: Width and height of the picture, pixels.
        """
        left, low, right, high = environment.bounds
        width, height = right - left, high - low
        if view == "whole" or (view == "auto" and max(width, height) <= LARGE):
            around = 1.0 + 2.0 * MARGIN
            scale = min(size[0] / (around * width), size[1] / (around * height))
            return cls(0.5 * (left + right), 0.5 * (low + high), scale, size)
        x, y = (STRIDE * np.round(np.asarray(place)[:2] / STRIDE)).tolist()
        return cls(x, y, min(size) / SURROUNDINGS, size)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Left, lower, right and upper limit of the visible part, metres."""
        half = 0.5 * self.size[0] / self.scale, 0.5 * self.size[1] / self.scale
        return self.x - half[0], self.y - half[1], self.x + half[0], self.y + half[1]

    def pixels(self, points: ArrayLike) -> Floats:
        """Convert points of the map, metres, shape (..., 2), to pixels of the picture."""
        x, y = np.moveaxis(np.asarray(points, dtype=np.float64)[..., :2], -1, 0)
        across = 0.5 * self.size[0] + (x - self.x) * self.scale
        return np.stack([across, 0.5 * self.size[1] - (y - self.y) * self.scale], axis=-1)


def as_view(value: object) -> str:
    """Return a value, checked to be one of `VIEWS`.

    Raises:
        InputError: it is none.
    """
    if value not in VIEWS:
        raise InputError(f"render_view is {value!r}; {nearest(str(value), VIEWS)}.")
    return str(value)
