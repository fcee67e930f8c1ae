"""NumPy file with all layers of a map, and a description of each."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np

from ambinav.export.options import MapExport
from ambinav.export.registry import Exporter
from ambinav.maps.judged_floor import LAYER as JUDGED
from ambinav.maps.judged_floor import REASONS
from ambinav.maps.zones import ZONES

HEAD: Final = """\
# Arrays in {name}

{title}. Read them with `numpy.load("{name}")`; nothing in it is pickled.

Row 0 of a layer is the smallest y, column 0 the smallest x; metres and radians, in the map frame.
`x` and `y` are the centres of the cells, `theta` (where the map has headings) the robot's headings.
Layers of numbers are nan where a robot cannot stand; `zone` and `judged` are 255 there.
Zones: {zones}.
Figures are of the floor where `judged` is 0; elsewhere it says why a cell is not counted:
{reasons}.

| array | shape | type | unit | meaning |
|---|---|---|---|---|
"""


def write(export: MapExport, path: Path) -> tuple[Path, ...]:
    """Write layers, coordinates, walls and the attributes of the map (as JSON text)."""
    dataset = export.amap.dataset
    arrays: dict[str, Any] = {
        str(name): dataset[name].values for name in ("y", "x", "theta") if name in dataset.coords
    }
    arrays |= {name: dataset[name].values for name in export.amap.layers}
    arrays[JUDGED] = export.amap.judged.code
    arrays |= {name: dataset[name].values for name in ("segments", "segment_kind")}
    arrays["attributes"] = np.array(json.dumps({k: str(v) for k, v in dataset.attrs.items()}))
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)
    about = path.with_name(f"{path.stem}_README.md")
    zones = ", ".join(f"{code} {name}" for code, name in enumerate(ZONES))
    reasons = ", ".join(f"{code} {reason}" for code, reason in enumerate(REASONS) if code)
    title = dataset.attrs.get("title", "A map")
    lines = [HEAD.format(name=path.name, title=title, zones=zones, reasons=reasons)]
    for name, values in arrays.items():
        attrs = dataset[name].attrs if name in dataset else {}
        unit, meaning = attrs.get("units", ""), attrs.get("long_name", _meaning(name))
        lines.append(f"| `{name}` | {values.shape} | {values.dtype} | {unit} | {meaning} |\n")
    about.write_text("".join(lines), encoding="utf-8")
    return path, about


def _meaning(name: str) -> str:
    return {
        "x": "centres of the cells, metres",
        "y": "centres of the cells, metres",
        "theta": "headings of the robot, radians",
        "segments": "walls and frontiers: ax, ay, bx, by, metres",
        "segment_kind": "0: wall, 1: frontier to unknown space, 2: reflector, 3: glass",
        "attributes": "where the map comes from, JSON text",
    }.get(name, "")


NPZ: Final = Exporter(
    subject="map",
    format="npz",
    title="all layers as NumPy arrays, with a description of each",
    reader="numpy.load, and every program that reads .npy",
    write=write,
    suffixes=(".npz", "_README.md"),
)
