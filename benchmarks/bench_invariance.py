"""Change of the ambiguity level when the building is only rotated, shifted or resampled."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
from harness import add_out, environment_path, report, table
from numpy.typing import NDArray

import ambinav as an

SHIFT = (0.037, 0.061)
DEGREES = (0, 6, 18, 30, 42)


def differences(
    first: an.AmbiguityMap,
    at: NDArray[np.float64],
    other: an.AmbiguityMap,
    there: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return absolute differences of `level` at the same physical points, two of shape (2, N)."""
    change = np.abs(
        np.asarray(first.sample("level", *at)) - np.asarray(other.sample("level", *there))
    )
    return change[np.isfinite(change)]


def row(name: str, change: NDArray[np.float64]) -> tuple[str, str, str, str]:
    """Return one line of the table."""
    median, high, most = np.percentile(change, [50, 95, 99])
    return name, f"{median:.4f}", f"{high:.3f}", f"{most:.3f}"


def main() -> None:
    """Compare maps of the demo building and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=10_000, help="points (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the points")
    add_out(parser)
    chosen = parser.parse_args()
    env = an.load_environment(environment_path("demo"))
    scanner = an.RangeScanner.planar(
        sensor=an.RangeSensor(max_range=4.0, std=0.03, resolution=0.001),
        beams=60,
        aperture=2 * math.pi,
    )
    rng = np.random.default_rng(chosen.seed)
    xmin, ymin, xmax, ymax = env.bounds
    xy = rng.uniform((xmin, ymin), (xmax, ymax), (4 * chosen.points, 2))
    at = xy[np.asarray(env.is_free(*xy.T, 0.05))][: chosen.points].T
    plain = an.build_map(env, scanner, store=False)
    rows = []
    for degrees in DEGREES:
        angle = math.radians(degrees)
        c, s = math.cos(angle), math.sin(angle)
        there = np.array([[c, -s], [s, c]]) @ at + np.array(SHIFT)[:, None]
        turned = an.build_map(env.transformed(angle, *SHIFT), scanner, store=False)
        name = f"turned by {degrees} degrees and shifted by (0.037, 0.061) m"
        rows.append(row(name, differences(plain, at, turned, there)))
    for spacing in (0.05, 0.2):
        resampled = an.build_map(env, scanner, spacing=spacing, store=False)
        rows.append(row(f"spacing {spacing} m", differences(plain, at, resampled, at)))
    body = (
        f"configs/demo.geojson, 60 beams over 360 degrees, 4 m, spacing 0.1 m, radius 0.5 m; "
        f"differences of `level` (0 to 1) at {at.shape[1]} physical points.\n\n"
        + table(("against the plain map", "median", "95 %", "99 %"), rows)
    )
    out: Path | None = chosen.out
    report("Invariance of the ambiguity level", ("numba", "numpy", "shapely"), body, out)


if __name__ == "__main__":
    main()
