"""What all routes of an application share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

from anyio import CapacityLimiter, to_thread
from fastapi import Request

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.server.limits import Limits
from ambinav.server.pyramid import Pyramids
from ambinav.server.served import ServedMap, ServedMaps
from ambinav.server.tiles import Tiles

T = TypeVar("T")

THREADS = 4
"""In which answers are worked out that would hold up the others."""


@dataclass
class Context:
    """What all routes share.

    Attributes:
        maps: The maps that are served.
        limits: What a request may cost.
    """

    maps: ServedMaps
    limits: Limits
    _tiles: dict[AmbiguityMap, Tiles] = field(default_factory=dict)
    _limiter: CapacityLimiter | None = None

    def tiles(self, served: ServedMap) -> Tiles:
        """The tiles of a map."""
        found = self._tiles.get(served.amap)
        if found is None:
            found = self._tiles[served.amap] = Tiles(served, Pyramids(served.amap))
        return found

    async def in_thread(self, function: Callable[..., T], *arguments: Any) -> T:
        """Call what takes long without holding up other requests."""
        if self._limiter is None:
            self._limiter = CapacityLimiter(THREADS)
        return await to_thread.run_sync(function, *arguments, limiter=self._limiter)


def context_of(request: Request) -> Context:
    """The context of a request's application."""
    context = request.app.state.context
    assert isinstance(context, Context)
    return context
