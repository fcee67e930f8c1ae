"""Floor, notes and units of inputs, in this checkout and, for comparison, in another one.

- Plans of the data folder: square metres of floor.
- The storeys of institute.ifc and duplex.ifc that have walls of up to 0.6 m, drawn as DXF without
  doors: floor that is lost and invented beside what the IFC reader finds.
- Drawn plans, whose floor is known by construction (tests/buildings/drawn_plans.py): the same.
- Meshes, point clouds and OctoMaps of the data folder in metres, feet, inches and millimetres:
  whether anything is asked or warned about.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import ezdxf.filemanagement
import shapely
from harness import ROOT, add_out, environment_path, report, table

if str(ROOT) not in sys.path:
    sys.path.append(str(ROOT))
from ambinav.buildings.ifc.file import read_storey
from ambinav.buildings.load import load_environment
from ambinav.buildings.mesh.cloud import is_cloud, read_cloud
from ambinav.buildings.mesh.octomap import read_octomap
from ambinav.buildings.mesh.read import read_mesh
from ambinav.runtime.errors import InputError, InputWarning
from tests.buildings.drawn_plans import plans

FILES: list[tuple[str, dict[str, Any]]] = [
    ("barcelona_pavilion.dxf", {}),
    ("barcelona_pavilion_sheet.dxf", {"unit": "m"}),
    ("barcelona_pavilion.ifc", {}),
    *(("institute.ifc", {"level": level}) for level in range(5)),
    *(("duplex.ifc", {"level": level}) for level in range(4)),
]
STOREYS = (("institute", 0), ("institute", 1), ("institute", 2), ("institute", 3), ("duplex", 2))
UNITS = {"m": 1.0, "ft": 3.2808, "in": 39.37, "mm": 1000.0}


def main() -> None:
    """Measure this checkout, and another one in a separate process."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--before", type=Path, help="the other checkout")
    parser.add_argument("--json", action="store_true", help="print the figures alone")
    add_out(parser)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        after = measured(Path(folder))
    if options.json:
        print(json.dumps(after))
        return
    before: dict[str, dict[str, str]] = {}
    if options.before is not None:
        environment = {**os.environ, "PYTHONPATH": f"{options.before}"}
        words = [sys.executable, __file__, "--json"]
        done = subprocess.run(words, env=environment, check=True, capture_output=True, text=True)
        before = json.loads(done.stdout.splitlines()[-1])
    parts = [
        f"## {title}\n\n{side_by_side(before.get(title, {}), rows)}"
        for title, rows in after.items()
    ]
    report("What is read of inputs", ("shapely", "ezdxf"), "\n\n".join(parts), options.out)


def side_by_side(before: dict[str, str], after: dict[str, str]) -> str:
    """Return a table of two checkouts' cells; floor, lost and invented have separate columns."""
    if not any(", " in cell for cell in after.values()):
        pairs = [(name, before.get(name, ""), cell) for name, cell in after.items()]
        return table(("input", "before", "after"), pairs)
    rows = []
    for name, cell in after.items():
        floor, *now = cell.split(", ")
        then = before.get(name, "").split(", ")[1:]
        rows.append((name, floor, *_pair(then), *_pair(now)))
    header = ("input", "floor", "lost before", "invented before", "lost", "invented")
    return table(header, rows)


def _pair(off: list[str]) -> tuple[str, str]:
    return (off[0], off[-1]) if off else ("", "")


def measured(folder: Path) -> dict[str, dict[str, str]]:
    """Return the cells of the tables by their titles and the names of their rows."""
    data = environment_path("barcelona_pavilion").parent
    cells: dict[str, dict[str, str]] = {
        "Plans of the data folder, m² of floor": {
            f"{name} {options.get('level', '')}".strip(): floor_of(data / name, options)
            for name, options in FILES
        },
        "Storeys drawn as DXF, m² of floor (that of the IFC file), lost and invented": {
            f"{name} {level}": storey_row(data / f"{name}.ifc", level, folder)
            for name, level in STOREYS
        },
        "Drawn plans, m² of floor, lost and invented": {},
    }
    drawn = cells["Drawn plans, m² of floor, lost and invented"]
    for plan in plans():
        drawn[f"{plan.name}, {plan.style}"] = compared(
            plan.floor(), plan.write(folder / "plan.dxf")
        )
    wrong = sum(is_wrong(cell) for cell in drawn.values())
    cells["Drawn plans that are off by 1 % or more"] = {f"of {len(drawn)}": f"{wrong}"}
    cells["Units of 3D buildings, read as metres"] = {
        f"{path.name} in {unit}": asked(path, scale, folder)
        for path in sorted((data.parent / "mesh3d").iterdir())
        for unit, scale in UNITS.items()
    }
    return cells


def floor_of(path: Path, options: dict[str, Any]) -> str:
    """Return the square metres of floor."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return f"{load_environment(path, **options).free.area:.1f}"


def compared(floor: shapely.Geometry, path: Path) -> str:
    """Return the floor, and how much of it a file loses and invents, square metres."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            free = load_environment(path).free
        except InputError:
            return f"{floor.area:.1f}, refused"
    lost, invented = shapely.difference(floor, free).area, shapely.difference(free, floor).area
    return f"{floor.area:.1f}, {lost:.1f}, {invented:.1f}"


def is_wrong(cell: str) -> bool:
    """Return whether a floor is refused, or wrong by 1 % or more."""
    floor, *off = cell.split(", ")
    return off == ["refused"] or sum(map(float, off)) >= 0.01 * float(floor)


def storey_row(path: Path, level: int, folder: Path) -> str:
    """Draw a storey's section to a file, read it, and return the row."""
    plan = read_storey(
        path, level, height=0.3, doors="open", glass="solid", furniture=False
    )  # fmt: skip
    document = ezdxf.filemanagement.new("R2010")
    document.header["$INSUNITS"] = 6
    space = document.modelspace()
    solids = shapely.get_parts(shapely.union_all(list(plan.section.solids), grid_size=1e-6))
    shapes = {"Walls": [*solids, *plan.section.walls], "Glass": plan.section.panes}
    for layer, parts in shapes.items():
        for line in shapely.get_parts(
            shapely.geometrycollections(
                [shape if shape.geom_type == "LineString" else shape.boundary for shape in parts]
            )
        ):
            for part in shapely.get_parts(line):
                space.add_lwpolyline(list(part.coords), dxfattribs={"layer": layer})
    file = folder / "storey.dxf"
    document.saveas(file)
    return compared(plan.environment.free, file)


def asked(path: Path, scale: float, folder: Path) -> str:
    """Return whether the reader asks for the unit of a file with scaled numbers."""
    file = folder / path.name
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", InputWarning)
        try:
            if path.suffix == ".bt":
                content = path.read_bytes()
                res = re.search(rb"\nres (\S+)", content)
                assert res is not None
                edge = f"\nres {float(res[1]) * scale}".encode()
                file.write_bytes(content.replace(res[0], edge, 1))
                read_octomap(file)
            else:
                import trimesh

                mesh: Any = trimesh.load(path, process=False)
                mesh.apply_scale(scale)
                mesh.export(file)
                if is_cloud(file):
                    read_cloud(file, voxel=0.08 * scale)
                else:
                    read_mesh(file)
        except InputError:
            return "refused"
    return "warned" if any(warning.category is InputWarning for warning in caught) else "read"


if __name__ == "__main__":
    main()
