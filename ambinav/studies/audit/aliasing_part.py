"""Perceptual aliasing in the audit's document."""

from __future__ import annotations

from pydantic import Field

from ambinav.reports.fields import Degrees, Metres, Part, Share, SquareMetres
from ambinav.studies.audit.aliasing import AliasingFindings
from ambinav.studies.audit.repetition import RepetitionPart, find_repetitions

FLOOR_ALIASING = "floor-aliasing"
"""Picture of the aliased floor; its file ends in the format."""


class AliasedPairPart(Part):
    """Two regions from which the scanner sees the same: an aliased pair."""

    letter: str
    x_m: Metres
    y_m: Metres
    other_x_m: Metres
    other_y_m: Metres
    turn_deg: Degrees = Field(description="relative heading of the robot at the other place")
    distance_m: Metres
    area_m2: SquareMetres = Field(description="area of the region of aliased poses")
    likeness: Share = Field(description="mean similarity of the scans, 1 if identical")


class AliasingPart(Part):
    """Perceptual aliasing: poses with the same scan."""

    sought: bool
    poses: int = Field(
        description="number of poses of the floor, with their headings if they matter"
    )
    sought_from: int = Field(
        description="number of poses for which aliased poses were searched; 0: none"
    )
    spacing_m: Metres
    share: Share | None = Field(
        description="mean share of the poses with the same scan that are elsewhere"
    )
    area_m2: SquareMetres | None = Field(
        description="area of floor where this share is half or more"
    )
    pairs: tuple[AliasedPairPart, ...] = Field(description="the largest first")
    repetitions: tuple[RepetitionPart, ...] = Field(
        description="letters whose regions stand in a row"
    )
    picture: str | None


def aliasing_part(aliasing: AliasingFindings, image_format: str) -> AliasingPart:
    """Collect the aliased pairs."""
    return AliasingPart.of(
        aliasing,
        share=aliasing.share if aliasing.sought else None,
        area_m2=aliasing.area if aliasing.sought else None,
        pairs=tuple(map(AliasedPairPart.of, aliasing.pairs)),
        repetitions=find_repetitions(aliasing.pairs),
        picture=f"{FLOOR_ALIASING}.{image_format}" if aliasing.pairs else None,
    )
