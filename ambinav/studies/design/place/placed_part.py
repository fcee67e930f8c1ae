"""Placed obstacles in documents: kind and position of each, and all of them as GeoJSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pydantic import Field

from ambinav.buildings.obstacle_file import collection
from ambinav.reports.fields import Metres, Part
from ambinav.studies.design.place.candidates import Candidate


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
