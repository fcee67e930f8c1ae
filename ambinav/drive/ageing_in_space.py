"""Aged walls and moved furniture in a building of prisms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from shapely.geometry.base import BaseGeometry

from ambinav.casting.prisms.prisms import NO_AREA, Prisms
from ambinav.geometry.edit_in_space import GROUND, STANDING
from ambinav.geometry.environment import Environment
from ambinav.runtime.array_types import Floats, Indices
from ambinav.runtime.errors import InputError

Thing = tuple[int, shapely.Polygon]


def prisms_of(environment: Environment, effect: str) -> Prisms | None:
    """Return the prisms of an environment; None for a plan.

    Args:
        environment: The building.
        effect: What is asked of it: a noun in the singular.

    Raises:
        InputError: it is a mesh, or the map of a building that keeps the floor alone.
    """
    space = environment.space
    if space is None or isinstance(space, Prisms):
        return space
    # Asked for its surfaces, a space that was not kept says so itself.
    triangles = len(space.surface_kind)
    raise InputError(
        f"{environment.name}: it is a mesh of {triangles} triangles, and {effect} is known for "
        "plans and prisms alone; give its plan, in Python environment.plan."
    )


def bent_lines(
    xy: Floats, moved: Callable[[Floats], Floats], piece: float
) -> tuple[Floats, Indices]:
    """Split lines, (N, 4), into pieces with moved ends, (M, 4); return each piece's line, (M,)."""
    lines = shapely.segmentize(shapely.linestrings(xy.reshape(-1, 2, 2)), piece)
    points, line = shapely.get_coordinates(lines, return_index=True)
    points, within = moved(points), line[1:] == line[:-1]
    return np.hstack([points[:-1], points[1:]])[within], line[1:][within]


def bent_area(shape: BaseGeometry, moved: Callable[[Floats], Floats], piece: float) -> BaseGeometry:
    """Return an area whose border, in pieces, was moved."""
    bent = shapely.transform(shapely.segmentize(shape, piece), moved)
    # Where walls touch, pieces may cross by a millimetre.
    return shapely.make_valid(bent, method="structure", keep_collapsed=False)


def bent_prisms(prisms: Prisms, moved: Callable[[Floats], Floats], piece: float) -> Prisms:
    """Return prisms with moved walls and outlines; heights stay the same."""
    sheets = prisms.given
    rows, owner = bent_lines(sheets.xy, moved, piece)
    solids = [
        replace(solid, outline=part)
        for solid in prisms.solids
        for part in shapely.get_parts(bent_area(solid.outline, moved, piece))
        if part.area > NO_AREA
    ]
    return prisms.refilled(
        sheets.among(owner)._replace(xy=rows),
        solids=solids,
        free=None if prisms.free is None else bent_area(prisms.free, moved, piece),
    )


@dataclass(frozen=True, eq=False)
class Piece:
    """Piece of furniture, which moves as one.

    Attributes:
        things: Its outlines on the plan, with the numbers of their rings.
        on_plan: What it covers on the plan.
        shape: What it covers seen from above, what overhangs too.
        bodies: Which bodies of `Bodies` are its own; none of a plan.
        low: Its lowest z, metres,
        high: and its highest.
    """

    things: list[Thing]
    on_plan: BaseGeometry
    shape: BaseGeometry
    bodies: Indices
    low: float = 0.0
    high: float = 0.0


