"""One environment and scanner of `bench_truth.py`: the layers at the poses driven about.

Places on standard input, one line of JSON each; the same with the layers' values on standard
output.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numba
import numpy as np
from harness import environment_of
from scipy.spatial import cKDTree
from truth_case import scanner_of

from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.layers.aliasing.layer import aliased_poses
from ambinav.layers.build import with_layers
from ambinav.layers.context import LayerContext
from ambinav.layers.position import position_radius
from ambinav.layers.registry import chosen_layers
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap

# Layers of each pose by itself.
POINTWISE = ("fisher", "localizability", "gfm", "clearance", "perturbation")
# Of each pose and all the others.
ALIASING = "aliasing"
COARSE = 0.25
"""Spacing of the lattice on which the others are, metres: that of an audit."""
RADIUS = 0.5
"""Radius of a pose's neighbourhood, metres."""

Place = dict[str, float]


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
    environment = environment_of(args.environment)
    amap = build_map(environment, scanner, radius=RADIUS, store=False)
    radius = position_radius(amap).astype(np.float32)
    amap = AmbiguityMap(amap.dataset.assign(position_radius=(("y", "x"), radius)))
    names = [layer.name for layer in chosen_layers(args.layers, scanner)]
    pointwise = [name for name in names if name in POINTWISE]
    parts = [read(with_layers(about(amap, places, 1), pointwise), places)]
    # The others compare a pose with its neighbours.
    reach = math.ceil(RADIUS / amap.spacing) + 2
    relative = [name for name in names if name not in (*POINTWISE, ALIASING)]
    parts.append(read(with_layers(about(amap, places, reach), relative), places))
    if ALIASING in names:
        parts.append(aliased(amap, environment, places))
    for values in zip(places, *parts, strict=True):
        print(json.dumps({key: value for part in values for key, value in part.items()}))


def about(amap: AmbiguityMap, places: Sequence[Place], reach: int) -> AmbiguityMap:
    """Return the map restricted to the cells up to `reach` around the poses."""
    free = amap.dataset["free"]
    near = np.zeros(free.shape, dtype=np.bool_)
    rows = np.searchsorted(amap.dataset["y"].values, [place["y"] for place in places])
    columns = np.searchsorted(amap.dataset["x"].values, [place["x"] for place in places])
    for dy, dx in product(range(-reach, reach + 1), repeat=2):
        near[
            np.clip(rows + dy, 0, near.shape[0] - 1), np.clip(columns + dx, 0, near.shape[1] - 1)
        ] = True
    return AmbiguityMap(amap.dataset.assign(free=free & near))


def aliased(amap: AmbiguityMap, environment: Environment, places: Sequence[Place]) -> list[Place]:
    """Return aliasing at the nearest poses of a coarser lattice over the whole building."""
    context = replace(LayerContext.of(amap, environment), lattice=Lattice.over(environment, COARSE))
    points = np.array([[place["x"], place["y"]] for place in places])
    _, nearest = cKDTree(np.column_stack(context.points)).query(points)
    sought = np.zeros(len(context.points[0]), dtype=np.bool_)
    sought[nearest] = True
    result = aliased_poses(context, sought=sought)
    share, area = result.share[nearest].mean(axis=1), result.area[nearest].mean(axis=1)
    return [
        {ALIASING: float(a), "aliasing_area": float(b)} for a, b in zip(share, area, strict=True)
    ]


def read(amap: AmbiguityMap, places: Sequence[Place]) -> list[Place]:
    """Return all layers at the poses; with headings, their means."""
    columns = {}
    x = np.array([place["x"] for place in places])
    y = np.array([place["y"] for place in places])
    for name in amap.layers:
        mean = f"{name}_mean"
        if name.endswith(("_mean", "_best", "_worst", "heading")):
            continue
        if mean in amap.layers or "theta" not in amap.dataset[name].dims:
            columns[name] = np.asarray(amap.sample(mean if mean in amap.layers else name, x, y))
    return [
        {name: float(values[k]) for name, values in columns.items()} for k in range(len(places))
    ]


if __name__ == "__main__":
    main()
