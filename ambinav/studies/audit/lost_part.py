"""Routes that lose robots in the audit's document."""

from __future__ import annotations

from pydantic import Field

from ambinav.forecasting.document import ODOMETRY
from ambinav.forecasting.forecast import Forecast
from ambinav.reports.fields import Metres, Part, Share
from ambinav.studies.audit.lost_routes import FEW, LostRoutes


class LostRoutePart(Part):
    """A route on which robots get lost."""

    start_m: tuple[Metres, Metres]
    goal_m: tuple[Metres, Metres]
    length_m: Metres
    lost_probability: Share
    text: str = Field(description="probability and main cause in words")
    x_m: Metres | None = Field(description="where most get lost; null: spread over the route")
    y_m: Metres | None
    kind: str | None = Field(description="open floor, sliding or heading: the error that grows")


class LostPart(Part):
    """Forecasts of shortest routes between places drawn evenly from the reachable floor."""

    localizer: str = Field(description="calibrated class of localizer")
    odometry: str
    pairs: int = Field(description="number of sampled pairs of places")
    share_safe: Share = Field(description="of these, with fewer than 5 % of robots lost")
    text: str
    routes: tuple[LostRoutePart, ...] = Field(
        description="up to five with the most lost robots, at least 5 %; the worst first"
    )


def lost_part(lost: LostRoutes) -> LostPart:
    """Collect the forecasts."""
    first, pairs = lost.forecasts[0], len(lost.forecasts)
    safe = round(lost.share_safe * pairs)
    return LostPart(
        localizer=first.localizer.name,
        odometry=ODOMETRY,
        pairs=pairs,
        share_safe=lost.share_safe,
        text=(
            f"On {safe} of {pairs} shortest routes between sampled places fewer than "
            f"{100.0 * FEW:.0f} % of robots are forecast to get lost: robots that are kept on the "
            f"route, with {ODOMETRY} odometry and {first.localizer.title}."
        ),
        routes=tuple(map(_route, lost.worst)),
    )


def _route(forecast: Forecast) -> LostRoutePart:
    (x0, y0), (x1, y1) = forecast.poses[[0, -1], :2].tolist()
    cause = forecast.causes[0] if forecast.causes else None
    return LostRoutePart(
        start_m=(x0, y0),
        goal_m=(x1, y1),
        length_m=float(forecast.distance[-1]),
        lost_probability=forecast.lost_probability,
        text=forecast.sentence,
        x_m=None if cause is None else cause.x,
        y_m=None if cause is None else cause.y,
        kind=None if cause is None else cause.kind,
    )
