"""Route graphs as Nav2's Route Server reads them, or drawn as lines: GeoJSON, read and written."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ambinav.buildings.drawn_items import KINDS
from ambinav.config import as_array
from ambinav.config.numbers import shown
from ambinav.geometry.map_frame import MAP_FRAME
from ambinav.runtime.array_types import Bools, Floats, Ints32
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import write_text
from ambinav_planners.geojson import Feature, list_of, point_of, read_features

Properties = Mapping[str, Any]

LINES = ("LineString", "MultiLineString")
# Decimals of a metre to which the vertices of drawn lines are compared: equal ones are one node.
VERTEX_DECIMALS = 3


@dataclass(frozen=True, eq=False)
class RouteGraph:
    """Nodes, and edges between them: straight, and each for one direction.

    Attributes:
        source: Names the graph in messages.
        xy: Positions of the nodes, float64, shape (N, 2), metres, map frame.
        pairs: Start and end node of each edge, int32, shape (E, 2).
        nodes: Properties of each node, with its `id`.
        edges: Properties of each edge, with its `id`, `startid` and `endid`.
    """

    source: str
    xy: Floats
    pairs: Ints32
    nodes: tuple[Properties, ...]
    edges: tuple[Properties, ...]

    @classmethod
    def numbered(cls, source: str, xy: ArrayLike, pairs: ArrayLike) -> RouteGraph:
        """Create a graph without properties but its ids, which start at 1 and are distinct.

        Args:
            source: See the class, as the other two.
            xy: Shape (N, 2).
            pairs: Indices of nodes, shape (E, 2).

        Raises:
            InputError: a pair names no node.
        """
        xy, pairs = as_array(xy, "xy", "x and y, (N, 2)"), np.asarray(pairs, dtype=np.int32)
        if not ((pairs >= 0) & (pairs < len(xy))).all():
            raise InputError(f"{source}: a pair names none of the {len(xy)} nodes, from 0 on.")
        nodes = ({"id": k, "frame": "map"} for k in range(1, len(xy) + 1))
        edges = (
            {"id": k, "startid": a + 1, "endid": b + 1}
            for k, (a, b) in enumerate(pairs.tolist(), start=len(xy) + 1)
        )
        return cls(source, xy, pairs, tuple(nodes), tuple(edges))

    @classmethod
    def read(cls, path: str | Path) -> RouteGraph:
        """Read a GeoJSON FeatureCollection in the map frame, metres.

        With Points it is a graph of Nav2's Route Server: a Point with `id` is a node, and a
        MultiLineString or LineString with `id`, `startid` and `endid` an edge, straight from node
        to node whatever its own coordinates are, as Nav2 drives it. Without Points, lines are
        passable in both directions, or only as they are drawn if their property `oneway` is true,
        and meet where they have a vertex in common (to a millimetre).

        Raises:
            InputError: the file cannot be read or is no such graph; the message names the feature,
                counted from 0, the field and the value.
        """
        path = Path(path)
        features = [
            feature
            # Nodes are in the frame of Nav2's map, whatever `crs` says.
            for feature in read_features(
                path, "a route graph of nodes and edges, or of lines", frame=False
            )
            if feature.geometry["type"] in ("Point", *LINES)
        ]
        if any(feature.geometry["type"] == "Point" for feature in features):
            return _with_ids(path, features)
        return _of_lines(path, features)

    def with_figures(self, used: Bools, cost: Floats, figures: Mapping[str, Floats]) -> RouteGraph:
        """Return some of the edges with costs and figures for the scorers of Nav2.

        The costs are not overridable, so that Nav2's scorers leave them as they are.

        Args:
            used: The edges that stay, bool, shape (E,).
            cost: Cost of each edge, shape (E,), metres-equivalent.
            figures: Further figures of each edge by name, shape (E,) each; they become `metadata`,
                beside what stands there.
        """
        edges = tuple(
            {
                **self.edges[k],
                "cost": round(float(cost[k]), 4),
                "overridable": False,
                "metadata": {
                    **(self.edges[k].get("metadata") or {}),
                    **{name: round(float(values[k]), 4) for name, values in figures.items()},
                },
            }
            for k in np.flatnonzero(used).tolist()
        )
        return replace(self, pairs=self.pairs[used], edges=edges)

    def text(self, weight: float) -> str:
        """Return the file's text: nodes, then edges; the weight is that of their costs."""
        points = self.xy.tolist()
        nodes = (
            _feature(properties, "Point", point)
            for properties, point in zip(self.nodes, points, strict=True)
        )
        edges = (
            _feature(properties, "MultiLineString", [[points[a], points[b]]])
            for properties, (a, b) in zip(self.edges, self.pairs.tolist(), strict=True)
        )
        collection = {
            "type": "FeatureCollection",
            "name": "route graph",
            **MAP_FRAME,
            "weight": weight,
            "features": [*nodes, *edges],
        }
        return json.dumps(collection, allow_nan=False) + "\n"

    def save(self, path: str | Path, weight: float) -> None:
        """Write the graph for Nav2's Route Server, completely or not at all.

        Raises:
            InputError: the place is not writable.
        """
        write_text(Path(path), self.text(weight))


