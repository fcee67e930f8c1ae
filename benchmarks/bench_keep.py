"""Cost of the store for small maps: is storing a map ever slower than computing it?

*compute*: `build_map(store=False)`. *keep*: what the store takes to keep that map beside so many
others in its folder. *open*: `build_map` where it is kept. Buildings of the environments'
procedural suite, the demo building, and a bare room, for a laser of 60 beams and 5 m that looks all
around; what is done once in a process (kernels loaded, the digest of the sources) is done before.
The last table is for what comes with few small maps only: looking through the folder, for room and
for what killed processes left.

    python benchmarks/bench_keep.py --out benchmarks/results/store-small.md
"""

from __future__ import annotations

import argparse
import math
import tempfile
from functools import partial
from pathlib import Path

import shapely
from harness import add_out, interleave, report, spread, table

import ambinav as an
from ambinav.demo import DEMO_BUILDING
from ambinav.store import entry
from ambinav.store.map_store import MapStore
from ambinav_envs.buildings.suites import suite

OTHERS = (0, 1000, 10_000)
"""Entries in the folder, each as small as the smallest."""
REPEATS = 9
BUILDINGS = 3
TIMED = ("compute", "keep", "open")
HEAD = ("map", "spacing, m", "cells", "kB", "others", "compute, ms", "keep, ms", "open, ms")


def cases() -> list[tuple[an.Environment, float]]:
    """Return buildings and the spacing of their maps, the smallest first."""
    bare = an.environment_from_shapes([shapely.box(0, 0, 3, 2)], name="room of 3 x 2 m")
    procedural = suite("procedural")
    drawn = [procedural.building(k) for k in range(1, BUILDINGS + 1)]
    demo = an.load_environment(DEMO_BUILDING)
    return [
        (bare, 0.25),
        (bare, 0.1),
        *((environment, 0.5) for environment in drawn),
        (demo, 0.5),
        (demo, 0.2),
    ]


def row(
    env: an.Environment, scanner: an.RangeScanner, spacing: float, folder: Path, others: int
) -> tuple[str, ...]:
    """Measure one map in a store with so many others."""
    store = MapStore(folder)
    before = set(folder.iterdir())

    def build(place: bool | MapStore) -> an.AmbiguityMap:
        return an.build_map(env, scanner, spacing, radius=max(0.5, spacing), store=place)

    amap = build(store)
    (file,) = set(folder.iterdir()) - before
    size = file.stat().st_size / 1e3
    contestants = {
        "compute": lambda: build(False),
        "removed": file.unlink,
        "keep": lambda: store.opened_or_built(file.stem, lambda alive: amap),
        "open": lambda: build(store),
    }
    timings = interleave(contestants, REPEATS)
    file.unlink()
    times = [spread([1e3 * t for t in timings[name].seconds], 1) for name in TIMED]
    cells = math.prod(amap.possible.shape)
    return (env.name, f"{spacing:g}", f"{cells:,}", f"{size:.0f}", f"{others:,}", *times)


def main() -> None:
    """Measure all."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_out(parser)
    args = parser.parse_args()
    sensor = an.RangeSensor(max_range=5.0, std=0.03, resolution=0.001)
    scanner = an.RangeScanner.planar(sensor, 60, math.tau, name="60 beams")
    made = cases()
    smallest, coarse = made[0]
    amap = an.build_map(smallest, scanner, coarse, store=False)
    content = b"".join(entry.pack(amap.dataset, "0" * 32))
    rows, looks = [], []
    for others in OTHERS:
        with tempfile.TemporaryDirectory() as name:
            for k in range(others):
                (Path(name) / f"{k:032x}.map").write_bytes(content)
            rows += [row(env, scanner, spacing, Path(name), others) for env, spacing in made]
            store = MapStore(Path(name))
            timing = interleave({"look": partial(store.make_room, store.limit)}, REPEATS)["look"]
        looks.append((f"{others:,}", spread([1e3 * seconds for seconds in timing.seconds], 1)))
    summary, _, _ = str(__doc__).partition("\n\n    python")
    text = f"{summary}\n\n{table(HEAD, rows)}\n\n{table(('others', 'look, ms'), looks)}"
    report("The store on small maps", ("ambinav", "numba", "numpy", "numcodecs"), text, args.out)


if __name__ == "__main__":
    main()
