"""Options on the floor that a design is judged on."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from ambinav.studies.design.region import Region

PolygonFile = Annotated[
    Path | None,
    typer.Option(
        "--polygon",
        metavar="FILE",
        help="Floor within the polygons of a .geojson or .wkt file.",
        show_default="all floor that the robot reaches",
    ),
]


KeepOut = Annotated[
    Path | None,
    typer.Option(
        "--keep-out",
        metavar="FILE",
        help="Polygons (.geojson or .wkt, metres in the map frame) in which no obstacle may stand.",
        show_default="none",
    ),
]


def keep_out_zones(path: Path | None) -> BaseGeometry | None:
    """Return the polygons of a `--keep-out` file; None without one.

    Raises:
        InputError: the file cannot be read, or holds no polygon.
    """
    from ambinav.studies.design.region import Region

    return None if path is None else Region.of_file(path).shape


def check_one(polygon: object, route: object) -> None:
    """Check that polygon and route are not both given.

    Raises:
        InputError: they are.
    """
    if polygon and route:
        raise InputError("--polygon: it excludes --route; give one of the two.")


def route_region(path: Path) -> Region:
    """Return the floor under a route, at its headings.

    Raises:
        InputError: the file cannot be read, or holds no route.
    """
    from ambinav.routes.files import load_route
    from ambinav.studies.design.region import Region

    return Region.of_route(load_route(path), str(path))


@dataclass(frozen=True, kw_only=True)
class RegionOptions:
    """Options on the region: the whole map, a polygon or a route.

    Attributes:
        route (FILE): Floor under a route written by `ambinav plan` (.csv, .geojson, .json), at its
            headings. [default: all floor that the robot reaches]
    """

    PANEL: ClassVar[str] = "Region"

    polygon: PolygonFile = None
    route: Path | None = None

    def region(self) -> Region:
        """Return the region.

        Raises:
            InputError: both are given, or a file cannot be read or holds no floor.
        """
        from ambinav.studies.design.region import Region

        check_one(self.polygon, self.route)
        if self.polygon is not None:
            return Region.of_file(self.polygon)
        return Region.of_map() if self.route is None else route_region(self.route)
