"""Import graph of the files of the three packages, and the floors of the rooms.

An import counts wherever it stands: at the top of a file, within a function, for type checking
alone, or as `import_module` of a literal name. What a registry loads (plug-ins) does not.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

PACKAGES = {"ambinav": ".", "ambinav_envs": "envs", "ambinav_planners": "planners"}
"""The import packages, and the folders that they lie in."""

FLOORS: tuple[tuple[str, ...], ...] = (
    ("version",),
    ("runtime",),
    ("config",),
    ("plugins",),
    ("geometry.motion", "geometry.segments"),
    ("casting",),
    ("geometry",),
    ("geometry.collision",),
    ("buildings",),
    ("maps", "sensing"),
    ("export", "localization", "server.wire", "service", "store"),
    ("ambiguity", "routes", "server.client"),
    ("layers",),
    ("map_building",),
    ("tiles",),
    ("drive",),
    ("logs",),
    ("forecasting",),
    ("export.formats", "reports"),
    ("plotting",),
    ("reports.page",),
    ("studies.study",),
    ("studies.design",),
    ("demo", "studies.audit"),
    ("studies", "studies.design.requirement"),
    ("server",),
    ("ambinav", "plugin"),
    ("ambinav_envs", "ambinav_planners"),
    ("ambinav_envs.leaderboard",),
    ("cli",),
    ("__main__",),
)
"""Rooms from the ground up. A room is a module of `ambinav`, or a package with all that lies in it
and in no room of its own; `ambinav` is what `import ambinav` gives, `ambinav_envs` and
`ambinav_planners` are the other two packages. A room may use those on lower floors."""

TOOLS = 3
"""Number of floors with small tools that all rooms use."""

Graph = Mapping[str, frozenset[str]]


def modules_in(root: Path) -> dict[str, Path]:
    """Return all modules of the packages in a working tree, and their files."""
    modules: dict[str, Path] = {}
    for package, place in PACKAGES.items():
        for path in sorted((root / place / package).rglob("*.py")):
            parts = path.relative_to(root / place).with_suffix("").parts
            modules[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return modules


def import_graph(root: Path) -> Graph:
    """Return for each module the modules of the packages that it imports, itself excluded."""
    modules = modules_in(root)
    return {
        name: frozenset(_imports(path, name, modules)) - {name} for name, path in modules.items()
    }


def _imports(path: Path, name: str, modules: Mapping[str, Path]) -> Iterator[str]:
    package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in modules)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) + 1 - node.level] if node.level else []
            source = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names:
                deeper = f"{source}.{alias.name}"
                target = deeper if deeper in modules else source
                if target in modules:
                    yield target
        elif isinstance(node, ast.Call) and _called(node.func) == "import_module":
            yield from (
                word.value
                for word in node.args
                if isinstance(word, ast.Constant) and word.value in modules
            )


def _called(function: ast.expr) -> str:
    """Return the last name of what is called; empty if it has none."""
    if isinstance(function, ast.Attribute):
        return function.attr
    return function.id if isinstance(function, ast.Name) else ""


def circles(graph: Graph) -> list[list[str]]:
    """Return the import cycles: sets of modules (or rooms) that reach each other."""
    reached = {name: _reached(graph, name) for name in graph}
    sets = {
        frozenset({name} | {target for target in reached[name] if name in reached.get(target, ())})
        for name in graph
    }
    return sorted(sorted(members) for members in sets if len(members) > 1)


def _reached(graph: Graph, name: str) -> set[str]:
    """Return all modules that a module imports, directly or indirectly."""
    reached: set[str] = set()
    todo = list(graph[name])
    while todo:
        module = todo.pop()
        if module not in reached:
            reached.add(module)
            todo.extend(graph.get(module, ()))
    return reached


def room_of(module: str, rooms: Iterable[str]) -> str | None:
    """Return the innermost of these rooms that holds a module; None without one."""
    name = module.removeprefix("ambinav.")
    holding = [
        room
        for room in rooms
        if name == room or (room != "ambinav" and name.startswith(f"{room}."))
    ]
    return max(holding, key=len, default=None)
