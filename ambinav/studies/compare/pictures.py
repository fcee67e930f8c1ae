"""The pictures of a comparison: one of all pairs, and three of each pair."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from typing import Final

from ambinav.plotting.drives import DrivenRoute, plot_errors, plot_spread
from ambinav.plotting.routes import plot_routes
from ambinav.studies.compare.plans import Plan
from ambinav.studies.compare.results import STEP, Results, quantiles
from ambinav.studies.compare.workers import Setup
from ambinav.studies.study import Figures

OVERVIEW: Final = "overview"
PICTURES: Final = (OVERVIEW, "floor-*", "spread-*", "errors-*")
"""Names of the pictures without suffix, as patterns."""


def slug(name: str) -> str:
    """Convert a name to a part of a file name."""
    return re.sub(r"[^a-z0-9.]+", "-", name.lower()).strip("-.") or "unnamed"


def pair_figures(
    setup: Setup, plans: Sequence[Plan], results: Sequence[Results]
) -> dict[str, Figures]:
    """Return the drawing functions of the three pictures of each pair, by pair."""
    figures: dict[str, Figures] = {}
    for number, pair in enumerate(dict.fromkeys(plan.pair for plan in plans), start=1):
        driven = [
            _driven(setup, plan, result)
            for plan, result in zip(plans, results, strict=True)
            if plan.pair == pair
        ]
        routes = {route.name: route.route for route in driven}
        kinds = {route.name: route.kind for route in driven}
        name, world = f"{number:02d}-{slug(pair)}", setup.worlds[pair]
        figures[pair] = {
            f"floor-{name}": partial(
                plot_routes,
                setup.amap,
                routes,
                covariances=False,
                title=f"Routes: {pair}",
                kinds=kinds,
            ),
            f"spread-{name}": partial(
                plot_spread, setup.amap, driven, f"Error of the localizer: {pair}", world
            ),
            f"errors-{name}": partial(plot_errors, driven, f"Error along the route: {pair}"),
        }
    return figures


def _driven(setup: Setup, plan: Plan, results: Results) -> DrivenRoute:
    """Return a route and its drives in the form of the pictures."""
    kinds = {
        part.name: part.kind for part in setup.scenario.routes if part.pair in (None, plan.pair)
    }
    return DrivenRoute(
        name=plan.name,
        route=plan.route,
        kind=kinds.get(plan.name, ""),
        runs=len(results),
        error=quantiles(results.errors, [0.05, 0.5, 0.95]),
        step=STEP,
        lost_at=results.lost_at[results.metrics.lost],
        collided_at=results.end[results.metrics.collided],
    )
