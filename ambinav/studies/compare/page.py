"""The map of the comparison's page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ambinav.plotting.routes import route_styles
from ambinav.reports.page.map_data import map_data
from ambinav.studies.compare.plans import Plan
from ambinav.studies.compare.workers import Setup


def page_map(setup: Setup, plans: Sequence[Plan]) -> dict[str, Any]:
    """Return the map data of the page, with the routes."""
    data = map_data(setup.amap, setup.scanner)
    data["map"]["has_places"] = False
    data["routes"] = _routes(setup, plans)
    return data


def _routes(setup: Setup, plans: Sequence[Plan]) -> list[dict[str, Any]]:
    """Return all routes, pair by pair, in the styles of the pictures."""
    routes = []
    for pair in dict.fromkeys(plan.pair for plan in plans):
        pair_plans = [plan for plan in plans if plan.pair == pair]
        kinds = {p.name: p.kind for p in setup.scenario.routes if p.pair in (None, pair)}
        styles = route_styles({plan.name: plan.route for plan in pair_plans}, kinds)
        for plan in pair_plans:
            routes.append(
                {
                    "pair": pair,
                    "name": plan.name,
                    "baseline": plan.name == setup.scenario.baseline,
                    "style": styles[plan.name]._asdict(),
                    "length": round(plan.route.length, 3),
                    "exposure": round(plan.route.exposure, 3),
                    "route": plan.route.poses[:, :2].round(3).tolist(),
                }
            )
    return routes
