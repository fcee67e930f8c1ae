"""Rooms use the rooms below them, no files import each other in a circle, and the core is light."""

from __future__ import annotations

import functools
import subprocess
import sys
from pathlib import Path

import pytest
from import_graph import FLOORS, Graph, circles, import_graph, room_of

ROOT = Path(__file__).parents[1]
FLOOR = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}

UPWARD = {("ambinav_envs", "ambinav_envs.leaderboard"): "it offers names of all its rooms"}
"""Modules that reach a room that is not below theirs, and why they do for now."""

HEAVY = ("fastapi", "gymnasium", "ompl", "stable_baselines3", "torch")


@functools.cache
def graph() -> Graph:
    """What each module imports; read once, and only where it is tested."""
    return import_graph(ROOT)


def upward() -> set[tuple[str, str]]:
    """Each module and each room that it imports from though that is not below."""
    return {
        (module, room)
        for module, imported in graph().items()
        for other in imported
        if (room := str(room_of(other, FLOOR))) != (own := str(room_of(module, FLOOR)))
        and FLOOR.get(room, 0) >= FLOOR.get(own, 0)
    }


def test_every_module_has_a_room() -> None:
    homeless = [module for module in graph() if room_of(module, FLOOR) is None]
    assert not homeless, "give them a floor in benchmarks/import_graph.py"


def test_no_room_imports_a_room_above_or_beside_it() -> None:
    assert upward() - set(UPWARD) == set()


def test_the_list_of_exceptions_holds_no_more_than_there_are() -> None:
    assert set(UPWARD) - upward() == set(), "take them off the list"


def test_no_circle_of_files() -> None:
    assert circles(graph()) == []


def test_the_core_imports_neither_planners_nor_environments() -> None:
    above = ("ambinav.cli", "ambinav.__main__", "ambinav_envs", "ambinav_planners")
    reaching = {
        module
        for module, imported in graph().items()
        if not module.startswith(above) and any(other.startswith(above) for other in imported)
    }
    assert reaching == {module for module, _ in UPWARD if not module.startswith(above)}


def test_circles_are_found_through_several_files() -> None:
    chain = {"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": set(), "e": {"a"}}
    assert circles({name: frozenset(to) for name, to in chain.items()}) == [["a", "b", "c"]]


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("def late():\n    from ambinav.maps import schema", {"ambinav.maps.schema"}),
        ("from . import plugins\nfrom .maps.schema import CORE", {"ambinav.maps.schema"}),
        ("import ambinav_envs.sb3, numpy", {"ambinav_envs.sb3"}),
    ],
)
def test_imports_are_read_wherever_they_stand(source: str, found: set[str], tmp_path: Path) -> None:
    for name in ("ambinav/maps/schema", "ambinav/plugins", "envs/ambinav_envs/sb3"):
        path = tmp_path / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    (tmp_path / "ambinav" / "reader.py").write_text(source)
    assert import_graph(tmp_path)["ambinav.reader"] >= found


def test_importing_the_core_loads_none_of_the_heavy_packages() -> None:
    code = (
        "import sys, ambinav\n"
        "[getattr(ambinav, name) for name in ambinav.__all__]\n"
        f"print([name for name in {HEAVY} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.stdout.strip() == "[]", done.stderr
