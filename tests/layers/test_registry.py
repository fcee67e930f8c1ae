"""The registry: what there is, what a scanner cannot have, layers of one's own."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ambinav.layers.context import LayerContext
from ambinav.layers.registry import LAYERS, Layer, chosen_layers
from ambinav.map_building.build import build_map
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from tests.geometry import scenes


def to_the_right(context: LayerContext) -> dict[str, np.ndarray]:
    x, _ = context.points
    return {"to_the_right": context.spread(x)}


OWN = Layer(
    name="to_the_right", title="how far right", unit="m", source="ours", worse="high",
    compute=to_the_right,
)  # fmt: skip


@pytest.fixture
def own() -> Iterator[Layer]:
    yield LAYERS.register(OWN)
    LAYERS._registered.pop(OWN.name)


@pytest.fixture(scope="module")
def sonar() -> RangeScanner:
    sensor = RangeSensor(max_range=2.0, std=0.03, resolution=0.01, aperture=math.radians(30.0))
    return RangeScanner.ring(sensor, 8, 0.2, name="eight sonars")


def test_the_names_lead_to_the_layers() -> None:
    for name in ("fisher", "localizability", "wall_normals", "clearance"):
        assert name in LAYERS.names()
        assert LAYERS.get(name).name == name


def test_the_page_tells_every_layer() -> None:
    page = (Path(__file__).parents[2] / "docs/layers.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \[`(\w+)`\]\(#(\w+)\) \| (\S.*?) \| (high|low) \|", page, re.MULTILINE)
    assert {name for name, *_ in rows} == set(LAYERS.names())
    for name, anchor, unit, worse in rows:
        plain = unit.translate(str.maketrans({"²": "^2", "⁴": "^4"}))
        assert (LAYERS.get(name).unit, LAYERS.get(name).worse) == (plain, worse)
        assert anchor == name
        assert f"\n## {name}\n" in page


@pytest.mark.parametrize(
    ("name", "offer"), [("fischer", "did you mean fisher"), ("xyz", "choose from aliasing, ")]
)
def test_an_unknown_name_offers_the_nearest(name: str, offer: str) -> None:
    with pytest.raises(InputError, match=offer):
        LAYERS.get(name)


def test_a_scanner_that_cannot_have_a_layer_is_refused_with_the_reason(sonar: RangeScanner) -> None:
    with pytest.raises(InputError, match=r"'eight sonars' cannot .*_normals: .* need a laser"):
        chosen_layers(["fisher", "wall_normals"], sonar)


def test_all_leaves_out_what_cannot_be_and_what_is_slow(
    sonar: RangeScanner, laser: RangeScanner, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        LAYERS, "_own",
        {k: v for k, v in LAYERS._own.items() if k in ("fisher", "wall_normals")},
    )  # fmt: skip
    monkeypatch.setitem(LAYERS._registered, "idle", replace(OWN, name="idle", slow=True))
    assert [one.name for one in chosen_layers("all", laser)] == ["fisher", "wall_normals"]
    assert [one.name for one in chosen_layers("all", sonar)] == ["fisher"]
    assert [one.name for one in chosen_layers(["idle", "idle"], sonar)] == ["idle"]


def test_a_layer_of_ones_own(own: Layer, laser: RangeScanner) -> None:
    amap = build_map(scenes.room(3.0, 2.0), laser, 0.2, layers=["to_the_right"])
    assert amap.sample("to_the_right", 1.37, 1.01) == pytest.approx(1.37, abs=1e-6)
    assert amap.dataset["to_the_right"].attrs == {
        "long_name": "how far right", "units": "m", "source": "ours", "worse": "high"
    }  # fmt: skip


def test_a_name_is_taken_once(own: Layer) -> None:
    for other in (replace(OWN, unit="km"), replace(OWN, name="fisher")):
        with pytest.raises(InputError, match="there is one of that name"):
            LAYERS.register(other)
    assert LAYERS.register(own) is own


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": "Not a name"}, "lower-case"),
        ({"name": "level"}, "every map has a layer of that name"),
        ({"name": "mine_best"}, "_best is kept for summaries"),
        ({"companions": {"other": ("x", "m")}}, "must begin with to_the_right_"),
        ({"worse": "left"}, "give high or low"),
        ({"high_is_good": ("to_the_right_x",)}, "give names of companions"),
    ],
)
def test_names_that_cannot_be(changes: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(OWN, **changes)
