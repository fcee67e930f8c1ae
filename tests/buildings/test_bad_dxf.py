"""Drawings that are no plans, damaged ones, and options of no use: a sentence each."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
import shapely
import shapely.affinity

from ambinav.buildings.load import load_environment
from ambinav.runtime.errors import InputError, InputWarning
from tests.buildings.test_dxf import TABLE, Draw, lines, loaded, rectangle, room, written


def blocks_only(space: Any) -> None:
    room(space.doc.blocks.new("room"))


def endless(space: Any) -> None:
    block = space.doc.blocks.new("loop")
    block.add_blockref("loop", (1, 1))
    space.add_blockref("loop", (0, 0))


def nan_corner(space: Any) -> None:
    room(space)
    lines(space, "Walls", (1.0, 1.0, math.nan, 2.0))


def only_elsewhere(space: Any) -> None:
    space.doc.add_xref_def("columns.dxf", "XR")
    space.add_blockref("XR", (0, 0))


def test_what_lies_in_another_file_is_named(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        room(space)
        only_elsewhere(space)
        space.add_blockref("NONE", (0, 0))

    with pytest.warns(InputWarning, match=r"absent block NONE, 1 absent block XR \(columns\.dxf\)"):
        env = loaded(tmp_path, draw)
    assert "1 absent block NONE" in env.notes[-1]


@pytest.mark.parametrize(
    ("draw", "said"),
    [
        (blocks_only, "blocks are inserted nowhere with no lines in the model space"),
        (lambda space: None, "no lines in the model space"),
        (
            lambda space: space.add_text("hello"),
            "beside 1 TEXT it holds no lines in the model space",
        ),
        (nan_corner, "a LINE on the layer Walls has corners that are nowhere"),
        (only_elsewhere, r"beside 1 absent block XR \(columns.dxf\) it holds no lines"),
        (endless, "a block contains itself"),
        (lambda space: rectangle(space, TABLE, "Furniture"), "holds walls by its name"),
        (lambda space: rectangle(space, shapely.box(0, 0, 6, 0.3), "Walls"), "no floor is left"),
    ],
)
def test_what_is_no_plan_is_refused_in_one_sentence(draw: Draw, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said) as refused:
        loaded(tmp_path, draw)
    assert "plan.dxf" in str(refused.value)
    assert str(refused.value).count(". ") == 0


@pytest.mark.parametrize(
    "content", [b"", b"AC1027\0\0\0", b"hello\nworld\n", b"  0\nSECTION\n  2\nENTITIES\n  0\nLI"]
)
def test_what_is_no_drawing_is_refused_in_one_sentence(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "plan.dxf"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"plan\.dxf: "):
        load_environment(path)
    with pytest.raises(InputError, match="No such file"):
        load_environment(tmp_path / "none.dxf")


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8, 0.95, 0.999])
def test_a_drawing_that_is_cut_off_is_refused(share: float, tmp_path: Path) -> None:
    """Also behind the end of an entity or a section."""
    path = written(tmp_path / "plan.dxf", room)
    text = path.read_text()
    end = int(share * len(text))
    for mark in ("", "\n  0\n", "\nENDSEC\n"):
        path.write_text(text[: text.rfind(mark, 0, end) + len(mark)] if mark else text[:end])
        with pytest.raises(InputError, match=r"plan\.dxf: this .*export it again"):
            load_environment(path)


@pytest.mark.parametrize("damage", [("\n  0\nEOF\n", "\n"), ("$DIMTXT\n 40\n", "$DIMTXT\n 40\nx")])
def test_a_damaged_drawing_is_refused_and_not_repaired(
    damage: tuple[str, str], tmp_path: Path
) -> None:
    path = written(tmp_path / "plan.dxf", room)
    text = path.read_text()
    path.write_text(text.replace(*damage, 1))
    assert path.read_text() != text
    with pytest.raises(InputError, match=r"this cannot be read as a DXF file \(.*export it again"):
        load_environment(path)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"doors": "ajar"}, "doors is 'ajar'"),
        ({"glass": 3}, "glass is 3"),
        ({"unit": "yard"}, "unit is 'yard'; it must be m, cm, mm, in, ft"),
        ({"level": 1}, "level means nothing for a CAD drawing"),
        ({"height": 0.2}, "height means nothing for a CAD drawing"),
    ],
)
def test_options_of_no_use_are_refused(options: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        loaded(tmp_path, room, **options)
