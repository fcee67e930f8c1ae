"""The static background: floor in the colours of the zones, and walls."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import pygame
from scipy.ndimage import distance_transform_edt
from shapely import get_parts

from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import NOT_FREE, OPEN, ZONES
from ambinav.plotting import style
from ambinav.runtime.array_types import Floats
from ambinav_envs.rendering.camera import Camera

# The zones are paler than in a map by this share of white, so that what moves stands out.
PALE = 0.3
# What is left of an unexplored cell's colour, as in the pictures of maps.
EXPLORED = 0.35
# Width of a wall, metres, and the least in pixels.
WALL, THINNEST = 0.06, 3
_HOLE = (255, 0, 255)


def _rgb(colour: str) -> Floats:
    return np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)], dtype=np.float64)


_UNKNOWN, _SOLID = _rgb(style.UNKNOWN), _rgb(style.SOLID)
_ZONES = np.array([(1.0 - PALE) * _rgb(colour) + PALE * 255.0 for colour in style.ZONE_COLOURS])

ZONE_COLOURS: Final = {
    name: tuple(int(part) for part in colour) for name, colour in zip(ZONES, _ZONES, strict=True)
}
"""Red, green and blue, 0 to 255, of each zone as it is drawn here."""

UNEXPLORED_COLOUR: Final = tuple(
    int(part) for part in EXPLORED * _ZONES[OPEN] + (1.0 - EXPLORED) * _UNKNOWN
)


def floor_picture(amap: AmbiguityMap, environment: Environment, camera: Camera) -> pygame.Surface:
    """Draw the visible floor of the map and the true walls."""
    picture = pygame.Surface(camera.size)
    picture.fill(_UNKNOWN.astype(int).tolist())
    _cells(picture, amap, camera)
    _outside(picture, amap, environment, camera)
    _walls(picture, environment, camera)
    return picture


def _cells(picture: pygame.Surface, amap: AmbiguityMap, camera: Camera) -> None:
    """Draw the visible zones, also beyond the free cells."""
    zone = amap.floor("zone").values
    if (zone != NOT_FREE).any():
        rows, columns = distance_transform_edt(
            zone == NOT_FREE, return_distances=False, return_indices=True
        )
        colours = _ZONES[zone[rows, columns]]
        faded = amap.unmapped[rows, columns]
        colours[faded] = EXPLORED * colours[faded] + (1.0 - EXPLORED) * _UNKNOWN
        _lay(picture, colours, amap, camera)


def _lay(picture: pygame.Surface, colours: Floats, amap: AmbiguityMap, camera: Camera) -> None:
    """Draw the visible map cells, colours of shape (ny, nx, 3)."""
    left, low, right, high = camera.bounds
    x, y = (amap.dataset[axis].values for axis in ("x", "y"))
    half = 0.5 * amap.spacing
    across = np.flatnonzero((x > left - half) & (x < right + half))
    up = np.flatnonzero((y > low - half) & (y < high + half))
    if across.size and up.size:
        part = colours[up[0] : up[-1] + 1, across[0] : across[-1] + 1]
        small = pygame.surfarray.make_surface(part[::-1].transpose(1, 0, 2).astype(np.uint8))
        corner = camera.pixels((x[across[0]] - half, y[up[-1]] + half))
        far = camera.pixels((x[across[-1]] + half, y[up[0]] - half))
        size = np.maximum(np.rint(far) - np.rint(corner), 1.0).astype(int)
        picture.blit(pygame.transform.scale(small, size.tolist()), np.rint(corner).tolist())


def _outside(
    picture: pygame.Surface, amap: AmbiguityMap, environment: Environment, camera: Camera
) -> None:
    """Cover the area that is not free: solid, or unknown."""
    cover = pygame.Surface(camera.size)
    cover.fill(_UNKNOWN.astype(int).tolist())
    solid = amap.solid[..., np.newaxis]
    _lay(cover, np.where(solid, _SOLID, _UNKNOWN), amap, camera)
    # Drawn apart, so that the holes of a piece show what is in them.
    free = pygame.Surface(camera.size)
    parts: list[Any] = [p for p in get_parts(environment.free) if p.area > 0.0]
    # A room inside the hole of another one is the smaller of the two.
    for part in sorted(parts, key=lambda p: -p.area):
        pygame.draw.polygon(free, _HOLE, camera.pixels(np.array(part.exterior.coords)).tolist())
        for hole in part.interiors:
            outline = camera.pixels(np.array(hole.coords)).tolist()
            pygame.draw.polygon(free, (0, 0, 0), outline)
    shown = pygame.surfarray.array3d(cover)
    shown[pygame.surfarray.array3d(free).any(axis=2)] = _HOLE
    cover = pygame.surfarray.make_surface(shown)
    cover.set_colorkey(_HOLE)
    picture.blit(cover, (0, 0))


def _walls(picture: pygame.Surface, environment: Environment, camera: Camera) -> None:
    """Draw walls as dark strokes, frontiers grey and half as wide, and reflectors bright."""
    segments = environment.segments
    ends = camera.pixels(segments.xy.reshape(-1, 2, 2))
    low, high = ends.min(axis=1), ends.max(axis=1)
    shown = (high > -9.0).all(axis=1) & (low < np.array(camera.size) + 9.0).all(axis=1)
    wide = max(THINNEST, round(WALL * camera.scale))
    for of_kind, colour, width in (
        (~segments.walls, style.FRONTIER, max(1, wide // 2)),
        (segments.walls, style.WALL, wide),
        (segments.reflectors, style.REFLECTOR, max(1, wide // 2)),
    ):
        for a, b in ends[shown & of_kind].tolist():
            stroke(picture, colour, a, b, width)


def stroke(
    picture: pygame.Surface, colour: Any, a: list[float], b: list[float], width: float
) -> None:
    """Draw a straight line with round ends, since pygame's wide lines have slanted ones."""
    along = np.subtract(b, a)
    length = float(np.hypot(*along))
    if length > 0.0:
        side = 0.5 * width * np.array([-along[1], along[0]]) / length
        corners = [np.add(a, side), np.add(b, side), np.subtract(b, side), np.subtract(a, side)]
        pygame.draw.polygon(picture, colour, [corner.tolist() for corner in corners])
    if width >= 3.0:
        for end in (a, b):
            pygame.draw.circle(picture, colour, end, 0.5 * width)
