"""The public modules: what is offered can be had, and documentation and examples take no more."""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from ambinav.runtime.exports import homes

ROOT = Path(__file__).parents[1]
CLIENT = ROOT / "tests" / "public_client.py"
PACKAGES = ("ambinav", "ambinav_planners", "ambinav_envs")
MODULES = (*PACKAGES, *(f"{package}.plugin" for package in PACKAGES))
BLOCK = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)
SOURCES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *(page for page in ROOT.glob("docs/**/*.md") if "_generated" not in page.parts),
    *ROOT.glob("examples/**/*.md"),
    *ROOT.glob("examples/**/*.py"),
    *ROOT.glob("examples/notebooks/*.ipynb"),
    *ROOT.glob("tests/stranger/plugin/*.py"),
    CLIENT,
]
PATHS = os.pathsep.join(str(ROOT / part) for part in ("", "envs", "planners"))


@pytest.fixture(params=MODULES)
def name(request: pytest.FixtureRequest) -> str:
    """One of the public modules, whose packages are installed."""
    if request.param.startswith("ambinav_envs"):
        pytest.importorskip("gymnasium")
    return str(request.param)


def code_of(path: Path) -> str:
    """The Python of a page or a notebook, or a whole module."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".ipynb":
        cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
        return "\n".join("".join(cell["source"]) for cell in cells)
    return "\n".join(BLOCK.findall(text)) if path.suffix == ".md" else text


def used(code: str) -> Iterator[tuple[str, str]]:
    """Module and name of all that code takes of the packages, by `import` and by attribute."""
    tree = ast.parse(code)
    modules = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.partition(".")[0] in PACKAGES:
                    modules[alias.asname or alias.name] = alias.name
                    yield alias.name, "__all__"
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in PACKAGES:
            yield from ((str(node.module), alias.name) for alias in node.names)
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) in modules:
            yield modules[ast.unparse(node.value)], node.attr


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_nothing_else_is_used(path: Path) -> None:
    for module, name in set(used(code_of(path))):
        assert module in MODULES, f"from {module} import {name}"
        assert name == "__all__" or name in importlib.import_module(module).__all__


def test_what_code_uses_is_found() -> None:
    code = "import ambinav as an\nfrom ambinav.maps import schema\nan.build_map(), an.x.y"
    assert {*used(code)} == {
        ("ambinav", "__all__"),
        ("ambinav.maps", "schema"),
        ("ambinav", "build_map"),
        ("ambinav", "x"),
    }


def test_every_name_can_be_had_and_is_described(name: str) -> None:
    module = importlib.import_module(name)
    places = homes(inspect.getsource(module))
    assert set(places) == set(module.__all__)
    for public, place in places.items():
        value = getattr(module, public)
        if inspect.isclass(value) or inspect.isfunction(value):
            # From where it is defined, not from a module that happens to import it.
            assert value.__module__ == place, public
            assert value.__doc__, public
        else:
            assert public in described(inspect.getsource(sys.modules[place])), (place, public)


def described(source: str) -> set[str]:
    """Names of a module that are assigned to and have a string below, one for several in a row."""
    found: set[str] = set()
    row: set[str] = set()
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            row |= {target.id for target in targets if isinstance(target, ast.Name)}
        else:
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                found |= row
            row = set()
    return found


def test_dir_shows_what_is_public_and_no_more(name: str) -> None:
    module = importlib.import_module(name)
    assert dir(module) == sorted(module.__all__)


def test_no_name_is_offered_twice() -> None:
    for package in PACKAGES:
        if package == "ambinav_envs":
            pytest.importorskip("gymnasium")
        user, author = (importlib.import_module(one) for one in (package, f"{package}.plugin"))
        assert not set(user.__all__) & set(author.__all__)


def check(*command: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", *command, str(CLIENT)],
        env={**os.environ, "MYPYPATH": PATHS, "PYTHONPATH": PATHS},
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.sweep
def test_a_client_passes_mypy() -> None:
    # Without this repository's settings, by which `make types` checks it; with a cache of its own.
    alone = ("--config-file=", "--follow-imports=silent", "--cache-dir=.mypy_cache/client")
    check("mypy", "--strict", *alone)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("node") is None, reason="pyright runs on Node.js")
def test_a_client_passes_pyright() -> None:
    check("pyright", "--pythonpath", sys.executable)
