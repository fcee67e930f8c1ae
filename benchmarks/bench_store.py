"""Time to open a map from the store compared with building it, for every map.

A laser of 60 beams and 5 m (4 spacings where that is more) on a lattice of at most `MOST_POSES`
points of free floor; the last rows are one large floor at the spacing of 0.1 m, for a laser that
looks all around and for one that does not. *open*: all that `build_map` does where the map is kept:
the digest of building, scanner and parameters (that of the sources is made once in a process),
reading, checksum, unpacking; the file was written just before and lies in memory. *times*: build
over open. *zarr*: to open the same map as `AmbiguityMap.save` writes it.
"""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np
from harness import arguments, environment_path, option, recorded_maps, report, spread, table, timed
from lasers import laser

from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import Environment
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputWarning
from ambinav.sensing.scanner import RangeScanner
from ambinav.store.map_store import MapStore

LARGE = "willow_full_005"
MOST_POSES = 30_000
FINEST = 0.2
REPEATS = 5
LEVELS = (0, 1, 6)
LIBRARIES = ("ambinav", "numba", "numpy", "numcodecs", "xarray", "zarr")
HEAD = (
    "map", "scanner", "spacing, m", "cells", "build, s", "open, ms", "times",
    "zarr, ms", "raw, MB", "kept, MB",
)  # fmt: skip


def row(
    env: Environment, scanner: RangeScanner, spacing: float, folder: Path
) -> tuple[tuple[str, ...], float, AmbiguityMap]:
    """Measure one map; return its row, and the factor by which opening is faster."""
    store = MapStore(folder)
    radius = max(0.5, 1.5 * spacing)

    def take(place: MapStore) -> AmbiguityMap:
        return build_map(env, scanner, spacing, radius, store=place)

    building, amap = timed(lambda: take(store))
    (file,) = folder.glob("*.map")
    opens = []
    for _ in range(REPEATS):
        seconds, reopened = timed(lambda: take(store))
        opens.append(1e3 * seconds)
    if not reopened.dataset.identical(amap.dataset):
        raise SystemExit(f"{env.name}: the map that was opened is another")
    amap.save(folder / "map.zarr")
    zarr = [1e3 * timed(lambda: AmbiguityMap.open(folder / "map.zarr"))[0] for _ in range(REPEATS)]
    ratio = 1e3 * building / float(np.median(opens))
    variables = amap.dataset.variables.values()
    cells = math.prod(amap.possible.shape)
    cells_of_row = (
        env.name, scanner.name, f"{spacing:.2g}", f"{cells:,}", f"{building:.2f}",
        spread(opens, 1), f"{ratio:,.0f}", spread(zarr, 1),
        f"{sum(variable.values.nbytes for variable in variables) / 1e6:.2f}",
        f"{file.stat().st_size / 1e6:.2f}",
    )  # fmt: skip
    return cells_of_row, ratio, amap


def packing(amap: AmbiguityMap) -> str:
    """Return the time and size of each compression level."""
    from numcodecs.zstd import compress, decompress

    rows = []
    arrays = [variable.values for variable in amap.dataset.variables.values()]
    flat = [np.ascontiguousarray(array).reshape(-1).view(np.uint8) for array in arrays]
    for level in LEVELS:
        packs, unpacks = [], []
        for _ in range(REPEATS):
            seconds, packed = timed(lambda: [compress(data, level) for data in flat])  # noqa: B023
            packs.append(1e3 * seconds)
            unpacks.append(1e3 * timed(lambda: [decompress(data) for data in packed])[0])  # noqa: B023
        size = sum(map(len, packed)) / 1e6
        rows.append((level, spread(packs, 0), spread(unpacks, 0), f"{size:.1f}"))
    return table(("level", "pack, ms", "unpack, ms", "MB"), rows)


def main() -> None:
    """Measure all maps."""
    args = arguments(
        __doc__, only=option(None, "of maps, without suffix", metavar="NAME", action="append")
    )
    paths = [environment_path("demo"), *recorded_maps()]
    if args.only:
        paths = [path for path in paths if path.stem in args.only]
    rows, ratios = [], []
    warnings.simplefilter("ignore", InputWarning)

    def measure(path: Path, scanner: RangeScanner | None, spacing: float | None) -> AmbiguityMap:
        env = load_environment(path)
        step = spacing or max(math.sqrt(env.free.area / MOST_POSES), FINEST)
        with tempfile.TemporaryDirectory() as folder:
            cells, ratio, amap = row(
                env, scanner or laser(max(5.0, 4.0 * step), name="60 beams"), step, Path(folder)
            )
        rows.append(cells)
        ratios.append(ratio)
        print(cells, file=sys.stderr, flush=True)
        return amap

    measure(paths[0], None, 0.5)  # compiles
    rows.clear()
    ratios.clear()
    for path in paths:
        measure(path, None, None)
    for name in ("rplidar-a1", "hokuyo-urg-04lx"):
        amap = measure(environment_path(LARGE), RangeScanner.load(name), 0.1)
    sources = _sources()
    report(
        "Maps from the store",
        LIBRARIES,
        f"{__doc__}\nOpening is faster than building on {sum(factor > 1 for factor in ratios)} of "
        f"{len(ratios)}, by {min(ratios):,.0f} times at least. The digest of the sources takes "
        f"{spread(sources, 0)} ms, once in a process.\n\n{table(HEAD, rows, 2)}\n\n"
        f"The last one, packed by zstd:\n\n{packing(amap)}",
        args.out,
    )


def _sources() -> list[float]:
    """Return milliseconds of hashing all sources, each in a separate process."""
    code = (
        "import time, ambinav.runtime.provenance as p\n"
        "t = time.perf_counter()\np.Provenance.here()\n"
        "print(1e3 * (time.perf_counter() - t))"
    )
    runs = (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        for _ in range(REPEATS)
    )
    return [float(run.stdout) for run in runs]


if __name__ == "__main__":
    main()
