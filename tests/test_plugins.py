"""Registries: three verbs, names that are taken once, and what plug-ins may do wrong."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from ambinav import plugins
from ambinav.plugins import Registry
from ambinav.runtime.errors import InputError


@dataclass(frozen=True)
class Fruit:
    name: str


APPLE, PEAR = Fruit("apple"), Fruit("pear")
GROUP = "ambinav.fruits"


def fruits() -> Registry[Fruit]:
    own = {"apple": f"{__name__}:APPLE", "pear": f"{__name__}:PEAR"}
    return Registry("fruit", Fruit, GROUP, own)


@pytest.fixture(autouse=True)
def fresh() -> Iterator[None]:
    """No entry point is remembered."""
    plugins._entry_points.cache_clear()
    yield
    plugins._entry_points.cache_clear()


def install(folder: Path, name: str, code: str, points: str) -> None:
    """A distribution as pip leaves it, on a folder of the path."""
    (folder / f"{name.replace('-', '_')}.py").write_text(code)
    about = folder / f"{name.replace('-', '_')}-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(f"[{GROUP}]\n{points}\n")


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def test_register_names_get() -> None:
    registry = fruits()
    plum = Fruit("plum")
    assert registry.register(plum) is plum and registry.register(plum) is plum
    assert registry.names() == ("apple", "pear", "plum")
    assert registry.get("plum") is plum and registry.get("apple") == APPLE


def test_a_name_is_taken_once() -> None:
    registry = fruits()
    registry.register(Fruit("plum"))
    with pytest.raises(InputError, match="fruit 'plum': there is one of that name; choose another"):
        registry.register(Fruit("plum"))
    with pytest.raises(InputError, match="fruit 'pear': there is one of that name in ambinav;"):
        registry.register(Fruit("pear"))


def test_an_unknown_name_offers_the_nearest() -> None:
    with pytest.raises(InputError, match="there is no fruit 'aple'; did you mean apple"):
        fruits().get("aple")
    with pytest.raises(InputError, match="there is no fruit 'xyz'; choose from apple, pear"):
        fruits().get("xyz")


def test_an_entry_may_have_several_names() -> None:
    registry = Registry("word", str, GROUP, {}, names_of=str.split)
    registry.register("one two")
    assert registry.names() == ("one", "two") and registry.get("two") == "one two"


PLUG = f"from {__name__} import Fruit\nFIG = Fruit('fig')\n"


def test_an_installed_plug_in_is_found(site: Path) -> None:
    install(site, "fig-tree", PLUG, "fig = fig_tree:FIG")
    registry = fruits()
    assert registry.names() == ("apple", "pear", "fig")
    assert registry.get("fig") == Fruit("fig")
    with pytest.raises(InputError, match="there is one of that name in fig-tree"):
        registry.register(Fruit("fig"))


@pytest.mark.parametrize(
    ("code", "point", "message"),
    [
        ("import nothing_there", "fig = bad_tree:FIG", r"cannot be loaded \(ModuleNotFoundError"),
        ("", "fig = bad_tree:FIG", r"cannot be loaded \(AttributeError"),
        ("FIG = 1", "fig = bad_tree:FIG", "cannot be used .* of the type int, not Fruit"),
        (PLUG, "date = bad_tree:FIG", "has the name 'fig', not 'date'"),
    ],
)
def test_a_broken_plug_in_is_named(site: Path, code: str, point: str, message: str) -> None:
    install(site, "bad-tree", code, point)
    sys.modules.pop("bad_tree", None)
    registry = fruits()
    # Whoever does not ask for it does not mind.
    assert registry.get("apple") == APPLE
    with pytest.raises(InputError, match=message) as caught:
        registry.get(registry.names()[-1])
    assert str(caught.value).endswith("; fix or uninstall bad-tree.")
    assert "\n" not in str(caught.value)


def test_two_plug_ins_of_one_name_are_refused(site: Path) -> None:
    install(site, "fig-tree", PLUG, "fig = fig_tree:FIG")
    install(site, "other-tree", PLUG, "fig = other_tree:FIG")
    with pytest.raises(InputError, match="fruit 'fig' is both in fig-tree and in other-tree;"):
        fruits().names()
    (site / "other_tree-1.0.dist-info" / "entry_points.txt").write_text(
        f"[{GROUP}]\npear = other_tree:FIG\n"
    )
    plugins._entry_points.cache_clear()
    with pytest.raises(InputError, match="fruit 'pear' is both in ambinav and in other-tree;"):
        fruits().names()


FAILING = f"""\
from dataclasses import dataclass
from {__name__} import Fruit

@dataclass(frozen=True)
class Peeled(Fruit):
    peel: object

def peel():
    raise ZeroDivisionError("no\\nknife")

FIG = Peeled("fig", peel)
"""


def test_what_fails_within_is_named(site: Path) -> None:
    install(site, "poor-tree", FAILING, "fig = poor_tree:FIG")
    registry = fruits()
    fig: Any = registry.get("fig")
    with pytest.raises(InputError) as caught, registry.calling("fig"):
        fig.peel()
    assert str(caught.value) == (
        "fruit 'fig' of the plug-in poor-tree: peel failed (ZeroDivisionError: no knife, "
        "poor_tree.py line 9); fix it, or uninstall poor-tree."
    )
    assert isinstance(caught.value.__cause__, ZeroDivisionError)
    useless = r"what it gives cannot be used \(give a fig\); fix it,"
    with pytest.raises(InputError, match=useless), registry.calling("fig"):
        raise TypeError("give a fig")
    # What a user gave wrong is no fault of the plug-in.
    with pytest.raises(InputError, match="no"), registry.calling("fig"):
        raise InputError("no.")


def test_what_fails_within_our_own_is_our_fault() -> None:
    registry = fruits()
    with pytest.raises(KeyError), registry.calling("apple"):
        raise KeyError("apple")
    registry.register(Fruit("plum"))
    named = "fruit 'plum', registered by a module: what it gives"
    with pytest.raises(InputError, match=named), registry.calling("plum"):
        raise KeyError("plum")


def test_nothing_to_choose_from() -> None:
    with pytest.raises(InputError, match="no fruit 'fig'; install a plug-in that brings it"):
        Registry("fruit", Fruit, GROUP, {}).get("fig")
