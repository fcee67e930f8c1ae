"""Parts that documents on obstacles and reflectors share: head, positions, GeoJSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import Field

from ambinav.buildings.obstacle_file import collection
from ambinav.geometry.collision.reach import Reach
from ambinav.geometry.environment import Environment
from ambinav.reports.fields import Metres, Part, rounded
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.design.place.candidates import Candidate
from ambinav.version import __version__

Rounded = Annotated[float, rounded(4)]


class BuildingDocument(Part):
    """A report on changes of a building, with its head."""

    format: str
    ambinav_version: str = __version__
    environment: str
    source: str
    sha256: str
    scanner: str
    robot_radius_m: float


def head_of(environment: Environment, scanner: RangeScanner, reach: Reach) -> dict[str, Any]:
    """Return the fields of a `BuildingDocument` on what was judged."""
    return {
        "environment": environment.name,
        "source": str(environment.source or ""),
        "sha256": environment.checksum,
        "scanner": scanner.name,
        "robot_radius_m": reach.radius,
    }


class PlacedPart(Part):
    """Kind and position of a placed obstacle; made by `of` from a `Candidate`."""

    number: int
    kind: str = Field(description="post, panel or tag")
    x_m: Metres
    y_m: Metres
    direction_deg: float | None = Field(description="of a panel or a tag; null for a post")
    on_wall: bool


def placed_geojson(
    placed: Sequence[Candidate], properties: Sequence[dict[str, Any]]
) -> dict[str, Any]:
    """Return obstacles as GeoJSON, readable by the page of `ambinav serve`.

    Args:
        placed: The obstacles.
        properties: Properties of each besides its kind.
    """
    made = collection(candidate.drawn for candidate in placed)
    for feature, candidate, more in zip(made["features"], placed, properties, strict=True):
        # In these files a reflector has the kind "reflector"; its true kind is stored as "as".
        feature["properties"] |= {"as": candidate.kind, **more}
    return made
