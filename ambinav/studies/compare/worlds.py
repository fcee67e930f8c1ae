"""The true building during the drives of a pair's routes: walls and boxes."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import numpy as np

from ambinav.drive.clutter import scattered_boxes, with_obstacles
from ambinav.geometry.environment import Environment
from ambinav.routes.files import trace_route
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.studies.compare.plans import Plan
from ambinav.studies.compare.scenario_file import ScenarioBundle


def make_worlds(loaded: ScenarioBundle, plans: Sequence[Plan]) -> dict[str, Environment]:
    """Return the building with its obstacles, for each pair by name.

    All routes of a pair are driven in the same world, and no box is on any of them.

    Raises:
        InputError: there is no room for this number of boxes.
    """
    obstacles = loaded.scenario.obstacles
    worlds = {}
    for pair in dict.fromkeys(plan.pair for plan in plans):
        worlds[pair] = loaded.environment
        if obstacles.count:
            rng = np.random.default_rng([obstacles.seed, zlib.crc32(pair.encode())])
            try:
                boxes = scattered_boxes(
                    loaded.environment,
                    obstacles.count,
                    rng,
                    sizes=obstacles.sizes,
                    route=_join_routes([plan for plan in plans if plan.pair == pair]),
                    margin=loaded.scenario.robot.radius + obstacles.margin,
                )
            except InputError as error:
                raise InputError(f"obstacles, pair {pair!r}: {error}") from error
            worlds[pair] = with_obstacles(loaded.environment, boxes)
    return worlds


def _join_routes(plans: Sequence[Plan]) -> Floats:
    """Join all routes of a pair into one line that runs forth and back alternately.

    Between two routes there are at most the few centimetres by which given ones may end apart.
    """
    lines = [trace_route(plan.route) for plan in plans]
    return np.concatenate([line[::-1] if i % 2 else line for i, line in enumerate(lines)])
