"""The pictures of a comparison: one of all pairs, and three of each pair."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final

from ambinav.plotting.canvas import save_figure
from ambinav.plotting.drives import DrivenRoute, plot_errors, plot_spread
from ambinav.plotting.routes import plot_routes
from ambinav.plotting.style import FORMATS
from ambinav.runtime.files import replacing
from ambinav.studies.compare.overview import plot_overview
from ambinav.studies.compare.plans import Plan
from ambinav.studies.compare.results import STEP, Results, quantiles
from ambinav.studies.compare.tables import Row
from ambinav.studies.compare.workers import Setup

OVERVIEW: Final = "overview"
KINDS: Final = ("floor-", "spread-", "errors-")
"""Names of the pictures, and beginnings of those of a pair."""


PICTURES: Final = tuple(
    f"{name}.{image_format}"
    for image_format in FORMATS
    for name in (OVERVIEW, *(f"{kind}*" for kind in KINDS))
)
"""The same as patterns of files' names."""


def is_picture(name: str) -> bool:
    """Return whether a file name is one that the pictures of a comparison may have."""
    return any(fnmatchcase(name, pattern) for pattern in PICTURES)


def slug(name: str) -> str:
    """Convert a name to a part of a file name."""
    return re.sub(r"[^a-z0-9.]+", "-", name.lower()).strip("-.") or "unnamed"


def save_overview(rows: Sequence[Row], title: str, out: Path, image_format: str) -> str:
    """Draw the picture of all pairs in a format; return its file name."""
    name = f"{OVERVIEW}.{image_format}"
    with replacing(out / name) as scratch:
        save_figure(plot_overview(rows, title), scratch)
    return name


def save_pictures(
    setup: Setup,
    plans: Sequence[Plan],
    results: Sequence[Results],
    out: Path,
    image_format: str,
    progress: Callable[[float], None],
) -> dict[str, tuple[str, ...]]:
    """Draw three pictures for each pair in a format; return their file names by pair."""
    amap = setup.amap
    pairs = list(dict.fromkeys(plan.pair for plan in plans))
    named: dict[str, tuple[str, ...]] = {}
    for number, pair in enumerate(pairs):
        driven = [
            _driven(setup, plan, result)
            for plan, result in zip(plans, results, strict=True)
            if plan.pair == pair
        ]
        routes = {route.name: route.route for route in driven}
        kinds = {route.name: route.kind for route in driven}
        figures = (
            plot_routes(amap, routes, covariances=False, title=f"Routes: {pair}", kinds=kinds),
            plot_spread(amap, driven, f"Where the localizer errs: {pair}", setup.worlds[pair]),
            plot_errors(driven, f"Error along the route: {pair}"),
        )
        names = tuple(f"{kind}{number + 1:02d}-{slug(pair)}.{image_format}" for kind in KINDS)
        for name, figure in zip(names, figures, strict=True):
            with replacing(out / name) as scratch:
                save_figure(figure, scratch)
        named[pair] = names
        progress((number + 1) / len(pairs))
    return named


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
