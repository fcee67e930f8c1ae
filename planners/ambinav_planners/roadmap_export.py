"""The PRM* roadmap as a route graph with costs, for Nav2's Route Server."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Final

import numpy as np

from ambinav.export.options import MapExport
from ambinav.export.registry import Exporter
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.service.service import AmbiguityService
from ambinav_planners.problem import Problem, make_checker
from ambinav_planners.registry import has_ompl
from ambinav_planners.route_graph import RouteGraph
from ambinav_planners.search.graph import MotionGraph

MILESTONES: Final = 500
RADIUS: Final = 0.2
WEIGHT: Final = 5.0
# Milestones asked for at once when a free pose is sought to begin with.
ATTEMPTS: Final = 1000


def roadmap(service: AmbiguityService, radius: float, milestones: int, seed: int) -> MotionGraph:
    """Return the largest connected part of a PRM* roadmap of a round robot that drives straight.

    Args:
        service: The map, and what a metre costs.
        radius: Radius of the robot, metres.
        milestones: Number of milestones of the roadmap.
        seed: Seed of its milestones.

    Raises:
        InputError: OMPL is missing, or the robot fits nowhere.
    """
    if not has_ompl():
        raise InputError('nav2-route-graph needs OMPL; run: pip install "ambinav[planners]".')
    from ambinav_planners.roadmap import Roadmap

    checker = make_checker(service, Footprint.disc(radius), Steering("r2"))
    # A roadmap is asked for from a start to a goal; here any free pose serves as both.
    rng = np.random.default_rng(seed)
    amap = service.map
    rows, columns = np.nonzero(np.asarray(amap.dataset["free"].values, dtype=np.bool_))
    pick = rng.permutation(len(rows))[:ATTEMPTS]
    x, y = amap.dataset["x"].values[columns[pick]], amap.dataset["y"].values[rows[pick]]
    poses = np.column_stack([x, y, np.zeros(len(x))])
    free = poses[checker.poses_free(poses)]
    if not len(free):
        raise InputError(
            f"--robot-radius: {radius:g} m: the robot fits at none of {len(poses)} poses of "
            f"{amap.source}; give less."
        )
    pose = (float(free[0, 0]), float(free[0, 1]), 0.0)
    grown = Roadmap.over(Problem(service, checker, pose, pose), seed)
    grown.grow(milestones)
    graph = grown.graph()
    # The last two nodes are start and goal, which are no milestones.
    graph = graph.part(np.arange(len(graph.poses)) < len(graph.poses) - 2)
    if not len(graph.target):
        raise InputError(
            f"--milestones: {milestones} of them have no free motion between them; give more."
        )
    labels = graph.components()
    joined = labels == np.bincount(labels).argmax()
    if not joined.all():
        warnings.warn(
            f"{int((~joined).sum())} of {len(joined)} milestones are not connected to the others "
            "and are left out of the graph; with more milestones more of them are.",
            InputWarning,
            stacklevel=2,
        )
    return graph.part(joined)


def write(export: MapExport, path: Path) -> tuple[Path, ...]:
    """Write the roadmap."""
    options = export.options
    weight = WEIGHT if options.weight is None else options.weight
    graph = roadmap(
        AmbiguityService(export.amap, options.layer, weight),
        RADIUS if options.robot_radius is None else options.robot_radius,
        MILESTONES if options.milestones is None else options.milestones,
        0 if options.seed is None else options.seed,
    )
    cost = graph.cost(weight)
    pairs = np.column_stack([graph.source, graph.target])
    numbered = RouteGraph.numbered("roadmap", np.round(graph.poses[:, :2], 4), pairs)
    figures = {
        "length": graph.length.astype(np.float64),
        "exposure": graph.exposure.astype(np.float64),
        # PenaltyScorer reads it, for those who set `overridable` and let Nav2 score the edges.
        "penalty": cost - graph.length,
    }
    every = np.ones(len(pairs), dtype=np.bool_)
    path.write_text(numbered.with_figures(every, cost, figures).text(weight), encoding="utf-8")
    return (path,)


ROUTE_GRAPH: Final = Exporter(
    subject="map",
    format="nav2-route-graph",
    title="a PRM* roadmap as a graph with costs, GeoJSON",
    reader="Nav2, Route Server (GeoJsonGraphFileLoader)",
    write=write,
    suffixes=(".geojson",),
    uses=frozenset({"layer", "weight", "robot_radius", "milestones", "seed"}),
)
