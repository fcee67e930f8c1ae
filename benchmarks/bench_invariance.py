"""Change of the ambiguity level when the building is only rotated, shifted or resampled."""

from __future__ import annotations

import math

import numpy as np
from harness import arguments, environment_of, option, report, table
from lasers import laser
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
    report("Invariance of the ambiguity level", ("numba", "numpy", "shapely"), body, chosen.out)


if __name__ == "__main__":
    main()
