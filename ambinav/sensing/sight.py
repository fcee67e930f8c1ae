"""One scan from one pose: beams that return and the number of surfaces they hit."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ambinav.casting.scans import scan_rays
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER
from ambinav.runtime.array_types import Bools, Floats
from ambinav.sensing.scanner import RangeScanner

SAME_DIRECTION = math.radians(10.0)
SAME_DEPTH = 0.25  # metres between parallel surfaces that count as two
_STANDING = 0.5  # horizontal part of the normal of a surface that stands, rather than lies


@dataclass(frozen=True, eq=False)
class Sight:
    """One scan without noise, in the map frame. B beams.

    Attributes:
        x: Metres; where the robot is.
        y: Metres.
        theta: Heading, radians.
        origin: (B, 2) metres; where each beam starts.
        axis: (B,) radians; where each beam points.
        aperture: (B,) radians; full angle of each beam's cone, 0 for a laser.
        max_range: (B,) metres.
        distance: (B,) metres from the sensor; inf where nothing returns an echo.
        hit: (B, 2) metres; the point that returned the echo as seen from above, NaN where none did.
        along: (B,) radians; direction of the surface as seen from above, NaN where there is none or
            it lies flat.
        frontier: (B,) True where the beam ends at unknown space, not at a wall.
        surfaces: How many surfaces the echoes come from; pieces of one plane count once, and in
            space floors and ceilings do not.
        directions: Along how many directions these surfaces run.
    """

    x: float
    y: float
    theta: float
    origin: Floats
    axis: Floats
    aperture: Floats
    max_range: Floats
    distance: Floats
    hit: Floats
    along: Floats
    frontier: Bools
    surfaces: int
    directions: int

    @property
    def beams(self) -> int:
        """Number of beams B."""
        return len(self.axis)

    @property
    def silent(self) -> int:
        """Number of beams without echo."""
        return int(np.isinf(self.distance).sum())

    @property
    def sentence(self) -> str:
        """Description of the scan in plain words."""
        if self.silent == self.beams:
            return f"None of the {self.beams} beams returns an echo."
        parts = [f"{self.silent} of {self.beams} beams without echo"]
        if self.silent == 0:
            parts = [f"all {self.beams} beams return an echo"]
        unknown = int(self.frontier.sum())
        if unknown:
            parts.append(f"{unknown} end at unknown space")
        text = ", ".join(parts)
        if self.surfaces == 0:
            return f"{text[0].upper()}{text[1:]}; no beam meets a wall."
        count = "one surface" if self.surfaces == 1 else f"{self.surfaces} surfaces"
        how = ""
        if self.directions == 1:
            how = (
                ": the position along it is not observable"
                if self.surfaces == 1
                else ", all parallel: the position along them is not observable"
            )
        return f"{text[0].upper()}{text[1:]}; the echoes come from {count}{how}."


def look(
    environment: Environment, scanner: RangeScanner, x: float, y: float, theta: float
) -> Sight:
    """Scan once, without noise, and classify the ends of the beams.

    Args:
        environment: Where the robot is.
        scanner: Scanner of the robot.
        x: Metres, map frame.
        y: Metres.
        theta: Heading, radians.

    Raises:
        InputError: building and scanner do not go together (`casting.scans.check_rays`).
    """
    rays = scanner.rays(environment.space is not None)
    distance, segment, incidence = scan_rays(
        environment,
        np.array([x]),
        np.array([y]),
        np.array([theta]),
        rays.origin,
        rays.angle,
        scanner.max_range,
        height=rays.height,
        elevation=rays.elevation,
    )
    echo = rays.echoes(distance, incidence)[0].astype(np.float64)
    nearest = np.array(
        [a + int(np.argmin(echo[a:b])) for a, b in zip(rays.start, rays.start[1:], strict=False)]
    )
    ranges, ended = echo[nearest], segment[0, nearest]
    returned = np.isfinite(ranges)

    c, s = math.cos(theta), math.sin(theta)
    turn = np.array([[c, s], [-s, c]])
    origin = np.array([x, y]) + scanner.mounts[:, :2] @ turn
    angle = theta + rays.angle[nearest]
    reach = np.where(returned, ranges, np.nan)
    # As seen from above.
    flat = np.cos(rays.elevation[nearest])
    hit = origin + (reach * flat)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])

    at_wall = returned & (ended >= 0) & (environment.surface_kind != FRONTIER)[ended]
    along = np.full(len(hit), np.nan)
    if environment.space is None:
        lines = environment.segments.xy[np.unique(ended[at_wall])]
        step = np.diff(environment.segments.xy.reshape(-1, 2, 2)[ended[at_wall]], axis=1)[:, 0]
        along[at_wall] = np.arctan2(step[:, 1], step[:, 0])
    else:
        normal = environment.surface_normals[ended[at_wall]]
        lines = _upright_segments(normal, hit[at_wall])
        stands = np.hypot(normal[:, 0], normal[:, 1]) > _STANDING
        along[at_wall] = np.where(stands, np.arctan2(normal[:, 0], -normal[:, 1]), np.nan)
    surfaces, directions = count_surfaces(lines)
    sensors = [scanner.sensors[i] for i in scanner.sensor_of_beam]
    return Sight(
        x=x,
        y=y,
        theta=theta,
        origin=origin,
        axis=theta + scanner.mounts[:, 2],
        aperture=np.array([sensor.aperture for sensor in sensors]),
        max_range=np.array([sensor.max_range for sensor in sensors]),
        distance=ranges,
        hit=hit,
        along=along,
        frontier=returned & ~at_wall,
        surfaces=surfaces,
        directions=directions,
    )


def _upright_segments(normal: Floats, hit: Floats) -> Floats:
    """Return short segments (N, 4) for hits on upright surfaces.

    Floor and ceiling tell nothing about the position.

    Args:
        normal: Normals of the surfaces, shape (N, 3).
        hit: Hit points, shape (N, 2), metres.
    """
    upright = np.hypot(normal[:, 0], normal[:, 1])
    stands = upright > _STANDING
    along = np.column_stack([-normal[:, 1], normal[:, 0]])[stands] / upright[stands, None]
    return np.hstack([hit[stands] - along / 2, hit[stands] + along / 2])


def count_surfaces(segments: Floats) -> tuple[int, int]:
    """Count the planes that contain the segments, and the directions of these planes.

    Args:
        segments: (N, 4) metres: ax, ay, bx, by.

    Returns:
        Number of planes and of directions. Two segments are of one plane if they differ by less
        than 10 degrees and, from the longer one's line, by less than 0.25 m.
    """
    step = segments[:, 2:] - segments[:, :2]
    length = np.hypot(step[:, 0], step[:, 1])
    planes: list[tuple[float, float, float, float]] = []  # a point and a direction
    for i in np.argsort(-length, kind="stable").tolist():
        ux, uy = (step[i] / length[i]).tolist()
        mx, my = ((segments[i, :2] + segments[i, 2:]) / 2).tolist()
        if not any(
            _parallel(ux, uy, vx, vy) and abs((mx - px) * vy - (my - py) * vx) < SAME_DEPTH
            for px, py, vx, vy in planes
        ):
            planes.append((mx, my, ux, uy))
    directions: list[tuple[float, float]] = []
    for _, _, ux, uy in planes:
        if not any(_parallel(ux, uy, vx, vy) for vx, vy in directions):
            directions.append((ux, uy))
    return len(planes), len(directions)


def _parallel(ux: float, uy: float, vx: float, vy: float) -> bool:
    return abs(ux * vy - uy * vx) < math.sin(SAME_DIRECTION)
