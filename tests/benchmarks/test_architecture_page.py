"""What is counted of a working tree, and what of its arrows is drawn."""

from __future__ import annotations

import shutil
from pathlib import Path

import architecture
import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def tree(tmp_path: Path) -> architecture.Tree:
    cost = "def cost():\n    from ambinav.cli import plan\n    return plan\n"
    plan = "from ambinav.service import service\nfrom ambinav.maps import schema\n"
    files = {
        "runtime/errors": "class InputError(ValueError):\n    pass\n",
        "maps/schema": "import ambinav.runtime.errors\n\n\ndef check(a, b, *, c):\n    pass\n",
        "service/service": cost,
        "cli/plan": plan,
    }
    for name, text in files.items():
        path = tmp_path / f"ambinav/{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (tmp_path / "benchmarks").mkdir()
    shutil.copy(ROOT / architecture.FLOOR_TABLE, tmp_path / architecture.FLOOR_TABLE)
    return architecture.count(tmp_path, "here")


def test_lines_files_and_functions_are_counted(tree: architecture.Tree) -> None:
    assert tree.lines["maps"] == 5 and tree.files["maps"] == 1
    assert tree.longest == (3, "`cost` in ambinav/service/service.py")
    assert tree.widest == (3, "`check` in ambinav/maps/schema.py")


def test_an_arrow_up_is_found_within_a_function(tree: architecture.Tree) -> None:
    assert architecture.upward(tree) == {("service", "cli"): 1}


def test_arrows_that_follow_from_others_are_not_drawn() -> None:
    edges = {("a", "b"), ("b", "c"), ("a", "c"), ("a", "d")}
    assert architecture._without_detours(edges) == [("a", "b"), ("a", "d"), ("b", "c")]


def test_the_page_has_the_lines_to_write_between() -> None:
    page = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    assert page.index(architecture.BEGIN) < page.index(architecture.END)
