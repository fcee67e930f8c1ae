"""Routes forecast a second, and the time of one route of 50 m, on maps that are open already."""

from __future__ import annotations

import numpy as np
from harness import environment_path, interleave, option, parser_of, report, spread, table
from lasers import laser

from ambinav.buildings.load import load_environment
from ambinav.forecasting.forecast import Forecaster
from ambinav.forecasting.information_field import InformationField
from ambinav.geometry.collision.reach import reach_of
from ambinav.map_building.build import build_map
from ambinav.routes.sampled import sample_routes

LENGTH = 50.0


def main() -> None:
    """Time the forecasts, and print the report."""
    parser = parser_of(
        __doc__,
        environments=option(("demo", "aces"), "names of environments"),
        routes=option(200, "routes that are sampled in each"),
        repeats=option(5, "rounds"),
    )
    args = parser.parse_args()
    header = [
        "environment", "metres a route", "routes a second", f"ms for {LENGTH:g} m, in batch",
        "ms for one route, causes included", "ms to prepare the map's information",
    ]  # fmt: skip
    rows = [timed_rows(name, args.routes, args.repeats) for name in args.environments]
    report("Forecasts", ("numpy", "numba"), table(header, rows), args.out)


def timed_rows(name: str, count: int, repeats: int) -> list[str]:
    """Return the row of an environment."""
    environment = load_environment(environment_path(name))
    amap = build_map(environment, laser(), store=False)
    forecaster = Forecaster(amap, "poor")
    rng = np.random.default_rng(7)
    drawn = sample_routes(environment, reach_of(environment, 0.2), count, rng)
    routes = [route for route in drawn for _ in range(5)]
    metres = 5.0 * sum(float(forecaster(route).distance[-1]) for route in drawn)
    timing = interleave(
        {
            "all": lambda: forecaster.lost_probabilities(routes),
            "one": lambda: forecaster(drawn[0]),
            "field": lambda: InformationField.of(amap),
        },
        repeats,
    )
    seconds = timing["all"].seconds
    return [
        name,
        f"{metres / len(routes):.1f}",
        spread([len(routes) / s for s in seconds], 0),
        spread([1e3 * s / metres * LENGTH for s in seconds], 3),
        spread([1e3 * s for s in timing["one"].seconds]),
        spread([1e3 * s for s in timing["field"].seconds], 0),
    ]


if __name__ == "__main__":
    main()
