"""Draw the packages and their imports by layers, and compute statistics of their code.

Compares a commit with the working tree and writes both pictures and the tables into a page, between
the lines that say so:

    python benchmarks/architecture.py --before 59ecaf5 --out docs/architecture.md
"""

from __future__ import annotations

import ast
import io
import math
import runpy
import subprocess
import tarfile
import tempfile
import textwrap
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from harness import ROOT, option, parser_of, table
from import_graph import PACKAGES, Graph, circles, import_graph, modules_in, room_of
from matplotlib.patches import FancyArrowPatch

DPI = 130
SLOTS = 5
"""Places for boxes in a row of the picture."""
BEND = 0.18
"""Curvature of red arrows, to separate them from grey ones in the opposite direction."""
FLOOR_TABLE = "benchmarks/import_graph.py"
BEGIN, END = "<!-- architecture: begin -->", "<!-- architecture: end -->"
# On a picture the rooms within a package of the core are one box, but for those that stand apart:
# other packages lie between them and the rest of their own.
APART = frozenset(
    {"geometry.segments", "export.formats", "reports.page", "server.client", "server.wire"}
)
PLANNERS, ENVS, LEADERBOARD = "ambinav_planners", "ambinav_envs", "ambinav_envs.leaderboard"
TITLES = {
    "ambinav": "import ambinav",
    PLANNERS: "planners",
    ENVS: "envs",
    LEADERBOARD: "leaderboard",
}

LEGEND = """\
A box is a package, a row is a floor. Grey arrows go down: who uses whom. Of these, those that
follow from others (a uses b and b uses c, so a may use c) are left out. Red arrows do not go down;
the number says how many imports each stands for. The small tools at the bottom are used by all;
what they import from above is counted in the table, not drawn."""


@dataclass(frozen=True)
class Tree:
    """Statistics of a working tree.

    Attributes:
        name: Name of the commit, or "now".
        floors: Its rooms from the ground up, see `import_graph.FLOORS`.
        tools: How many floors hold small tools, see `import_graph.TOOLS`.
        graph: Which module imports which.
        rooms: Which box imports from which, with the number of imports.
        lines: Lines of code of each box and package, empty ones and comments included.
        files: Files of each box.
        longest: The longest function: lines, its name and file.
        widest: The function with the most parameters: their number, its name and file.
    """

    name: str
    floors: tuple[tuple[str, ...], ...]
    tools: int
    graph: Graph
    rooms: dict[tuple[str, str], int]
    lines: Counter[str]
    files: Counter[str]
    longest: tuple[int, str]
    widest: tuple[int, str]


def main() -> None:
    """Read the command line, count, draw and write."""
    parser = parser_of(
        __doc__,
        before=option(None, "what to compare with", required=True, metavar="COMMIT"),
        out=option(None, "the page to write into; else print", type=Path, metavar="PAGE"),
    )
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        unpack(args.before, Path(folder))
        before = count(Path(folder), args.before)
    now = count(ROOT, "now")
    body = "\n\n".join(sections(before, now))
    if args.out is None:
        print(body)
        return
    images = args.out.parent / "images"
    for tree, name in ((before, "before"), (now, "now")):
        draw(tree, images / f"architecture-{name}.png")
    page = args.out.read_text(encoding="utf-8")
    head, _, after_begin = page.partition(BEGIN)
    _, end_mark, tail = after_begin.partition(END)
    if not end_mark:
        parser.error(f"{args.out}: the lines {BEGIN} and {END} are missing; add them.")
    args.out.write_text(f"{head}{BEGIN}\n\n{body}\n\n{END}{tail}", encoding="utf-8")


def unpack(commit: str, folder: Path) -> None:
    """Extract the packages of a commit into a folder."""
    archive = subprocess.run(
        ["git", "archive", commit, "ambinav", "envs", "planners", FLOOR_TABLE],
        cwd=ROOT, check=True, capture_output=True,
    )  # fmt: skip
    with tarfile.open(fileobj=io.BytesIO(archive.stdout)) as opened:
        opened.extractall(folder, filter="data")


def count(root: Path, name: str) -> Tree:
    """Compute the statistics of a working tree."""
    tables = runpy.run_path(str(root / FLOOR_TABLE))
    floors, boxes = tables["FLOORS"], boxes_of(tables["FLOORS"])
    graph, modules = import_graph(root), modules_in(root)
    rooms: Counter[tuple[str, str]] = Counter()
    for module, imported in graph.items():
        for target in imported:
            a, b = box_of(module, boxes), box_of(target, boxes)
            if a != b:
                rooms[a, b] += 1
    lines: Counter[str] = Counter()
    files: Counter[str] = Counter()
    functions: list[tuple[int, int, str]] = []
    for module, path in modules.items():
        text = path.read_text(encoding="utf-8")
        tree = ast.parse(text)
        place = path.relative_to(root).as_posix()
        lines[box_of(module, boxes)] += len(text.splitlines())
        files[box_of(module, boxes)] += 1
        functions += [
            (node.end_lineno - node.lineno + 1, arguments, f"`{node.name}` in {place}")
            for node, arguments in _functions(tree)
            if node.end_lineno is not None
        ]
    longest = max((length, text) for length, _, text in functions)
    widest = max((arguments, text) for _, arguments, text in functions)
    return Tree(name, floors, tables["TOOLS"], graph, dict(rooms), lines, files, longest, widest)


