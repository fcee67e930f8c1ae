"""What Nav2 and Autoware declare in their sources, against what we write (nav2_contract.yaml)."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

import ambinav as an
from ambinav.export.formats import autoware, lanelet2, nav2_masks
from ambinav.runtime.errors import InputError
from tests.export.test_map_server import map_io

Write = Callable[..., tuple[Path, ...]]
CONTRACT = yaml.safe_load(Path(__file__).with_name("nav2_contract.yaml").read_text())
NAV2, NODES = CONTRACT["nav2"], CONTRACT["nav2"]["nodes"]
TYPES = {
    "string": lambda value: isinstance(value, str),
    "bool": lambda value: isinstance(value, bool),
    # rclcpp takes no integer for a double.
    "double": lambda value: isinstance(value, float),
    "integer": lambda value: isinstance(value, int) and not isinstance(value, bool),
    "string_array": lambda value: bool(value) and all(isinstance(one, str) for one in value),
}
KINDS = [
    ("nav2-keepout", {}),
    ("nav2-preference", {}),
    ("nav2-speed", {}),
    ("nav2-speed", {"max_speed": 0.5}),
    ("nav2-binary", {}),
]


def check(given: dict[str, Any], declared: dict[str, str]) -> None:
    for name, value in given.items():
        assert TYPES[declared[name]](value), (name, value)


@pytest.mark.parametrize(("kind", "options"), KINDS)
def test_parameters_are_declared_and_masks_decode(
    write: Write, kind: str, options: dict[str, float]
) -> None:
    mask, _, params, _ = write(kind, "mask.yaml", package="my_robot/maps/", **options)
    assert set(NAV2["map_io"]["keys"]) == set(yaml.safe_load(mask.read_text()))
    *servers, costmap = yaml.safe_load(params.read_text()).values()
    own = [server["ros__parameters"] for server in servers]
    for node, given in zip(NODES.values(), own, strict=True):
        check(given, node["parameters"])
    assert own[0]["yaml_filename"] == "$(find-pkg-share my_robot)/maps/mask.yaml"
    (inner,) = (one["ros__parameters"] for one in costmap.values())
    check({"filters": inner["filters"]}, NAV2["costmap"]["parameters"])
    used = inner[inner["filters"][0]]
    rule = NAV2["filters"][used["plugin"]]
    check(used, NAV2["filters"]["any"]["parameters"] | rule["parameters"])
    assert NAV2["costmap"]["absolute_topics"]
    for given in (*own, used):
        assert all(value.startswith("/") for name, value in given.items() if "topic" in name)

    info, grid = own[1], map_io(mask)[0].astype(float)
    low, high = NAV2["map_io"]["raw"]
    assert info["type"] in rule["types"] and low <= grid.min() and grid.max() <= high
    space = info["base"] + info["multiplier"] * grid
    if "lethal" in rule:
        assert (info["base"], info["multiplier"]) == (rule["base"], rule["multiplier"])
        cost = np.round(grid * rule["lethal"] / 100.0)
        assert (cost.max() == rule["lethal"]) == (kind == "nav2-keepout")
    elif "no_limit_mask" in rule:
        limits = space[grid != rule["no_limit_mask"]]
        # No limit that we mean is taken for none.
        assert limits.size and (limits > rule["no_limit"]).all()
        assert limits.max() <= options.get("max_speed", rule["percent"][1])
    else:
        assert set((space > used["flip_threshold"]).ravel()) == {False, True}


class Recorded(SimpleNamespace):
    """A launch action or description: what it was made with."""

    def __init__(self, *args: Any, **given: Any) -> None:
        super().__init__(args=args, **given)


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[Recorded]]:
    """What runs a launch file against stubs of launch and launch_ros: the nodes that it starts."""
    if "launch" in sys.modules:
        pytest.skip("the launch of ROS 2 itself is imported")
    names = {
        "launch": ("LaunchDescription",),
        "launch.actions": ("DeclareLaunchArgument", "OpaqueFunction"),
        "launch.substitutions": ("LaunchConfiguration",),
        "launch_ros": (),
        "launch_ros.actions": ("LoadComposableNodes", "Node"),
        "launch_ros.descriptions": ("ComposableNode",),
    }
    for module, members in names.items():
        stub = ModuleType(module)
        vars(stub).update({name: type(name, (Recorded,), {}) for name in members})
        monkeypatch.setitem(sys.modules, module, stub)
    sys.modules["launch.substitutions"].LaunchConfiguration.perform = (  # type: ignore[attr-defined]
        lambda self, context: context[self.args[0]]
    )

    def run(path: Path, **arguments: str) -> list[Recorded]:
        scope: dict[str, Any] = {"__file__": str(path), "__name__": "launch_file"}
        exec(compile(path.read_text(), path, "exec"), scope)
        *declared, function = scope["generate_launch_description"]().args[0]
        usual = {one.args[0]: one.default_value for one in declared}
        assert set(NAV2["launch"]["arguments"]) < set(usual) and set(arguments) <= set(usual)
        assert usual["container_name"] == NAV2["launch"]["container"]
        actions: list[Recorded] = function.function(usual | arguments)
        return actions

    return run


def test_masks_run_side_by_side(write: Write) -> None:
    names: list[str] = []
    for kind in ("keepout", "preference", "speed", "binary"):
        params = write(f"nav2-{kind}", f"{kind}.yaml")[2]
        names += [
            name for name in yaml.safe_load(params.read_text()) if not name.endswith("costmap")
        ]
    assert len(set(names)) == len(names) == 12


@pytest.mark.parametrize("kind", ["nav2-keepout", "nav2-speed", "nav2-binary"])
def test_the_launch_file_starts_the_servers(
    write: Write, launched: Callable[..., list[Recorded]], kind: str
) -> None:
    mask, _, params, launch = write(kind, "it's a mask.yaml", package="my_robot/maps")
    document = yaml.safe_load(params.read_text())
    alone = launched(launch)
    if kind == "nav2-keepout":
        assert [node.name for node in alone[:2]] == NAV2["launch"]["nodes"]
    assert alone[2].parameters[0]["node_names"] == [node.name for node in alone[:2]]
    for node, fact in zip(alone, NODES.values(), strict=True):
        assert (node.package, node.executable) == (fact["package"], fact["executable"])
        (given,) = node.parameters
        assert given.pop("use_sim_time") is False and node.namespace == "/"
        written = document[node.name]["ros__parameters"]
        assert given == written | ({"yaml_filename": str(mask)} if "topic_name" in given else {})

    (load,) = launched(launch, namespace="/robot1", use_composition="True", use_sim_time="true")
    assert load.target_container == "/robot1/nav2_container"
    composed = load.composable_node_descriptions
    assert [node.plugin for node in composed] == list(NODES)
    for node, other in zip(composed, alone, strict=True):
        assert (node.name, node.namespace) == (other.name, "/robot1")
        (given,) = node.parameters
        assert given["use_sim_time"] is True
        topics = {name: value for name, value in given.items() if "topic" in name}
        assert topics == {name: f"/robot1{other.parameters[0][name]}" for name in topics}


def test_a_package_has_a_name(write: Write) -> None:
    for name in ("My Robot", "../maps", "$(env HOME)", "/maps", ""):
        with pytest.raises(InputError, match=r"--package: .* give a ROS package and a folder"):
            write("nav2-keepout", "mask.yaml", package=name)


def test_types_of_filters_are_those_of_nav2() -> None:
    codes = {code for one in NAV2["filters"].values() for code in one.get("types", ())}
    assert codes == {
        nav2_masks.KEEPOUT_TYPE, nav2_masks.PERCENT_TYPE, nav2_masks.METRES_TYPE,
        nav2_masks.BINARY_TYPE,
    }  # fmt: skip


def test_route_graphs_have_the_loaders_keys() -> None:
    from ambinav_planners.route_graph import RouteGraph

    graph = RouteGraph.numbered("g", np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([[0, 1]]))
    figures = {"penalty": np.array([0.5])}
    graph = graph.with_figures(np.array([True]), np.array([1.5]), figures)
    for feature in yaml.safe_load(graph.text(5.0))["features"]:
        kind = feature["geometry"]["type"]
        (rule,) = (one for one in (NAV2["route_graph"][name] for name in ("node", "edge"))
                   if kind in one["geometry"])  # fmt: skip
        keys = set(feature["properties"])
        assert set(rule["required"]) <= keys <= {*rule["required"], *rule["optional"]}


def test_autowares_zones_and_thresholds(write: Write, amap: an.AmbiguityMap) -> None:
    from xml.etree import ElementTree

    area, monitor = (CONTRACT["autoware"][name] for name in ("degenerate_area", "error_monitor"))
    assert area["type"] == lanelet2.TYPE
    for way in ElementTree.parse(write("zones-lanelet2", "z.osm", least_area=0.0)[0]).iter("way"):
        assert set(area["tags"]["required"]) <= {tag.get("k") for tag in way.iter("tag")}
    assert monitor["scale"] == autoware.SCALE
    for limits, end in ((autoware.LONG, ""), (autoware.LATERAL, "_lateral_direction")):
        assert limits == tuple(monitor[f"{name}_ellipse_size{end}"] for name in ("warn", "error"))
