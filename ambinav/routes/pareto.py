"""Pareto front over weights: extra length against lower exposure."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import write_text
from ambinav.runtime.runfolder import RunFolder

SLACK = 1e-9
"""Relative difference below which two lengths or exposures count as equal."""
FOLDER: Final = RunFolder(
    "Pareto front",
    ("pareto.csv", "pareto.json", "pareto.png", "route-*.csv", "routes.png"),
    proof="pareto.json",
)
"""Folder that `ambinav plan --pareto` writes."""


@dataclass(frozen=True, eq=False)
class ParetoPoint:
    """Route of one weight.

    Attributes:
        weight: Extra metres for one metre at layer 1.
        route: The route that was planned with it.
        lost: Share of robots forecast to get lost on it; None: no forecast was made.
    """

    weight: float
    route: Route
    lost: float | None = None


@dataclass(frozen=True, eq=False)
class ParetoFront:
    """Routes between the same two poses for several weights.

    Attributes:
        points: At least one, by rising weight.

    Raises:
        InputError: no point at all.
    """

    points: tuple[ParetoPoint, ...]

    def __post_init__(self) -> None:
        if not self.points:
            raise InputError("points is empty; a front needs at least one route.")
        ordered = tuple(sorted(self.points, key=lambda point: point.weight))
        object.__setattr__(self, "points", ordered)

    @property
    def dominated(self) -> tuple[bool, ...]:
        """Flag of each point: another point is as good in length and exposure, and better in one.

        Points that are equal in both do not dominate each other.
        """
        return tuple(any(_dominates(a.route, b.route) for a in self.points) for b in self.points)

    def with_lost(self, shares: Iterable[float]) -> ParetoFront:
        """Return the front with the share of robots forecast to get lost on each route.

        Raises:
            ValueError: there are more or fewer shares than points.
        """
        pairs = zip(self.points, shares, strict=True)
        return ParetoFront(tuple(replace(point, lost=share) for point, share in pairs))

    @property
    def shortest(self) -> Route:
        """Shortest of the routes, to which extra length is relative."""
        return min((point.route for point in self.points), key=lambda route: route.length)

    @property
    def extra(self) -> tuple[float, ...]:
        """Extra length of each point, as a share of the shortest route's length."""
        least = self.shortest.length
        return tuple(
            point.route.length / least - 1.0 if least > 0.0 else 0.0 for point in self.points
        )

    def rows(self) -> list[dict[str, Any]]:
        """Return the front as a table, one row per point."""
        return [
            {
                "weight": point.weight,
                "length_m": point.route.length,
                "duration_s": point.route.duration,
                "extra_percent": 100.0 * extra,
                "cost": point.route.cost,
                "exposure_m": point.route.exposure,
                **{f"{zone}_m": metres for zone, metres in point.route.zone_metres.items()},
                "unexplored_m": point.route.unexplored_metres,
                "bad_m": point.route.bad_metres,
                "longest_bad_m": point.route.longest_bad,
                "longest_corridor_m": point.route.longest_corridor,
                "longest_open_m": point.route.longest_open,
                "turn_rad": point.route.turn,
                **({} if point.lost is None else {"lost_probability": point.lost}),
                "dominated": dominated,
            }
            for point, extra, dominated in zip(self.points, self.extra, self.dominated, strict=True)
        ]

    def save(self, path: str | Path) -> None:
        """Write the table, completely or not at all: `.csv`, or `.json` as a list of objects.

        Raises:
            InputError: another ending, or the place is not writable.
        """
        path = Path(path)
        rows = self.rows()
        if path.suffix == ".csv":
            out = io.StringIO()
            table = csv.DictWriter(out, fieldnames=list(rows[0]), lineterminator="\n")
            table.writeheader()
            table.writerows({**row, "dominated": int(row["dominated"])} for row in rows)
            text = out.getvalue()
        elif path.suffix == ".json":
            text = json.dumps(rows, indent=1, allow_nan=False) + "\n"
        else:
            raise InputError(
                f"{path}: the ending {path.suffix!r} names no format of fronts; choose .csv, .json."
            )
        write_text(path, text)


def _dominates(a: Route, b: Route) -> bool:
    shorter = b.length - a.length
    safer = b.exposure - a.exposure
    long, exposed = SLACK * b.length, SLACK * max(b.exposure, b.length)
    return shorter >= -long and safer >= -exposed and (shorter > long or safer > exposed)
