"""Change of a map when only the scanner's mount changes; it should be small."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path

import numpy as np
from harness import ENVIRONMENTS, add_out, environment_path, report, table
from numpy.typing import NDArray

import ambinav as an
from ambinav.maps.zones import ZONES
from ambinav.sensing.presets import preset_names

# Metres from the robot's centre (planar scanners) or from where the preset has its sensors.
MOUNTS = {
    "0": (0.0, 0.0),
    "1 mm ahead": (0.001, 0.0),
    "32 mm behind": (-0.032, 0.0),
    "10 cm left": (0.0, 0.1),
    "20 cm ahead": (0.2, 0.0),
    "15 cm, 45 degrees": (0.106, 0.106),
}
PLACES = ("demo", "nav2_tb3_sandbox", "aws_small_house", "navrep_markclutter", "freiburg-079")
CLEAR = 0.3
"""Metres: `level` is compared at poses that are so far from the walls."""
MOST_SHARE, MOST_LEVEL = 5.0, 0.03
"""Required limits: points of any zone's share, and the median change of `level`."""


def mounted(scanner: an.RangeScanner, x: float, y: float) -> an.RangeScanner:
    """Return the preset shifted along x and y by metres, a planar one from the robot's centre."""
    mounts = scanner.mounts.copy()
    if len(np.unique(mounts[:, :2], axis=0)) == 1:
        mounts[:, :2] = 0.0
    mounts[:, 0] += x
    mounts[:, 1] += y
    return an.RangeScanner.from_mounts(
        scanner.sensors, mounts, scanner.sensor_of_beam, name=scanner.name
    )


def measure(
    names: list[str], presets: list[str], spacing: float
) -> dict[str, dict[str, list[float]]]:
    """Return the zones' shares and the median change of `level`, by map, preset and mount."""
    results: dict[str, dict[str, list[float]]] = {}
    for name in names:
        env = an.load_environment(environment_path(name))
        for preset in presets:
            scanner = an.RangeScanner.from_preset(preset)
            level: NDArray[np.float32] | None = None
            rows: dict[str, list[float]] = {}
            for mount, (x, y) in MOUNTS.items():
                amap = an.build_map(env, mounted(scanner, x, y), spacing=spacing, store=False)
                now = amap.floor("level").values
                if level is None:
                    level, clear = now, amap.dataset["clearance"].values >= CLEAR
                both = clear & np.isfinite(now) & np.isfinite(level)
                change = float(np.median(np.abs(now - level)[both])) if both.any() else math.nan
                shares = [100.0 * zone.share for zone in amap.zone_shares()]
                rows[mount] = [*shares, change, float(amap.has_theta)]
            results[f"{name} / {preset}"] = rows
            print(f"{name} / {preset}: done", flush=True)
    return results


def line(
    name: str, mount: str, now: list[float], first: list[float], old: list[float] | None
) -> tuple[str, ...]:
    """Return one row: shares before and after, and their changes."""
    shares = " / ".join(f"{share:.0f}" for share in now[:4])
    off = max(abs(a - b) for a, b in zip(now[:4], first[:4], strict=True))
    before = "" if old is None else " / ".join(f"{share:.0f}" for share in old[:4])
    return (
        name, mount, "yes" if now[5] else "no", shares, f"{off:.1f}", f"{now[4]:.4f}", before,
        "" if old is None else f"{old[4]:.4f}",
    )  # fmt: skip


def main() -> None:
    """Build the maps, print the table, and report whether the required limits hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--places", nargs="+", default=list(PLACES), choices=list(ENVIRONMENTS))
    parser.add_argument("--presets", nargs="+", default=list(preset_names()))
    parser.add_argument("--spacing", type=float, default=0.2, help="metres (default: %(default)s)")
    parser.add_argument("--json", type=Path, help="write the figures there too")
    parser.add_argument("--before", type=Path, help="figures of another commit, by --json there")
    add_out(parser)
    chosen = parser.parse_args()
    shares = measure(chosen.places, chosen.presets, chosen.spacing)
    if chosen.json is not None:
        chosen.json.write_text(json.dumps(shares, indent=1), encoding="utf-8")
    before = {} if chosen.before is None else json.loads(chosen.before.read_text("utf-8"))
    rows, share, level = [], 0.0, 0.0
    for name, mounts in shares.items():
        first = mounts["0"]
        for mount, now in mounts.items():
            rows.append(line(name, mount, now, first, before.get(name, {}).get(mount)))
            share = max(share, float(rows[-1][4]))
            level = max(level, 0.0 if math.isnan(now[4]) else now[4])
    header = (
        "map / preset", "mount", "headings", f"{' / '.join(ZONES)}, %", "points off", "level",
        "before, %", "level before",
    )  # fmt: skip
    kept = "holds" if share < MOST_SHARE and level < MOST_LEVEL else "DOES NOT HOLD"
    body = f"""Shares of the zones (mean over headings) on the possible poses, at a spacing of
{chosen.spacing:g} m; `level`: median change from the first mount at poses {CLEAR:g} m or more from
the walls. Planar scanners are moved from the robot's centre, the others from where the preset has
their sensors. A map whose scanner looks all around and sits off by up to 20 cm has no headings, and
is that of the scanner in the centre. "Before": commit 8cec7f4, where a
neighbour whose sensor stands inside a wall counted as perfectly indistinguishable.

Must hold: every share less than {MOST_SHARE:g} points off, `level` less than {MOST_LEVEL:g}. It
{kept}: at most {share:.1f} points and {level:.4f}.

{table(header, rows, words=3)}
"""
    report("Mounts", ("numpy", "numba", "shapely"), body, chosen.out)


if __name__ == "__main__":
    main()