def _feature(properties: Properties, kind: str, coordinates: object) -> dict[str, Any]:
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": kind, "coordinates": coordinates},
    }


def _with_ids(path: Path, features: list[Feature]) -> RouteGraph:
    """Return the graph of nodes and edges with ids."""
    number: dict[int, int] = {}
    edge_ids: set[int] = set()
    xy: list[tuple[float, float]] = []
    nodes: list[Properties] = []
    edges: list[tuple[str, Properties]] = []
    for label, properties, geometry in features:
        used_ids = number if geometry["type"] == "Point" else edge_ids
        feature_id = _id(label, properties, "id")
        if feature_id in used_ids:
            raise InputError(f"{label}: id is {feature_id}, as that of another; give each its own.")
        if geometry["type"] == "Point":
            number[feature_id] = len(nodes)
            nodes.append(properties)
            xy.append(point_of(label, geometry.get("coordinates")))
        else:
            edge_ids.add(feature_id)
            if not isinstance(properties.get("metadata") or {}, dict):
                raise InputError(
                    f"{label}: metadata is {shown(properties['metadata'])}; give an object."
                )
            edges.append((label, properties))
    pairs = []
    for label, properties in edges:
        for field in ("startid", "endid"):
            node = _id(label, properties, field)
            if node not in number:
                raise InputError(
                    f"{label}: {field} is {node}, and no Point has that id; give that of a node."
                )
            pairs.append(number[node])
    return RouteGraph(
        str(path), np.array(xy), _pairs(path, pairs), tuple(nodes), tuple(edge for _, edge in edges)
    )


def _of_lines(path: Path, features: list[Feature]) -> RouteGraph:
    """Return the graph of lines that meet at common vertices."""
    number: dict[tuple[float, float], int] = {}
    nodes: list[tuple[float, float]] = []
    pairs: list[tuple[int, int]] = []
    for label, properties, geometry in features:
        if properties.get("kind") in KINDS:
            raise InputError(
                f"{label}: kind is {properties['kind']}: this is the plan of a building; give a "
                "route graph, or lines without a kind."
            )
        lines = geometry.get("coordinates")
        for line in [lines] if geometry["type"] == "LineString" else list_of(label, lines):
            vertices = []
            for vertex in list_of(label, line):
                point = point_of(label, vertex)
                # Vertices of one millimetre are one node, at the first of them.
                vertices.append(number.setdefault(_rounded(point), len(nodes)))
                if vertices[-1] == len(nodes):
                    nodes.append(point)
            one_way = properties.get("oneway", False)
            if not isinstance(one_way, bool):
                raise InputError(f"{label}: oneway is {shown(one_way)}; give true or false.")
            for a, b in itertools.pairwise(vertices):
                pairs += [(a, b)] if one_way else [(a, b), (b, a)]
    distinct = list(dict.fromkeys((a, b) for a, b in pairs if a != b))
    return RouteGraph.numbered(str(path), np.array(nodes), _pairs(path, distinct))


def _pairs(path: Path, pairs: list[Any]) -> Ints32:
    """Return the edges as an array, shape (E, 2)."""
    if not pairs:
        raise InputError(
            f"{path}: there is no edge in it; give lines with startid and endid between Points "
            "with id, or lines alone."
        )
    return np.array(pairs, dtype=np.int32).reshape(-1, 2)


def _rounded(point: tuple[float, float]) -> tuple[float, float]:
    return round(point[0], VERTEX_DECIMALS), round(point[1], VERTEX_DECIMALS)


def _id(label: str, properties: Properties, field: str) -> int:
    value = properties.get(field)
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise InputError(f"{label}: {field} is {shown(value)}; give a whole number from 0 on.")
    return value
