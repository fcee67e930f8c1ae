"""Interface of the scenes that rays are cast against."""

from __future__ import annotations

from typing import Protocol

from ambinav.casting.plane.triangulation import Triangulation
from ambinav.casting.space import SpaceCaster
from ambinav.runtime.array_types import Floats, Ints32


class Scene(Protocol):
    """Free space as triangles, and the segments on its border, as in `Environment`.

    Where it has a `space`, rays of scanners are cast against that; see `scans.scan_rays`.
    """

    @property
    def name(self) -> str:
        """Name of the scene in messages."""

    @property
    def space(self) -> SpaceCaster | None:
        """The building in three dimensions; None: it is a plan."""

    @property
    def floor(self) -> float:
        """Z of the floor in `space`, metres."""

    @property
    def triangulation(self) -> Triangulation:
        """The free space as triangles, with K border edges."""

    @property
    def border_segment(self) -> Ints32:
        """Segment on which each border edge lies, shape (K,)."""

    @property
    def border_lines(self) -> Floats:
        """End points of the line of each border edge, (K, 4), metres, map frame."""
