"""Candidates for obstacles that are put up, posts, panels and tags, and the rules for them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal

import numpy as np
import shapely

from ambinav.buildings.obstacle_file import HIGHEST, DrawnObstacle
from ambinav.casting.mesh.mesh import Mesh
from ambinav.config import as_number
from ambinav.geometry.edit_in_space import top_of
from ambinav.geometry.environment import Environment
from ambinav.geometry.obstacle import Obstacle
from ambinav.runtime.errors import InputError

Kind = Literal["post", "panel", "tag"]
KINDS: Final[tuple[Kind, ...]] = ("post", "panel", "tag")


@dataclass(frozen=True)
class PlaceRules:
    """Kind of the obstacles and the rules for their positions.

    Attributes:
        kind: The name "post", "panel" or "tag" (a reflector flat on a wall).
        radius: Radius of a post, metres.
        width: Width of a panel or a tag, metres.
        min_passage: Passages at least this wide, metres, are not made narrower than this.
        on_walls: True if they may touch walls.
        free_standing: True if they may be free-standing; tags are not.
        reflective: True if they are reflectors.
        bottom: Height of the lower edge above the floor of a building in space, metres.
        top: Height of the upper edge likewise; None: that of the building.
        most: Maximum number of candidates; it determines the distance between them.

    Raises:
        InputError: a number is out of its range, or they may stand nowhere.
    """

    kind: Kind = "post"
    radius: float = 0.1
    width: float = 0.6
    min_passage: float = 0.9
    on_walls: bool = True
    free_standing: bool = True
    reflective: bool = False
    bottom: float = 0.0
    top: float | None = None
    most: int = 400

    def __post_init__(self) -> None:
        """Check the kind and every number."""
        if self.kind not in KINDS:
            raise InputError(f"kind is {self.kind!r}; choose from {', '.join(KINDS)}.")
        for name in ("radius", "width", "min_passage"):
            value = as_number(getattr(self, name), name)
            if not value > 0.0:
                option = name.replace("_", "-")
                raise InputError(f"--{option}: {value:g} is not above zero; give metres.")
        if not as_number(self.bottom, "--bottom") >= 0.0:
            raise InputError(
                f"--bottom: {self.bottom:g} is below the floor; give 0 or more metres."
            )
        if self.top is not None and not self.bottom < as_number(self.top, "--top") <= HIGHEST:
            raise InputError(
                f"--top: {self.top:g} is not above the bottom of {self.bottom:g}, or above "
                f"{HIGHEST:g}; give metres between."
            )
        if self.kind == "post" and 2.0 * self.radius >= self.min_passage:
            raise InputError(
                f"--radius: posts {2 * self.radius:g} m wide are not narrower than the passage of "
                f"{self.min_passage:g} m that must stay free; give less, or a larger --min-passage."
            )
        if self.most < 1:
            raise InputError(f"--candidates: {self.most} is too few; give 1 or more.")
        if not (self.on_walls or (self.free_standing and self.kind != "tag")):
            raise InputError("--free-standing: a tag is flat on a wall; leave this out.")

    @property
    def size_text(self) -> str:
        """The size of an obstacle for readers."""
        size = f"radius {self.radius:g} m" if self.kind == "post" else f"width {self.width:g} m"
        if self.top is not None:
            return f"{size}, {self.bottom:g} to {self.top:g} m above the floor"
        return size if self.bottom == 0.0 else f"{size}, from {self.bottom:g} m above the floor up"

    def suited(self, environment: Environment) -> PlaceRules:
        """Return the rules in a building: in a mesh, which has no reflectors, nothing reflects.

        Raises:
            InputError: there are heights and it is a plan, the obstacles begin above it, or tags
                are to be placed in a mesh.
        """
        name, space = environment.name, environment.space
        if space is None:
            if self.bottom > 0.0 or self.top is not None:
                raise InputError(
                    f"{'--bottom' if self.top is None else '--top'}: {name} is a plan, without "
                    "heights; leave this out, or give it a height: --extrude M."
                )
            return self
        height = top_of(space) - environment.floor
        if self.bottom >= height:
            raise InputError(
                f"--bottom: {self.bottom:g} is not below the top of {name}, {height:g} m above its "
                "floor; give less."
            )
        if self.top is not None and self.top > height + 1e-4:  # files hold float32
            raise InputError(
                f"--top: {self.top:g} is above the top of {name}, {height:.4g} m above its floor; "
                "give at most that, or leave it out."
            )
        if not isinstance(space, Mesh):
            return self
        if self.kind == "tag":
            raise InputError(
                f"--tags: {name} is a mesh, in which nothing is known as a reflector; give the "
                "building as a plan or an .ifc file, or --posts or --panels."
            )
        return replace(self, reflective=False)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A candidate position of an obstacle.

    Attributes:
        kind: Kind of the obstacle.
        drawn: The same as files hold it.
        on_wall: Whether it touches a wall.
    """

    kind: Kind
    drawn: DrawnObstacle
    on_wall: bool

    @cached_property
    def obstacle(self) -> Obstacle:
        """The obstacle as a part of a building."""
        return self.drawn.obstacle

    @property
    def middle(self) -> tuple[float, float]:
        """Centre of the obstacle: x and y, metres, map frame."""
        x, y = np.mean(self.drawn.points, axis=0).tolist()
        return x, y

    @property
    def x(self) -> float:
        """Coordinate x of the centre, metres, map frame."""
        return self.middle[0]

    @property
    def y(self) -> float:
        """Coordinate y of the centre, metres, map frame."""
        return self.middle[1]

    @property
    def direction_deg(self) -> float | None:
        """Direction of a panel or a tag, whole tenths of degrees in [0, 180); None for a post."""
        return None if self.kind == "post" else round(math.degrees(self.angle), 1) % 180.0

    @property
    def angle(self) -> float:
        """Direction of a panel or a tag, radians in [0, pi); 0 for a post."""
        (x0, y0), (x1, y1) = self.drawn.points[0], self.drawn.points[-1]
        return math.atan2(y1 - y0, x1 - x0) % math.pi


def apart(first: Candidate, second: Candidate, passage: float) -> bool:
    """Return whether a passage remains between two obstacles."""
    return not shapely.dwithin(first.obstacle.outline, second.obstacle.outline, passage)
