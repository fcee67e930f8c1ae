"""The comparison as a single HTML file: its map and its text."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ambinav.plotting.routes import route_styles
from ambinav.reports.page.html import fill_page
from ambinav.reports.page.map_data import map_data
from ambinav.reports.parameters import scenario_parameters
from ambinav.studies.compare.actions import actions
from ambinav.studies.compare.document import Document
from ambinav.studies.compare.plans import Plan
from ambinav.studies.compare.workers import Setup


def compare_page(
    setup: Setup,
    plans: Sequence[Plan],
    report: Document,
    filters: Mapping[str, Callable[..., str]],
    values: Mapping[str, Any],
) -> str:
    """Write the comparison's HTML page.

    Args:
        setup: Map, scanner and scenario.
        plans: The routes.
        report: The figures.
        filters: Template filters of the written reports.
        values: Template values of the written reports, by name.
    """
    data = map_data(setup.amap, setup.scanner)
    data["map"]["has_places"] = False
    data["routes"] = _routes(setup, plans)
    return fill_page(
        "ambinav.studies.compare",
        "page.html.j2",
        data,
        filters,
        report=report,
        actions=actions(report),
        parameters=scenario_parameters(report.parameters),
        block=data["map"]["block"],
        **values,
    )


def _routes(setup: Setup, plans: Sequence[Plan]) -> list[dict[str, Any]]:
    """Return all routes, pair by pair, in the styles of the pictures."""
    routes = []
    for pair in dict.fromkeys(plan.pair for plan in plans):
        own = [plan for plan in plans if plan.pair == pair]
        kinds = {p.name: p.kind for p in setup.scenario.routes if p.pair in (None, pair)}
        styles = route_styles({plan.name: plan.route for plan in own}, kinds)
        for plan in own:
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
