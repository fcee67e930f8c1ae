"""One environment and scanner of `bench_truth.py`: what the layers say of the places driven about.

Places on standard input, one line of JSON each; the same with the layers' values on standard
output.
"""

from __future__ import annotations

import argparse
import json
import sys

import numba
from harness import environment_path
from truth_case import scanner_of

from ambinav.ambiguity.build import build_map
from ambinav.ambiguity.layers.build import with_layers
from ambinav.geometry.environment import load_environment
from ambinav.maps.ambiguity_map import AmbiguityMap


def main() -> None:
    """Compute the layers and look them up."""
    parser = argparse.ArgumentParser()
    parser.add_argument("environment")
    parser.add_argument("scanner")
    parser.add_argument("--layers", nargs="+", default=["all"])
    args = parser.parse_args()
    numba.set_num_threads(1)
    places = [json.loads(line) for line in sys.stdin]
    scanner = scanner_of(args.scanner)
    amap = build_map(load_environment(environment_path(args.environment)), scanner)
    amap = with_layers(amap, args.layers)
    for place in places:
        print(json.dumps(place | read(amap, place["x"], place["y"])), flush=True)


def read(amap: AmbiguityMap, x: float, y: float) -> dict[str, float]:
    """All layers at a place; with headings, their means."""
    plain = [name for name in amap.layers if not name.endswith(("_mean", "_best", "_worst"))]
    return {name: float(amap.sample(name, x, y)) for name in plain if "heading" not in name}


if __name__ == "__main__":
    main()
