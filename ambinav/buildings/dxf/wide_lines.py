"""Edges of polylines that have a width, as walls are drawn in some drawings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from ezdxf.math import ConstructionArc, Vec2, bulge_to_arc

from ambinav.runtime.array_types import Floats

# Where parts meet at less than 45 degrees, the corner is cut off.
_MITRE: Final = 2.6
# Flag of a vertex that no curve passes: of the frame of a spline.
_FRAME: Final = 16


class _Part(NamedTuple):
    """Stretch of a polyline: corners, shape (n, 2), and its width at each, shape (n,)."""

    corners: Floats
    widths: Floats

    def is_constant(self) -> bool:
        return bool((self.widths == self.widths[0]).all())

    def continues(self, other: _Part) -> bool:
        """Return whether it begins where another one ends, and both are of one width."""
        one_width = self.is_constant() and other.is_constant() and self.widths[0] == other.widths[0]
        return one_width and bool((self.corners[0] == other.corners[-1]).all())

    def area(self) -> Any:
        """Return what it covers: a polygon, with sharp corners and without caps at its ends."""
        if self.is_constant():
            return shapely.buffer(
                shapely.LineString(self.corners), 0.5 * self.widths[0], cap_style="flat",
                join_style="mitre", mitre_limit=_MITRE,
            )  # fmt: skip
        along = np.gradient(self.corners, axis=0)
        sideways = np.stack([-along[:, 1], along[:, 0]], axis=1)
        sideways *= (0.5 * self.widths / np.hypot(*sideways.T))[:, None]
        sides = [self.corners + sideways, (self.corners - sideways)[::-1]]
        return shapely.make_valid(shapely.Polygon(np.concatenate(sides)))


def wide_outlines(polyline: Any, tolerance: float) -> Iterator[Floats]:
    """Yield the edges of a polyline, shape (n, 2) each, and as lines the parts of width 0.

    Args:
        polyline: An LWPOLYLINE or a 2D POLYLINE of ezdxf.
        tolerance: How far chords may lie from arcs.
    """
    areas = []
    lines = []
    for part in _joined(_parts(polyline, tolerance)):
        if part.widths.any():
            areas.append(part.area())
        else:
            lines.append(part.corners)
    for body in shapely.get_parts(shapely.union_all(areas)):
        lines += [shapely.get_coordinates(ring) for ring in (body.exterior, *body.interiors)]
    ocs = polyline.ocs()
    for line in lines:
        points = [ocs.to_wcs((x, y, 0.0)) for x, y in line.tolist()]
        yield np.array([(point.x, point.y) for point in points])


def _joined(parts: Iterable[_Part]) -> list[_Part]:
    """Join parts of one width that follow each other, so that there are corners between them."""
    joined: list[_Part] = []
    for part in parts:
        if joined and part.continues(joined[-1]):
            joined[-1] = _one(joined[-1], part)
        else:
            joined.append(part)
    if len(joined) > 1 and joined[0].continues(joined[-1]):
        joined[0] = _one(joined.pop(), joined[0])
    return joined


def _one(first: _Part, second: _Part) -> _Part:
    return _Part(
        np.concatenate([first.corners, second.corners[1:]]),
        np.concatenate([first.widths, second.widths[1:]]),
    )


def _parts(polyline: Any, tolerance: float) -> Iterator[_Part]:
    """Yield what lies between the vertices, in the polyline's own coordinates."""
    if polyline.dxftype() == "LWPOLYLINE":
        closed = polyline.closed
        # Where it is not 0, it is that of all parts, whatever they say themselves.
        width = polyline.dxf.get("const_width", 0.0)
        vertices = [
            (Vec2(x, y), width or start_width, width or end_width, bulge)
            for x, y, start_width, end_width, bulge in polyline.lwpoints
        ]
    else:
        closed = polyline.is_closed
        first, last = (polyline.dxf.get(f"default_{end}_width", 0.0) for end in ("start", "end"))
        vertices = [
            (
                Vec2(vertex.dxf.location), vertex.dxf.get("start_width", first),
                vertex.dxf.get("end_width", last), vertex.dxf.get("bulge", 0.0),
            )
            for vertex in polyline.vertices
            if not vertex.dxf.get("flags", 0) & _FRAME
        ]  # fmt: skip
    for (start, width, end_width, bulge), (end, *_) in pairwise(vertices + vertices[: int(closed)]):
        if start == end:
            continue
        points = [start, end]
        if not math.isfinite(start.magnitude + end.magnitude + width + end_width + bulge):
            yield _Part(np.full((2, 2), np.nan), np.zeros(2))
            continue
        if bulge:
            centre, a0, a1, radius = bulge_to_arc(start, end, bulge)
            arc = ConstructionArc(centre, radius, math.degrees(a0), math.degrees(a1))
            inner = list(arc.flattening(tolerance))[1:-1]
            points[1:1] = inner if bulge > 0 else inner[::-1]
        widths = np.linspace(abs(width), abs(end_width), len(points))
        yield _Part(np.array([(point.x, point.y) for point in points]), widths)
