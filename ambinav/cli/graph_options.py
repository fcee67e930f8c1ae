"""Options of `ambinav plan` on routes over a route graph."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ambinav.cli.checks import check_suffix, conflict
from ambinav.cli.plan_options import AUTO, COMPLETE, LimitOptions, ResultOptions, SearchOptions
from ambinav.cli.promise_options import PromiseOptions
from ambinav.cli.robot_options import RobotOptions
from ambinav.cli.running import check_file
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from ambinav_planners.graph_pricing import PricedGraph


@dataclass(frozen=True, kw_only=True)
class GraphOptions:
    """Options on the route graph.

    Attributes:
        from_graph (FILE): Follow the edges of a route graph: .geojson, as Nav2's Route Server
            reads it, or lines alone. [default: routes lead over all free floor]
        priced_graph (FILE): Write the graph with what its edges cost, for Nav2: .geojson.
            [default: none]
    """

    PANEL: ClassVar[str] = "Route graph"

    from_graph: Path | None = None
    priced_graph: Path | None = None

    def check(
        self,
        search: SearchOptions,
        robot: RobotOptions,
        promise: PromiseOptions,
        result: ResultOptions,
        limits: LimitOptions,
        output: Path,
    ) -> None:
        """Refuse options that plan over free floor, and files that cannot be written.

        Raises:
            InputError: a value or a combination of options cannot be used.
        """
        if self.from_graph is not None:
            for reason, holds in (
                ("is for --space r2", robot.space != "r2"),
                ("is searched without a planner, and --planner names one", search.planner != AUTO),
                ("is for a single weight, and --pareto plans for many", result.pareto),
                ("has directions of its own, and --one-way is for all free floor", limits.one_way),
                ("is not for --max-lost, which searches all free floor", promise.plans),
                ("is not for --certify, whose proof is of all free floor", result.certify),
            ):
                conflict("--from-graph", bool(holds), reason)
            for option in search.budget(promise.measures_share):
                conflict(option, True, f"has no effect on --from-graph, {COMPLETE}")
            reason = "has no effect on --from-graph, whose routes keep to its edges"
            conflict("--no-improve", not search.improve, reason)
        if self.priced_graph is not None:
            conflict("--priced-graph", self.from_graph is None, "is for --from-graph")
            check_suffix(self.priced_graph, "--priced-graph", (".geojson", ".json"))
            check_file(self.priced_graph)
            for option, other in (("--from-graph", self.from_graph), ("--output", output)):
                if other is not None and other.resolve() == self.priced_graph.resolve():
                    raise InputError(
                        f"--priced-graph: {other} is the file of {option} too; give another one."
                    )

    def arguments(self) -> dict[str, Any]:
        """Return the argument of `RoutePlanner` about the graph.

        Raises:
            InputError: the file cannot be read, or holds no route graph.
        """
        from ambinav_planners import RouteGraph

        return {
            "route_graph": None if self.from_graph is None else RouteGraph.read(self.from_graph)
        }

    def finish(self, graph: PricedGraph | None) -> tuple[dict[str, Any], list[str]]:
        """Write the priced graph if asked to; return what JSON and the table say of the graph."""
        if graph is None:
            return {}, []
        edges, blocked = len(graph.free), int((~graph.free).sum())
        figures: dict[str, Any] = {"edges": edges, "blocked": blocked}
        lines = [f"graph: {blocked} of {edges} edges are blocked for this robot and left out"]
        if self.priced_graph is not None:
            graph.save(self.priced_graph)
            figures["output"] = str(self.priced_graph)
            lines.append(f"priced graph: {self.priced_graph}")
        return {"graph": figures}, lines
