"""`ambinav forecast`: how far off, and how likely lost, a robot will be on a route."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ambinav.cli import options
from ambinav.cli.checks import check_picture
from ambinav.cli.forecast_options import ForecastOptions
from ambinav.cli.printing import show, table
from ambinav.cli.running import note, reporting
from ambinav.forecasting.document import ODOMETRY, forecast_document

if TYPE_CHECKING:
    from rich.table import Table

    from ambinav.forecasting.forecast import Forecast


@options.documented
def forecast(
    map_file: options.StoredMap,
    route_file: Annotated[Path, typer.Argument()],
    robot: ForecastOptions,
    picture: Path | None = None,
    as_json: options.AsJson = False,
) -> None:
    """Forecast how far off a robot's localizer will be along a route, and how likely it gets lost.

    Example: `ambinav forecast office.zarr route.csv --odometry poor --picture forecast.png`

    Parameters:
        route_file (ROUTE): A route that `ambinav plan` wrote.
        picture (FILE): Draw where robots get lost and how the error grows: .png, .pdf or .svg.
            [default: none]
    """
    with reporting():
        robot.check()
        check_picture(picture)
        from ambinav.maps.ambiguity_map import AmbiguityMap
        from ambinav.routes.files import load_route

        route = load_route(route_file)
        amap = AmbiguityMap.open(map_file)
        for name, planned in (("environment", route.environment), ("scanner", route.scanner)):
            if planned and planned != (of_map := amap.dataset.attrs[name]):
                note(f"{route_file}: planned with the {name} {planned}; the map has {of_map}.")
        result = robot.forecaster(amap)(route)
        if picture is not None:
            from ambinav.plotting.canvas import save_figure
            from ambinav.plotting.forecast import plot_forecast

            save_figure(plot_forecast(amap, result), picture)
        if as_json:
            document = forecast_document(result, robot.odometry or ODOMETRY)
            picture_entry = {} if picture is None else {"picture": str(picture)}
            typer.echo(json.dumps(document | picture_entry, indent=2))
            return
        show(result.sentence)
        if result.reliability is None:
            show("How far that holds was not measured for this localizer, start or limits.")
        else:
            show(result.reliability.sentence)
        if result.causes:
            show("", _causes(result))
        show("", f"largest error: {result.expected_error.max():.2f} m (root mean square)")
        show(f"localizer: {result.localizer.title}; odometry: {robot.odometry or ODOMETRY}")
        if picture is not None:
            show(f"picture: {picture}")


def _causes(result: Forecast) -> Table:
    rows = (
        (
            f"{cause.start:.1f} to {cause.end:.1f} m",
            f"({cause.x:.1f}, {cause.y:.1f}) m",
            f"{100.0 * cause.probability:.1f} %",
            cause.kind,
        )
        for cause in result.causes
    )
    return table(("along the route", "near", "lost there", "error"), rows, left=("error",))
