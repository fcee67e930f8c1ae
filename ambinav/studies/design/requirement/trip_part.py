"""Trips of a requirement on lost robots in the report."""

from __future__ import annotations

from pydantic import Field

from ambinav.reports.fields import Metres, Part, Share
from ambinav.studies.design.requirement.study import Solution
from ambinav.studies.design.requirement.trip_forecasts import TripLosses


class DrivesPart(Part):
    """Drives of a trip's route by the localizer itself."""

    runs: int
    lost: int = Field(description="runs that got lost")
    low: Share = Field(description="lower end of the interval of the share that gets lost")
    high: Share


class TripStatePart(Part):
    """A trip in a building: its shortest route, and the robots that get lost on it."""

    length_m: Metres
    lost: Share = Field(description="share of robots that get lost, by the forecast")
    text: str = Field(description="the same in words, with the main cause")
    driven: DrivesPart | None = Field(
        description="null: no drives were needed; the worst trip of a building is always driven"
    )

    @classmethod
    def of_trip(cls, losses: TripLosses, number: int, threshold: float) -> TripStatePart:
        """Return the state of one of the trips."""
        forecast, driven = losses.forecasts[number], losses.drives(number, threshold)
        drives = (
            None
            if driven is None
            else DrivesPart(
                runs=len(driven),
                lost=int(driven.lost.sum()),
                low=max(driven.probability.low, 0.0),
                high=driven.probability.high,
            )
        )
        return cls(
            length_m=float(forecast.distance[-1]),
            lost=forecast.lost_probability,
            text=forecast.sentence,
            driven=drives,
        )


class TripPart(Part):
    """A trip between named places."""

    start: str
    goal: str
    start_m: tuple[Metres, Metres]
    goal_m: tuple[Metres, Metres]
    before: TripStatePart
    after: TripStatePart


def trip_parts(solution: Solution) -> tuple[TripPart, ...]:
    """Return each trip of a solution with its route as it is and after the changes."""
    before, after = solution.before.losses, solution.after.losses
    most = None if solution.requirement is None else solution.requirement.most_lost
    if solution.forecaster is None or before is None or after is None or most is None:
        return ()
    for losses in (before, after):
        losses.driven(int(losses.lost.argmax()), most)
    return tuple(
        TripPart.of(
            trip,
            start_m=trip.start_at,
            goal_m=trip.goal_at,
            before=TripStatePart.of_trip(before, number, most),
            after=TripStatePart.of_trip(after, number, most),
        )
        for number, trip in enumerate(solution.forecaster.trips)
    )


def worst_trip(trips: tuple[TripPart, ...], after: bool) -> str:
    """Return the share of robots lost on the worst trip, with its name."""
    states = [(trip.after if after else trip.before, trip) for trip in trips]
    state, trip = max(states, key=lambda pair: pair[0].lost)
    return f"{100.0 * state.lost:.1f} % ({trip.start} to {trip.goal})"


def trip_text(state: TripStatePart) -> str:
    """Return the forecast and the drives of a trip in a few words."""
    driven = state.driven
    if driven is None:
        return f"{100.0 * state.lost:.1f} %"
    return (
        f"{100.0 * state.lost:.1f} % (driven: {driven.lost} of {driven.runs}, "
        f"{100.0 * driven.low:.1f} to {100.0 * driven.high:.1f} %)"
    )
