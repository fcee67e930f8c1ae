"""Layers of other measures: seconds of each on one map, and of all of them together.

Spacing 0.1 m; if nothing else is said the scanner has 60 beams over 360 degrees, 4 m, deviation
0.03 m, resolution 0.001 m.
"""

from __future__ import annotations

import argparse
import time

import numba
import numpy as np
from harness import ENVIRONMENTS, add_out, environment_path, report, spread, table
from map_case import RADIUS, SPACING, plain_scanner, small_room

from ambinav.buildings.load import load_environment
from ambinav.layers.build import with_layers
from ambinav.layers.context import LayerContext
from ambinav.layers.registry import ALL, chosen_layers
from ambinav.map_building.build import build_map
from ambinav.sensing.scanner import RangeScanner

LIBRARIES = ("ambinav", "numba", "llvmlite", "numpy", "scipy", "shapely", "xarray")
MAIN = "willow_full_005"
# Required: all layers of that map together, on two cores.
WANTED = 20.0


def main() -> None:
    """Measure as the command line says, and report."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("environment", nargs="?", default=MAIN, choices=sorted(ENVIRONMENTS))
    parser.add_argument("--scanner", default="plain", help="plain, or the name of a preset")
    parser.add_argument("--layers", default=ALL, help="names, or all (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=3, help="default: %(default)s")
    parser.add_argument("--threads", type=int, default=2, help="default: %(default)s")
    add_out(parser)
    args = parser.parse_args()
    if args.threads > numba.config.NUMBA_NUM_THREADS:
        parser.error(
            f"--threads is {args.threads} and numba has {numba.config.NUMBA_NUM_THREADS}; "
            "set NUMBA_NUM_THREADS."
        )
    numba.set_num_threads(args.threads)
    env = load_environment(environment_path(args.environment))
    plain = args.scanner == "plain"
    scanner = plain_scanner() if plain else RangeScanner.from_preset(args.scanner)
    chosen = chosen_layers(args.layers.split(","), scanner)
    names = [layer.name for layer in chosen]
    # The kernels are loaded (and compiled, if they never were) before any clock starts.
    build_map(small_room(), scanner, SPACING, RADIUS, layers=names, store=False)
    amap = build_map(env, scanner, SPACING, RADIUS, store=False)
    seconds: dict[str, list[float]] = {name: [] for name in names}
    together = []
    for _ in range(args.repeats):
        for layer in chosen:
            # Layers share ray casts; here each starts without any.
            context = LayerContext.of(amap, env)
            start = time.perf_counter()
            layer.compute(context)
            seconds[layer.name].append(time.perf_counter() - start)
        start = time.perf_counter()
        with_layers(amap, names, environment=env)
        together.append(time.perf_counter() - start)
    poses = int(amap.dataset["free"].sum()) * amap.dataset.sizes.get("theta", 1)
    rows = [(name, spread(s), f"{np.median(s) / poses * 1e6:.2f}") for name, s in seconds.items()]
    rows.append(("all together", spread(together), f"{np.median(together) / poses * 1e6:.2f}"))
    body = "\n\n".join(
        [
            f"{args.environment}, {scanner.name}: {poses} poses, "
            f"{LayerContext.of(amap, env).scanner.beams} beams; {args.threads} threads, "
            f"{args.repeats} repeats after a warm-up. The map itself is built before.",
            table(("layer", "s: median (extremes)", "us a pose"), rows),
            f"Asked for: all together in {WANTED:.0f} s on two cores, for {MAIN}.",
        ]
    )
    report("Layers of other measures", LIBRARIES, body, args.out)


if __name__ == "__main__":
    main()
