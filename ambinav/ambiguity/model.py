"""Parameters of the ambiguity model, checked, with their defaults explained."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Annotated

from ambinav.config import NonNegative, Positive, check_fields, number, require
from ambinav.sensing.scanner import RangeScanner

# Neighbouring beams mostly see the same wall and share its error, so a turn of the scanner holds
# few independent pieces of evidence however many beams it has. With one in 24 degrees the
# corridors of real buildings show between their doors (see docs/model.md).
PIECES_PER_TURN = 15.0
# Beams per turn of the scanner that take part: more tell nothing new, see `independent_tau`.
BEAMS_PER_TURN = 60
# Upward it is the same: layers hold a piece in 24 degrees, and one in 6 degrees takes part.
PIECE_HEIGHT = 2.0 * math.pi / PIECES_PER_TURN
LAYER_SPACING = 2.0 * math.pi / BEAMS_PER_TURN


@dataclass(frozen=True, kw_only=True)
class AmbiguityModel:
    """Parameters of the ambiguity of a pose, beside environment and scanner.

    Attributes:
        radius: Radius R of the neighbourhood, metres.
        map_std: Standard deviation of a wall's position, metres; adds to the sensor's.
        tau: How many beams carry one independent piece of evidence, at least 1.
        sigma_theta: How well the heading is known beforehand, radians.
        outlier_share: Share of beams that meet what is not on the map; with the sensor's random
            and lost readings it caps what one beam can tell.
        low: A radius ratio up to this is small: the pose is fixed in that direction.
        high: A radius ratio from this on is large: the pose is free in that direction.
        robot_radius: Radius of the robot's body, metres: where it would stand inside a wall no
            pose is possible. 0: its centre and its sensors alone.
    """

    radius: Positive
    map_std: NonNegative
    tau: Annotated[float, number(least=1)]
    sigma_theta: Positive = 0.05
    outlier_share: Positive = 0.05
    low: Positive = 0.35
    high: Positive = 0.65
    robot_radius: NonNegative = 0.0

    def __post_init__(self) -> None:
        """Check every number and convert it to its type."""
        check_fields(self)
        require(self, "outlier_share", self.outlier_share < 1.0, "more than 0 and less than 1")
        require(self, "high", self.high < 1.0, "more than 0 and less than 1")
        require(self, "low", self.low < self.high, "more than 0 and less than high")

    def cell_variance(self, spacing: float) -> tuple[float, float]:
        """Return a pose's variance in a cell: x, y (square metres), theta (square radians).

        With half a spacing as deviation the Gaussians of neighbouring cells add up evenly.
        """
        return spacing**2 / 4, self.sigma_theta**2

    def as_dict(self) -> dict[str, float]:
        """Return the parameters by name."""
        return asdict(self)


def independent_tau(scanner: RangeScanner) -> float:
    """Return the beams per independent piece of evidence: `PIECES_PER_TURN` pieces a turn.

    Of a scanner with layers as many again for each `PIECE_HEIGHT` that they span. Fewer beams than
    pieces are all independent.
    """
    pieces = max(PIECES_PER_TURN * scanner.aperture / (2.0 * math.pi), 1.0)
    pieces *= max(scanner.vertical_aperture / PIECE_HEIGHT, 1.0)
    return max(1.0, scanner.beams / pieces)


def thin(scanner: RangeScanner, max_beams: int | None = None) -> RangeScanner:
    """Leave out beams that add no information.

    Args:
        scanner: All beams.
        max_beams: How many take part at the most; None: `BEAMS_PER_TURN` for each layer, these at
            least `LAYER_SPACING` apart, and one of each part.
    """
    if max_beams is None:
        share = scanner.aperture / (2 * math.pi)
        layers = 1 + round(scanner.vertical_aperture / LAYER_SPACING)
        max_beams = max(round(BEAMS_PER_TURN * share) * layers, 1)
        max_beams = max(max_beams, len(scanner.parts))
    return scanner.thinned(max_beams)
