"""Lost robots in a long bare corridor with reflective tags, with and without an intensity channel.

The same drives three times, by the same seeds: without tags, with tags that the scanner's ranges
cannot see, and with a channel that tells them from the wall. The robot follows its estimate, so
the drives part as soon as the estimates do.

    python benchmarks/bench_intensity.py --out benchmarks/results/intensity.md
"""

from __future__ import annotations

import time

import numpy as np
import shapely
from harness import arguments, report, table
from localizers import ROBOT, WHAT, localizer_of
from numpy.typing import NDArray
from scipy.stats import binomtest

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.drive.drive import drive_route
from ambinav.drive.metrics import Metrics, metrics
from ambinav.drive.noise import OdometryNoise
from ambinav.geometry.environment import Environment
from ambinav.geometry.motion.steering import Steering
from ambinav.map_building.build import build_map
from ambinav.maps.zones import ZONES
from ambinav.routes.evaluate import evaluate_route
from ambinav.sensing import Intensity, RangeScanner
from ambinav.service.service import AmbiguityService

LIBRARIES = ("ambinav", "numba", "numpy", "scipy")
LENGTH, WIDTH, TAG = 60.0, 2.4, 0.5
TAGS = (15.0, 30.0, 45.0)
CHANNEL = Intensity(wall=0.3, reflector=1.0, std=0.15)
SCANNER, BEAMS = "hokuyo-ust-10lx", 181
RUNS = 30
ODOMETRY = {"even wheels": OdometryNoise(), "worn wheels": OdometryNoise(bias_distance=0.03)}
SEED = 23


def corridor(tags: tuple[float, ...]) -> Environment:
    """Return a corridor without doors, with flat tags on both walls in turn."""
    sides = [0.0, WIDTH] * len(tags)
    lines = [
        [(x - TAG / 2, y), (x + TAG / 2, y)] for x, y in zip(tags, sides[: len(tags)], strict=True)
    ]
    return environment_from_shapes([shapely.box(0, 0, LENGTH, WIDTH)], reflectors=lines)


def runs_of(
    env: Environment,
    scanner: RangeScanner,
    name: str,
    noise: OdometryNoise,
    route: NDArray[np.float64],
) -> Metrics:
    """Return figures of paired drives from one end of the corridor to the other."""
    amap = build_map(env, scanner, spacing=0.2, store=False)
    service = AmbiguityService(amap)
    straight = evaluate_route(service, route, Steering(), planner="straight")
    rng = np.random.default_rng(SEED)
    localizer = localizer_of(name, env, scanner, noise, RUNS)
    drives = drive_route(env, scanner, ROBOT, straight, localizer, rng, RUNS, noise=noise)
    return metrics(drives, amap)


def zones(env: Environment, scanner: RangeScanner) -> list[str]:
    """Return the share of the corridor's floor in each zone."""
    amap = build_map(env, scanner, spacing=0.2, store=False)
    return [f"{share.share:.0%}" for share in amap.zone_shares()]


def main() -> None:
    """Drive and report."""
    args = arguments(__doc__, localizers=["amcl", "product", "kalman"])
    plain = RangeScanner.from_preset(SCANNER).thinned(BEAMS)
    seeing = plain.with_intensity(CHANNEL)
    bare, tagged = corridor(()), corridor(TAGS)
    arms = {
        "no tags": (bare, plain),
        "tags, ranges alone": (tagged, plain),
        "tags, intensities": (tagged, seeing),
    }
    route = np.array([[2.0, WIDTH / 2, 0.0], [LENGTH - 2.0, WIDTH / 2, 0.0]])
    rows, started = [], time.perf_counter()
    for name in args.localizers:
        for odometry, noise in ODOMETRY.items():
            by_arm = {
                arm: runs_of(env, scanner, name, noise, route)
                for arm, (env, scanner) in arms.items()
            }
            for arm, figures in by_arm.items():
                rows.append(
                    (
                        name, odometry, arm, f"{figures.lost.sum()} of {RUNS}",
                        f"{figures.lost_share.mean():.0%}",
                        f"{np.median(figures.position_rmse):.2f}",
                        f"{np.median(figures.weak_rmse):.2f}",
                        f"{np.median(figures.strong_rmse):.2f}",
                        pairs(by_arm["tags, ranges alone"].lost, figures.lost)
                        if arm == "tags, intensities"
                        else "",
                    )
                )  # fmt: skip
    heads = (
        "localizer", "odometry", "building and scanner", "lost", "time lost", "RMSE (m)", "along",
        "across", "paired with ranges alone",
    )  # fmt: skip
    shares = [(arm, *zones(env, scanner)) for arm, (env, scanner) in arms.items()]
    body = f"""
A corridor of {LENGTH:g} x {WIDTH:g} m without doors, with {len(TAGS)} tags of {TAG:g} m flat on its
walls at {", ".join(f"{x:g}" for x in TAGS)} m; its ends are out of sight of the `{SCANNER}`
(10 m, {BEAMS} of its beams) for most of the way. The channel reads walls at {CHANNEL.wall:g},
reflectors at {CHANNEL.reflector:g}, with a deviation of {CHANNEL.std:g}:
{CHANNEL.distinguished:.1%} of the readings fall on their surface's side. It is
added to the preset, which has none.

{RUNS} drives from 2 m before one end to 2 m before the other, closed loop, the same seeds in each
row; a robot is lost whose error is above 0.5 m or 30 degrees for over a second. Odometry: 4.5
degrees and 6 cm in a metre (the default), and with worn wheels every distance is reported 3 % too
long besides, which no localizer is told. Errors are medians over the runs. Paired: how many runs
are lost with ranges alone and not with intensities, and the other way round; p by the exact sign
test.

{chr(10).join(f"- `{name}`: {WHAT[name]}." for name in args.localizers)}

{table(heads, rows, 3)}

Share of the floor by zone, in the ambiguity map of each:

{table(("building and scanner", *ZONES), shares)}

It took {time.perf_counter() - started:.0f} s. One corridor and one set of tags: how much a tag
helps depends on how many beams meet it, so on its width, the distance and the scanner.
"""
    report("Tags in a bare corridor, with and without intensities", LIBRARIES, body, args.out)


def pairs(before: NDArray[np.bool_], after: NDArray[np.bool_]) -> str:
    """Return the runs that only one of two localizers lost."""
    saved, spoilt = int((before & ~after).sum()), int((after & ~before).sum())
    p = binomtest(saved, saved + spoilt).pvalue if saved + spoilt else 1.0
    return f"{saved} saved, {spoilt} lost, p = {p:.2g}"


if __name__ == "__main__":
    main()