def _functions(tree: ast.Module) -> Iterator[tuple[ast.FunctionDef | ast.AsyncFunctionDef, int]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            arguments = node.args
            yield node, len(arguments.posonlyargs) + len(arguments.args) + len(arguments.kwonlyargs)


def boxes_of(floors: tuple[tuple[str, ...], ...]) -> tuple[str, ...]:
    """Return the boxes of a picture: packages of the core, and what stands apart from its own."""
    rooms = [room for floor in floors for room in floor]
    separate = [room for room in rooms if room in APART or room.startswith("ambinav_")]
    return tuple(dict.fromkeys([*separate, *(room.partition(".")[0] for room in rooms)]))


def box_of(module: str, boxes: tuple[str, ...]) -> str:
    """Return the box of a picture that a module belongs to."""
    return room_of(module, boxes) or module.removeprefix("ambinav.").partition(".")[0]


def floor_of(box: str, tree: Tree) -> int:
    """Return the highest floor of the rooms of a box."""
    return max(k for k, rooms in enumerate(tree.floors) for room in rooms if _in_box(room, box))


def _in_box(room: str, box: str) -> bool:
    inside = box not in (ENVS, "ambinav") and room not in APART and room.startswith(f"{box}.")
    return room == box or inside


def upward(tree: Tree) -> dict[tuple[str, str], int]:
    """Return imports of a room from one that is not below it."""
    return {(a, b): n for (a, b), n in tree.rooms.items() if floor_of(b, tree) >= floor_of(a, tree)}


def sections(before: Tree, now: Tree) -> Iterator[str]:
    """Return the tables of the page, in Markdown."""
    yield f"## Before ({before.name}) and now"
    yield table(("", before.name, "now"), list(_summary(before, now)))
    yield "## Pictures"
    for tree, name in ((before, "before"), (now, "now")):
        yield f"![The packages and their arrows, {tree.name}](images/architecture-{name}.png)"
    yield LEGEND
    yield "## Lines of code by package"
    rows = [(TITLES.get(box, box), *counts) for box, counts in _lines_by_box(before, now)]
    yield table(("package", before.name, "now"), rows)


def _lines_by_box(before: Tree, now: Tree) -> Iterator[tuple[str, list[str]]]:
    tops = {box: floor_of(box, tree) for tree in (before, now) for box in tree.lines}
    for box in sorted(tops, key=lambda box: (-tops[box], box)):
        yield box, [str(tree.lines[box]) if box in tree.lines else "" for tree in (before, now)]


def _summary(before: Tree, now: Tree) -> Iterator[tuple[str, ...]]:
    trees = (before, now)

    def row(label: str, values: list[object]) -> tuple[str, ...]:
        return (label, *map(str, values))

    yield row("files", [sum(t.files.values()) for t in trees])
    for package in PACKAGES:
        totals = [
            sum(n for box, n in t.lines.items() if _package(box) == package) for t in trees
        ]  # fmt: skip
        yield row(f"lines of {package}", list(totals))
    yield row("circles of files", [len(circles(t.graph)) for t in trees])
    yield row("files in them", [sum(map(len, circles(t.graph))) for t in trees])
    yield row("circles of packages", [len(circles(_boxes(t))) for t in trees])
    yield row("arrows that do not go down", [len(upward(t)) for t in trees])
    yield row("imports in them", [sum(upward(t).values()) for t in trees])
    yield row("longest function, lines", [f"{t.longest[0]}: {t.longest[1]}" for t in trees])
    yield row("most parameters", [f"{t.widest[0]}: {t.widest[1]}" for t in trees])


def _package(box: str) -> str:
    return box.partition(".")[0] if box.startswith("ambinav_") else "ambinav"


def _boxes(tree: Tree) -> Graph:
    return {box: frozenset(b for a, b in tree.rooms if a == box) for box in tree.lines}


def draw(tree: Tree, path: Path) -> None:
    """Draw the boxes by floors and write the picture."""
    boxes = [box for box in tree.lines if floor_of(box, tree) >= tree.tools]
    rows = {
        floor: row for row, floor in enumerate(sorted({floor_of(box, tree) for box in boxes}), 1)
    }
    wrong = {edge: n for edge, n in upward(tree).items() if set(edge) <= set(boxes)}
    right = _without_detours({e for e in tree.rooms if set(e) <= set(boxes)} - set(wrong))
    place = _placed({box: rows[floor_of(box, tree)] for box in boxes}, [*right, *wrong])
    figure, axes = plt.subplots(figsize=(7.5, 0.62 * (len(rows) + 1.2)), dpi=DPI)
    axes.set(xlim=(-0.6, SLOTS - 0.4), ylim=(-0.4, len(rows) + 0.5))
    axes.axis("off")
    figure.subplots_adjust(0.0, 0.0, 1.0, 1.0)
    drawn = {}
    for box, (x, y) in place.items():
        text = f"{TITLES.get(box, box)}\n{tree.lines[box]:,} lines".replace(",", " ")
        drawn[box] = axes.text(
            x, y, text, ha="center", va="center", fontsize=7.5, zorder=3,
            bbox={"boxstyle": "round,pad=0.35", "facecolor": "#eef2f7", "edgecolor": "0.35"},
        )  # fmt: skip
    figure.canvas.draw()  # boxes get their size
    for edge in [*right, *wrong]:
        number = wrong.get(edge)
        ends = [drawn[box].get_bbox_patch() for box in edge]
        axes.add_patch(
            FancyArrowPatch(
                place[edge[0]], place[edge[1]], arrowstyle="-|>", mutation_scale=9, zorder=2,
                shrinkA=0, shrinkB=1, patchA=ends[0], patchB=ends[1],
                color="0.5" if number is None else "#c1272d",
                linewidth=0.9 if number is None else 1.0 + min(number, 20) / 10,
                connectionstyle=f"arc3,rad={0.0 if number is None else BEND}",
            )
        )  # fmt: skip
        if number is not None:
            (x0, y0), (x1, y1) = axes.transData.transform([place[box] for box in edge])
            # Beside the middle of the arc, on its outer side.
            off = BEND / 2 + 0.12 * DPI / math.hypot(x1 - x0, y1 - y0)
            beside = (x0 + x1) / 2 + off * (y1 - y0), (y0 + y1) / 2 - off * (x1 - x0)
            x, y = axes.transData.inverted().transform(beside)
            axes.text(
                x, y, str(number), color="#c1272d", fontsize=8, ha="center", va="center", zorder=4
            )  # fmt: skip
    tools = ", ".join(sorted(box for box in tree.lines if floor_of(box, tree) < tree.tools))
    text = textwrap.fill(f"small tools: {tools}", 90)
    axes.text((SLOTS - 1) / 2, 0.0, text, ha="center", va="center", fontsize=7.5, color="0.3")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)
    plt.close(figure)


