"""Pareto fronts of scanners: bad area against one cost figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ambinav.runtime.errors import InputError

SLACK = 1e-9
"""Relative difference below which two values count as equal."""


@dataclass(frozen=True)
class FrontPoint:
    """A scanner in a front; less is better for both figures.

    Attributes:
        name: Name of the scanner.
        bad_area: Corridor and open zones of the floor that counts, square metres.
        against: Cost, in the front's unit.
        dominated_by: The first of those that are no worse in both and better in one, or None.
    """

    name: str
    bad_area: float
    against: float
    dominated_by: str | None = None


@dataclass(frozen=True)
class Front:
    """Scanners by bad area and one figure.

    Attributes:
        key: Name of the figure in files.
        title: Title for readers.
        unit: Unit of the figure; may be empty.
        points: Points whose figure is known, by rising figure, then bad area, then name.
    """

    key: str
    title: str
    unit: str
    points: tuple[FrontPoint, ...]

    @classmethod
    def of(
        cls, key: str, title: str, unit: str, values: Sequence[tuple[str, float, float]]
    ) -> Front:
        """Find which scanners dominate which others.

        Args:
            key: As in the attributes; so are title and unit.
            title: See there.
            unit: See there.
            values: Name, bad area and figure of each scanner; at least one.

        Raises:
            InputError: there is none.
        """
        if not values:
            raise InputError(f"{title}: no scanner has a figure; a front needs at least one.")
        order = sorted(values, key=lambda row: (row[2], row[1], row[0]))
        return cls(
            key,
            title,
            unit,
            tuple(
                FrontPoint(
                    name,
                    bad,
                    against,
                    next((o for o, b, a in order if _dominates(b, a, bad, against)), None),
                )
                for name, bad, against in order
            ),
        )

    def point(self, name: str) -> FrontPoint | None:
        """Return the point of a scanner; None if its figure is not known."""
        return next((point for point in self.points if point.name == name), None)

    @property
    def best(self) -> tuple[FrontPoint, ...]:
        """Scanners that no other scanner dominates."""
        return tuple(point for point in self.points if point.dominated_by is None)


def _dominates(bad_a: float, cost_a: float, bad_b: float, cost_b: float) -> bool:
    bad, cost = bad_b - bad_a, cost_b - cost_a
    slack = SLACK * max(bad_a, bad_b), SLACK * max(cost_a, cost_b)
    return bad >= -slack[0] and cost >= -slack[1] and (bad > slack[0] or cost > slack[1])
