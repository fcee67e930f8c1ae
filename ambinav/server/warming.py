"""Preparation of a server, so that no request waits for the compilation of code."""

from __future__ import annotations

import logging
import time
from collections.abc import Awaitable, Callable, Sequence
from typing import Final

import numpy as np

from ambinav.geometry.motion.steering import KINDS, Steering
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.server.served import ServedMap
from ambinav.service.service import AmbiguityService

TURNING: Final = 0.5
"""Turning radius of the curves that are compiled, metres."""

_log = logging.getLogger("ambinav.server")

Step = Callable[[], Awaitable[object]]


class Warming:
    """Progress of the preparation.

    Attributes:
        seconds: Time that it took; None until it is done.
        failed: Number of steps that failed.
    """

    def __init__(self) -> None:
        self.seconds: float | None = None
        self.failed = 0
        self._step, self._count = 0, 0
        self._then: list[Callable[[float], None]] = []

    def then(self, call: Callable[[float], None]) -> None:
        """Call a function with `seconds` when the preparation is done."""
        self._then.append(call)

    @property
    def sentence(self) -> str:
        """State of the preparation."""
        return (
            f"The server is starting: {self._step} of {self._count} steps are done; "
            "ask again in a second."
        )

    async def run(self, steps: Sequence[Step]) -> None:
        """Take the steps one after the other; one that fails is left to the request for it."""
        begun = time.monotonic()
        self._count = len(steps)
        for step in steps:
            try:
                await step()
            except Exception:
                self.failed += 1
                _log.exception("a step of the preparation failed")
            self._step += 1
        self.seconds = time.monotonic() - begun
        for call in self._then:
            call(self.seconds)


def free_pose(amap: AmbiguityMap) -> tuple[float, float] | None:
    """Return the place that is farthest from all walls, metres; None if nothing is free."""
    possible = amap.possible.any(axis=2)
    if not possible.any():
        return None
    data = amap.dataset
    clearance = np.where(possible, data["clearance"].values, -1.0)
    row, column = np.unravel_index(int(np.nanargmax(clearance)), clearance.shape)
    return float(data["x"].values[column]), float(data["y"].values[row])


def load_kernels(served: ServedMap) -> None:
    """Compile or load the code of costs, levels and rewards, with all kinds of motion."""
    place = free_pose(served.amap)
    if place is None:
        return
    x, y = place
    near = served.around(x, y)
    service = AmbiguityService(near, served.amap.cost_layer)
    service.cost(x, y, 0.0)
    near.sample("level", x, y, 0.0)
    end = x + served.amap.spacing
    for kind in KINDS:
        curved = kind in ("dubins", "reeds-shepp")
        service.reward(x, y, end, y, 0.0, 0.0, Steering(kind, TURNING if curved else 0.0))
    service.reward(x, y, end, y, 0.0, 0.0)