class Bodies:
    """Walls without thickness and solids of a building, from which furniture is made.

    Args:
        prisms: The building.
        floor: z of its floor, metres.
        furniture: What is wider, metres, is none.
        touching: What is nearer to something else, metres, belongs to it.
    """

    def __init__(self, prisms: Prisms, floor: float, furniture: float, touching: float) -> None:
        self._prisms, self._furniture, self._touching = prisms, furniture, touching
        sheets = shapely.linestrings(prisms.walls.xy[: prisms.sheets].reshape(-1, 2, 2))
        of_solids = np.array([(s.bottom, s.top) for s in prisms.solids]).reshape(-1, 2)
        self.outline = np.array([*sheets, *(s.outline for s in prisms.solids)], dtype=object)
        self.low, self.high = np.concatenate([prisms.wall_z[: prisms.sheets], of_solids]).T
        self._moves: list[tuple[Piece, BaseGeometry, Floats]] = []
        self._gone: list[int] = []
        self._standing = (self.low <= floor + STANDING) & (self.high > floor + GROUND)
        self._above = self.high > floor + GROUND
        self._tree = shapely.STRtree(self.outline)
        narrow = self._above & (2.0 * shapely.minimum_bounding_radius(self.outline) <= furniture)
        first, second = self._tree.query(self.outline, predicate="dwithin", distance=touching)
        meet = np.minimum(self.high[first], self.high[second]) + touching >= np.maximum(
            self.low[first], self.low[second]
        )
        meet &= self._above[first] & self._above[second] & narrow[first]
        joined = meet & narrow[second]
        count = len(self.outline)
        links = coo_array((np.ones(joined.sum()), (first[joined], second[joined])), (count, count))
        _, self._part = connected_components(links, directed=False)
        # Parts that touch a wide body, such as a wall or a beam, belong to the building.
        fixed = np.unique(self._part[first[meet & ~narrow[second]]])
        self._movable = narrow & ~np.isin(self._part, fixed)

    def pieces(self, things: Sequence[Thing]) -> list[Piece]:
        """Return the pieces of furniture with these outlines on the plan, by their first one.

        Legs on which the same body rests are one piece. Left out is what no body stands in, what
        belongs to something that stays, and what is too wide with all that overhangs.
        """
        outlines = [outline for _, outline in things]
        thing, body = self._tree.query(outlines, predicate="dwithin", distance=self._touching)
        standing = self._standing[body]
        thing, part = thing[standing], self._part[body[standing]]
        count = len(things) + len(self.outline)
        links = coo_array((np.ones(len(thing)), (thing, len(things) + part)), (count, count))
        _, group = connected_components(links, directed=False)
        pieces = []
        for number in dict.fromkeys(group[: len(things)].tolist()):
            mine = np.flatnonzero(group[: len(things)] == number)
            parts = np.flatnonzero(group[len(things) :] == number)
            bodies = np.flatnonzero(np.isin(self._part, parts) & self._above)
            if not len(bodies) or not self._movable[bodies].all():
                continue
            members = [things[k] for k in mine.tolist()]
            covered = self._covered([outline for _, outline in members], bodies)
            if covered is not None:
                low, high = self.low[bodies].min(), self.high[bodies].max()
                pieces.append(Piece(members, *covered, bodies, float(low), float(high)))
        return pieces

    def _covered(
        self, outlines: list[shapely.Polygon], bodies: Indices
    ) -> tuple[BaseGeometry, BaseGeometry] | None:
        """Return a piece's area on the plan, and seen from above; None if it is no furniture."""
        apart = shapely.STRtree(outlines).query(
            outlines, predicate="dwithin", distance=self._touching
        )
        on_plan = outlines[0] if len(outlines) == 1 else shapely.union_all(outlines)
        near = shapely.buffer(on_plan, self._touching)
        over = self.outline[bodies][~shapely.covers(near, self.outline[bodies])]
        shape = shapely.union_all([on_plan, *over]) if len(over) else on_plan
        wide = 2.0 * shapely.minimum_bounding_radius(shape) > self._furniture
        return None if wide or apart.shape[1] > len(outlines) else (on_plan, shape)

    def beside(self, piece: Piece, shape: BaseGeometry, gap: float) -> bool:
        """Return whether a body at the piece's heights is within `gap` of its shape."""
        near = self._tree.query(shape, predicate="dwithin", distance=gap)
        near = near[(self.low[near] < piece.high) & (self.high[near] > piece.low)]
        if (self._above[near] & ~np.isin(near, [*piece.bodies, *self._gone])).any():
            return True
        return any(
            placed.low < piece.high and placed.high > piece.low and place.dwithin(shape, gap)
            for placed, place, _ in self._moves
        )

    def move(self, piece: Piece, place: BaseGeometry, shift: Floats) -> None:
        """Record that a piece now covers a shape, shifted by metres in x and in y."""
        self._moves.append((piece, place, shift))
        self._gone += piece.bodies.tolist()

    def moved(self) -> Prisms:
        """Return the building with the pieces at their new positions."""
        count, prisms, free = self._prisms.sheets, self._prisms, self._prisms.free
        by = np.zeros((len(self.outline), 2))
        holes = []
        for piece, _, shift in self._moves:
            by[piece.bodies] = shift
            for _, outline in piece.things:
                # A plan that goes on under the furniture is left as it is.
                if free is not None and not free.contains(outline.representative_point()):
                    holes.append((outline, translated(outline, shift)))
        if free is not None and holes:
            before, after = (shapely.union_all(part) for part in zip(*holes, strict=True))
            free = free.union(before).difference(after)
        sheets = prisms.given
        return prisms.refilled(
            sheets._replace(xy=sheets.xy + np.tile(by[:count], 2)),
            solids=[
                replace(solid, outline=translated(solid.outline, shift)) if shift.any() else solid
                for solid, shift in zip(prisms.solids, by[count:], strict=True)
            ],
            free=free,
        )


def translated(shape: BaseGeometry, shift: Floats) -> BaseGeometry:
    """Return a shape moved by metres in x and in y."""
    return shapely.transform(shape, lambda points: points + shift)