def _placed(row: dict[str, int], edges: list[tuple[str, str]]) -> dict[str, tuple[float, float]]:
    """Return positions of the boxes, in their rows, with few crossings of arrows and boxes.

    Found by moving one box, or exchanging two, as long as that helps, from several beginnings.
    """
    rng, boxes = np.random.default_rng(0), sorted(row)
    best: tuple[float, dict[str, int]] = (math.inf, {})
    for _ in range(12):
        slot: dict[str, int] = {}
        for y in set(row.values()):
            in_row = [box for box in boxes if row[box] == y]
            slot |= dict(zip(in_row, rng.permutation(SLOTS)[: len(in_row)].tolist(), strict=True))
        cost, better = _cost(slot, row, edges), True
        while better:
            better = False
            for box in boxes:
                for to in range(SLOTS):
                    tried = slot | {box: to}
                    for rival in boxes:
                        if rival != box and row[rival] == row[box] and slot[rival] == to:
                            tried[rival] = slot[box]
                    if (tried_cost := _cost(tried, row, edges)) < cost:
                        slot, cost, better = tried, tried_cost, True
        best = min(best, (cost, slot), key=lambda cost_and_slots: cost_and_slots[0])
    return {box: (float(x), float(row[box])) for box, x in best[1].items()}


def _cost(slot: dict[str, int], row: dict[str, int], edges: list[tuple[str, str]]) -> float:
    """Return the cost of a layout: arrows over boxes, arrows over arrows, sideways length."""
    cost = 0.0
    lines = [((slot[a], row[a]), (slot[b], row[b])) for a, b in edges]
    for (a, b), ((x0, y0), (x1, y1)) in zip(edges, lines, strict=True):
        cost += 0.1 * abs(x1 - x0)
        for box, x in slot.items():
            if box not in (a, b) and min(y0, y1) <= row[box] <= max(y0, y1):
                at = x0 + (x1 - x0) * (row[box] - y0) / (y1 - y0) if y0 != y1 else x
                cost += 10.0 * (abs(at - x) < 0.6)
    for k, (a, b) in enumerate(lines):
        for c, d in lines[:k]:
            if len({a, b, c, d}) == 4:
                cost += _side(a, b, c) * _side(a, b, d) < 0 > _side(c, d, a) * _side(c, d, b)
    return cost


def _side(a: tuple[int, int], b: tuple[int, int], c: tuple[int, int]) -> int:
    """Return a number above 0 if c lies left of the line from a to b."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _without_detours(edges: set[tuple[str, str]]) -> list[tuple[str, str]]:
    """Return the transitive reduction of an acyclic graph."""
    after: dict[str, set[str]] = {}
    for a, b in edges:
        after.setdefault(a, set()).add(b)

    def leads(a: str, b: str) -> bool:
        return a == b or any(leads(c, b) for c in after.get(a, ()))

    return sorted(
        (a, b) for a, b in edges if not any(c != b and leads(c, b) for c in after[a])
    )  # fmt: skip


if __name__ == "__main__":
    main()
