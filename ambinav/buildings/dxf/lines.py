"""Lines of a CAD drawing by layer: blocks expanded, curves as chords."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Set
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from ezdxf import path as paths
from ezdxf.filemanagement import readfile

from ambinav.buildings.dxf.wide_lines import wide_outlines
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import ends_with

DEEPEST: Final = 32
"""Blocks within blocks; deeper ones contain themselves."""
MOST: Final = 1_000_000
"""Entities; a block of blocks can stand for any number."""
ABSENT: Final = "absent block"
"""Begins what is counted for a block of another file, or one that is not there."""
FARTHEST: Final = 1e12
"""No corner is so far from the origin, in any unit."""
_DRAWN: Final = (
    "LINE", "LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "SOLID", "TRACE",
    "3DFACE", "MLINE",
)  # fmt: skip
_WRITTEN: Final = ("TEXT", "MTEXT", "ATTRIB")


class Written(NamedTuple):
    """Text in a drawing: its layer, content and position x, y in the drawing's unit."""

    layer: str
    text: str
    at: tuple[float, float]


class Drawn(NamedTuple):
    """Drawn element.

    Attributes:
        layer: Layer of the entity; what is on layer 0 of a block is on the block's own.
        kind: Its type in DXF.
        paths: Corners of its outlines, each of shape (n, 2), in the drawing's unit.
        arc: Centre, start and end of an ARC, shape (3, 2).
    """

    layer: str
    kind: str
    paths: list[Floats]
    arc: Floats | None = None


def opened(path: Path) -> Any:
    """Open a DXF file and return its document.

    A damaged one is not repaired (`ezdxf.recover`): what it lacks may be a wall.

    Raises:
        InputError: it cannot be read.
    """
    try:
        document = readfile(path)
    except Exception as error:  # damaged files raise many kinds of errors
        reason = getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
        raise InputError(
            f"{path}: this cannot be read as a DXF file ({' '.join(reason.split()).rstrip('.')}); "
            "export it again."
        ) from error
    if not ends_with(path, b"EOF"):
        raise InputError(
            f"{path}: this DXF file is cut off (EOF is missing at its end); export it again."
        )
    return document


def drawn_in(
    where: str,
    document: Any,
    tolerance: float,
    skipped: Counter[str],
    texts: list[Written] | None = None,
) -> Iterator[Drawn]:
    """Yield all elements in the model space of a document, on visible layers.

    Args:
        where: The file.
        document: See `opened`.
        tolerance: How far chords may lie from curves, in the drawing's unit.
        skipped: Entities without lines (texts, hatches ...) are counted here by their type.
        texts: Texts are put here.

    Raises:
        InputError: a block contains itself.
    """
    hidden = {
        layer.dxf.name.casefold()
        for layer in document.layers
        if layer.is_off() or layer.is_frozen()
    }
    frozen = {layer.dxf.name.casefold() for layer in document.layers if layer.is_frozen()}
    everything = _expanded(where, document.modelspace(), None, 0, frozen, skipped)
    for count, (layer, entity) in enumerate(everything):
        if count >= MOST:
            raise InputError(f"{where}: its blocks hold over {MOST} entities; purge the drawing.")
        kind = entity.dxftype()
        if layer.casefold() in hidden or entity.dxf.get("invisible", 0):
            skipped[f"{kind} on hidden layers"] += 1
        elif kind in _DRAWN:
            outlines = [*_outlines(entity, tolerance)]
            if not all((np.abs(corners) < FARTHEST).all() for corners in outlines):
                raise InputError(
                    f"{where}: a {kind} on the layer {layer} has corners that are nowhere (nan, or "
                    f"beyond {FARTHEST:g}); correct the drawing."
                )
            outlines = [line for line in outlines if len(line) > 1 and np.ptp(line, axis=0).any()]
            if outlines:
                yield Drawn(layer, kind, outlines, _arc(entity) if kind == "ARC" else None)
            else:
                skipped[f"{kind} of no length"] += 1
        else:
            skipped[kind] += 1
            if kind in _WRITTEN and texts is not None:
                texts.append(_written(layer, entity))


def _expanded(
    where: str,
    entities: Iterable[Any],
    layer: str | None,
    depth: int,
    frozen: Set[str],
    skipped: Counter[str],
) -> Iterator[tuple[str, Any]]:
    """Yield entities and their layers, those of inserted blocks too.

    A block that is invisible, or inserted on a frozen layer, is hidden as a whole; on a layer that
    is off, only what takes its layer from it is.
    """
    if depth > DEEPEST:
        raise InputError(f"{where}: a block contains itself; purge or audit the drawing.")
    for entity in entities:
        layer_name = entity.dxf.get("layer", "0")
        layer_name = layer if layer is not None and layer_name == "0" else layer_name
        if entity.dxftype() == "INSERT":
            if layer_name.casefold() in frozen or entity.dxf.get("invisible", 0):
                skipped["INSERT on hidden layers"] += 1
                continue
            block = entity.block()
            if block is None or block.block.is_xref or block.block.is_xref_overlay:
                named = "" if block is None else f" ({block.block.dxf.get('xref_path', '')})"
                skipped[f"{ABSENT} {entity.dxf.name}{named}"] += 1
                continue
            # The tags of rooms are such.
            yield from ((layer_name, attribute) for attribute in entity.attribs)
            for insert in entity.multi_insert() if entity.mcount > 1 else (entity,):
                yield from _expanded(
                    where, insert.virtual_entities(), layer_name, depth + 1, frozen, skipped
                )
        else:
            yield layer_name, entity


def _written(layer: str, entity: Any) -> Written:
    aligned = entity.dxftype() != "MTEXT" and entity.dxf.get("halign", 0)
    point = entity.dxf.get("align_point", None) if aligned else None
    point = entity.dxf.insert if point is None else point
    if entity.dxftype() != "MTEXT":
        point = entity.ocs().to_wcs(point)
    return Written(layer, " ".join(entity.plain_text().split()), (point.x, point.y))


def _outlines(entity: Any, tolerance: float) -> Iterator[Floats]:
    if getattr(entity, "has_width", False):
        yield from wide_outlines(entity, tolerance)
        return
    apart = entity.dxftype() == "MLINE" or getattr(entity, "has_arc", False)
    for part in entity.virtual_entities() if apart else (entity,):
        # Paths have Bézier curves for arcs, which miss them by 0.3 mm a metre.
        curve = part if part.dxftype() in ("ARC", "CIRCLE") else None
        try:
            points = list((curve or paths.make_path(part)).flattening(tolerance))
        except (TypeError, ValueError, ZeroDivisionError):
            continue
        yield np.array([(p.x, p.y) for p in points], dtype=np.float64).reshape(-1, 2)


def _arc(arc: Any) -> Floats:
    centre = arc.ocs().to_wcs(arc.dxf.center)
    points = [(centre.x, centre.y), *((p.x, p.y) for p in (arc.start_point, arc.end_point))]
    return np.array(points, dtype=np.float64)


def swing(arc: Floats) -> tuple[float, float]:
    """Return the radius of a door's arc, in its unit, and its opening angle, radians, up to pi."""
    a, b = arc[1] - arc[0], arc[2] - arc[0]
    radius = float(np.hypot(*a))
    return radius, math.acos(max(-1.0, min(1.0, float(a @ b) / max(radius * radius, 1e-300))))
