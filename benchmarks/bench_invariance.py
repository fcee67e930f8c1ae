"""Change of ambiguity level and bad floor when a building is only turned, shifted or resampled."""

from __future__ import annotations

import math
import os

import numpy as np
import shapely
from harness import arguments, environment_of, option, report, table
from lasers import laser
from numpy.typing import NDArray

import ambinav as an

SHIFT = (0.037, 0.061)
DEGREES = (0, 6, 18, 30, 42)
INSIDE = ((3.9, 1.95, 4.1, 5.95), (6.4, 3.75, 10.9, 3.95), (8.9, 1.05, 9.3, 1.45))
ROOM = shapely.box(0, 0, 12.85, 7.85) - shapely.union_all([shapely.box(*box) for box in INSIDE])
"""A room of 92 m² of judged floor with two walls and a pillar."""
TURNS = range(0, 91, 6)
"""Degrees."""


def differences(
    first: an.AmbiguityMap,
    at: NDArray[np.float64],
    second: an.AmbiguityMap,
    points: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return absolute differences of `level` at the same physical points, two of shape (2, N)."""
    change = np.abs(
        np.asarray(first.sample("level", *at)) - np.asarray(second.sample("level", *points))
    )
    return change[np.isfinite(change)]


def row(name: str, change: NDArray[np.float64]) -> tuple[str, str, str, str]:
    """Return one line of the table."""
    median, high, highest = np.percentile(change, [50, 95, 99])
    return name, f"{median:.4f}", f"{high:.3f}", f"{highest:.3f}"


def bad_floor(env: an.Environment, preset: str, spacing: float) -> float:
    """Return the judged floor in the zones corridor and open, square metres."""
    scanner = an.RangeScanner.from_preset(preset)
    amap = an.build_map(env, scanner, spacing=spacing, store=False)
    shares = amap.zone_shares(mask=amap.judged.counted)
    return sum(share.area for share in shares if share.zone in ("corridor", "open"))


def bad_floor_tables() -> str:
    """Return tables of the bad floor of a turned room, and of a recorded map by spacing."""
    room = an.environment_from_shapes([ROOM], name="room")
    rows = []
    for degrees in TURNS:
        turned = room.transformed(math.radians(degrees), *SHIFT)
        areas = [bad_floor(turned, "turtlebot3-lds", spacing) for spacing in (0.1, 0.05)]
        rows.append((f"{degrees} degrees", *(f"{area:.1f}" for area in areas)))
    head = ("room of 92 m², turtlebot3-lds, turned by", "bad m², spacing 0.1 m", "0.05 m")
    text = table(head, rows)
    if os.environ.get("AMBINAV_DATA"):
        env = environment_of("ipa_lab_intel")
        areas = [bad_floor(env, "hokuyo-urg-04lx", spacing) for spacing in (0.2, 0.1, 0.05)]
        head = ("recorded map, scanner", "bad m², spacing 0.2 m", "0.1 m", "0.05 m")
        row = ("ipa_lab_intel, hokuyo-urg-04lx", *(f"{area:.1f}" for area in areas))
        text += "\n\n" + table(head, [row])
    return text


def main() -> None:
    """Compare maps of the demo building and print the table."""
    chosen = arguments(__doc__, points=option(10000, "points"), seed=option(0, "of the points"))
    env = environment_of("demo")
    scanner = laser()
    rng = np.random.default_rng(chosen.seed)
    xmin, ymin, xmax, ymax = env.bounds
    xy = rng.uniform((xmin, ymin), (xmax, ymax), (4 * chosen.points, 2))
    at = xy[np.asarray(env.is_free(*xy.T, 0.05))][: chosen.points].T
    plain = an.build_map(env, scanner, store=False)
    rows = []
    for degrees in DEGREES:
        angle = math.radians(degrees)
        c, s = math.cos(angle), math.sin(angle)
        moved = np.array([[c, -s], [s, c]]) @ at + np.array(SHIFT)[:, None]
        turned = an.build_map(env.transformed(angle, *SHIFT), scanner, store=False)
        name = f"turned by {degrees} degrees and shifted by (0.037, 0.061) m"
        rows.append(row(name, differences(plain, at, turned, moved)))
    for spacing in (0.05, 0.2):
        resampled = an.build_map(env, scanner, spacing=spacing, store=False)
        rows.append(row(f"spacing {spacing} m", differences(plain, at, resampled, at)))
    body = (
        f"configs/demo.geojson, 60 beams over 360 degrees, 4 m, spacing 0.1 m, radius 0.5 m; "
        f"differences of `level` (0 to 1) at {at.shape[1]} physical points.\n\n"
        + table(("against the plain map", "median", "95 %", "99 %"), rows)
        + "\n\n"
        + bad_floor_tables()
    )
    report("Invariance of the ambiguity level", ("numba", "numpy", "shapely"), body, chosen.out)


if __name__ == "__main__":
    main()
