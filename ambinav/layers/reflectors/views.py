"""Reflectors that a scanner recognises from each pose.

A reflector is recognised if a ray to its middle meets it in front of everything else, at a range
and an angle of incidence at which it reflects brightly enough, within the aperture, and if it
covers at least the angle between two beams, so that one meets it however the robot is turned.

A retroreflective sheet sends light back up to some angle of incidence: the default, 45 degrees, is
the largest entrance angle for which 49 CFR 571.108 (FMVSS 108, conspicuity systems) states how much
a sheet must reflect. A post shows its near side, whatever the direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from ambinav.casting.plane.raycast import cast_one
from ambinav.config import NonNegative, Positive, check_fields
from ambinav.geometry.environment import Environment
from ambinav.layers.reflectors.targets import Targets
from ambinav.runtime.array_types import Bools, Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows
from ambinav.sensing.scanner import RangeScanner

HIDDEN: Final = 1e-3
"""Metres: what is nearer than a reflector by less does not hide it."""
SECTORS: Final = 1440
"""Directions in which a scanner is asked for a beam, a quarter of a degree each."""
GAP: Final = 1.01
"""A direction lies between two beams if they are apart by at most this multiple of the usual."""


@dataclass(frozen=True)
class ReflectorRules:
    """Needs of a robot that navigates by reflectors.

    Attributes:
        needed: Reflectors that it must see at a time.
        max_range: Range up to which they are recognised, metres; None: the sensor's.
        max_incidence: Angle to a flat reflector's normal up to which it is recognised, degrees.
        tolerance: Distances between reflectors that differ by less are alike, metres.
        max_std: Largest standard deviation of the position, along its worst direction, metres.

    Raises:
        InputError: a value is out of its range.
    """

    needed: int = 3
    max_range: Positive | None = None
    max_incidence: Positive = 45.0
    tolerance: NonNegative = 0.1
    max_std: Positive = 0.05

    def __post_init__(self) -> None:
        """Check every value."""
        check_fields(self)
        if self.needed < 2:
            raise InputError(
                f"needed is {self.needed}; give 2 or more: one reflector fixes no position."
            )
        if not self.max_incidence <= 90.0:
            raise InputError(f"max_incidence is {self.max_incidence:g}; give at most 90 degrees.")


def why_no_reflectors(scanner: RangeScanner) -> str | None:
    """Return why a scanner recognises no reflectors, as a sentence; None: it does."""
    if len(scanner.intensity_beams):
        return None
    return (
        "it measures no intensities, which distinguish reflectors from walls; add `intensity:` to "
        "its file (docs/howto/my-scanner.md)."
    )


def sees_all_around(scanner: RangeScanner) -> bool:
    """Return whether it sees the same reflectors at every heading."""
    heads = _heads(scanner)
    return all(head.sector.all() and not (head.x or head.y) for head in heads)


def seen_reflectors(
    environment: Environment,
    scanner: RangeScanner,
    targets: Targets,
    poses: Floats,
    rules: ReflectorRules,
) -> Bools:
    """Return which reflectors are recognised from each pose.

    Args:
        environment: The building, with these reflectors or without: none hides itself.
        scanner: The scanner, all of its beams.
        targets: L reflectors.
        poses: x, y, theta, shape (N, 3).
        rules: Range and angle of incidence.

    Returns:
        bool, shape (N, L).

    Raises:
        InputError: the scanner measures no intensities.
    """
    reason = why_no_reflectors(scanner)
    if reason is not None:
        raise InputError(f"scanner {scanner.name!r} recognises no reflectors: {reason}")
    seen = np.zeros((len(poses), len(targets)), dtype=np.bool_)
    if not seen.size:
        return seen
    poses = np.ascontiguousarray(poses, dtype=np.float64)
    steepest = math.cos(math.radians(rules.max_incidence))
    for head in _heads(scanner):
        far = head.far if rules.max_range is None else min(head.far, rules.max_range)
        run_rows(
            _see, len(poses), poses, targets.middle, targets.edges, targets.first, head.x, head.y,
            head.sector, head.step, head.near, far, steepest, *environment.grid.arrays, seen,
            least=64,
        )  # fmt: skip
    return seen


@dataclass(frozen=True, eq=False)
class _Head:
    """Sensors at one place that read intensities.

    Attributes:
        x: Place, metres, robot frame, like `y`.
        y: See there.
        sector: Whether a beam looks in each of `SECTORS` directions, bool.
        step: Angle between two beams, radians.
        near: Least range, metres.
        far: Largest range, metres.
    """

    x: float
    y: float
    sector: Bools
    step: float
    near: float
    far: float


def beam_directions(yaw: Floats) -> Floats:
    """Return the distinct directions of beams, radians in [0, 2 pi), ascending.

    To a billionth of a radian: several beams may look in one direction.
    """
    turn = 2.0 * math.pi
    return np.unique(np.mod(np.round(np.mod(yaw, turn), 9), round(turn, 9)))


def _heads(scanner: RangeScanner) -> list[_Head]:
    heads = []
    for number, sensor in enumerate(scanner.sensors):
        if sensor.intensity is None:
            continue
        mounts = scanner.mounts[scanner.sensor_of_beam == number]
        near = max(sensor.min_range, sensor.intensity.min_range)
        for x, y in np.unique(mounts[:, :2], axis=0).tolist():
            yaw = beam_directions(mounts[(mounts[:, :2] == (x, y)).all(axis=1), 2])
            gaps = np.diff(np.append(yaw, yaw[0] + 2.0 * math.pi))
            step = float(np.median(gaps))
            # A sector is covered if it lies between two neighbouring beams, or at one.
            middle = (np.arange(SECTORS) + 0.5) * (2.0 * math.pi / SECTORS)
            after = np.searchsorted(yaw, middle) % len(yaw)
            off = np.mod(yaw[after] - middle, 2.0 * math.pi)
            back = gaps[after - 1] - off
            covered = (gaps[after - 1] <= GAP * step) | (np.minimum(off, back) <= 0.5 * step)
            heads.append(_Head(x, y, covered, step, near, sensor.max_range))
    return heads


@kernel
def _see(
    low, high, poses, middle, edges, first, head_x, head_y, sector, step, near, far, steepest, x0,
    y0, cell, rows, columns, start, item, line, seen,
):  # fmt: skip
    """Write True to seen (N, L) where a sensor recognises a reflector."""
    turn = 2.0 * math.pi
    for p in range(low, high):
        c, s = math.cos(poses[p, 2]), math.sin(poses[p, 2])
        px = poses[p, 0] + c * head_x - s * head_y
        py = poses[p, 1] + s * head_x + c * head_y
        for k in range(middle.shape[0]):
            dx, dy = middle[k, 0] - px, middle[k, 1] - py
            away = math.hypot(dx, dy)
            # A post's near side, or a strip's, is nearer than its middle.
            if seen[p, k] or not 0.0 < away <= far + 1.0:
                continue
            bearing = (math.atan2(dy, dx) - poses[p, 2]) % turn
            if not sector[min(int(bearing / turn * sector.size), sector.size - 1)]:
                continue
            distance, cosine, width = _front(px, py, dx / away, dy / away, edges, first, k)
            if not (near <= distance <= far and cosine >= steepest and width >= step):
                continue
            free, _ = cast_one(
                px, py, dx / away, dy / away, distance, x0, y0, cell, rows, columns, start, line
            )
            seen[p, k] = free >= distance - HIDDEN


@kernel
def _front(px, py, ux, uy, edges, first, k):
    """Return distance and cosine of incidence where a ray meets a reflector, and its width.

    Args:
        px: Origin of the ray, metres, like `py`.
        py: See there.
        ux: Direction, a unit vector, like `uy`.
        uy: See there.
        edges: See `Targets`, like `first`.
        first: See there.
        k: The reflector.

    Returns:
        Metres, inf for a miss; cosine; the angle that it covers, radians.
    """
    distance, cosine, left, right = math.inf, 0.0, 0.0, 0.0
    for e in range(first[k], first[k + 1]):
        ax, ay = edges[e, 0] - px, edges[e, 1] - py
        bx, by = edges[e, 2] - px, edges[e, 3] - py
        a, b = ux * ay - uy * ax, ux * by - uy * bx
        along_a, along_b = ux * ax + uy * ay, ux * bx + uy * by
        for across, along in ((a, along_a), (b, along_b)):
            angle = math.atan2(across, along)
            left, right = max(left, angle), min(right, angle)
        if a * b > 0.0 or a == b:
            continue
        t = along_a + a / (a - b) * (along_b - along_a)
        if 0.0 <= t < distance:
            length = math.hypot(bx - ax, by - ay)
            distance, cosine = t, abs(b - a) / length
    return distance, cosine, left - right
