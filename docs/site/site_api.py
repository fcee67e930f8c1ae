"""Pages of the API: what the three packages offer, and what the documentation imports."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
from collections.abc import Iterator
from typing import Any

from site_links import DOCS, GENERATED, ROOT, write

PACKAGES = {
    "ambinav": "the map and what asks it",
    "ambinav_planners": "planners and OMPL's objective",
    "ambinav_envs": "Gymnasium environments and policies",
}
BLOCK = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)


def write_pages() -> None:
    """Write a page for each package, and their list."""
    shown = imported()
    for package, title in PACKAGES.items():
        module = importlib.import_module(package)
        names = {f"{package}.{name}" for name in getattr(module, "__all__", ())}
        names -= {f"{package}.__version__"}
        names |= {name for name in shown if name.partition(".")[0] == package}
        text = f"{package}: {title}"
        lines = [text, "=" * len(text), "", f".. automodule:: {package}", "   :no-members:", ""]
        written: set[int] = set()
        for name in sorted(names, key=lambda name: (name.count("."), name)):
            thing = _load(name)
            if inspect.ismodule(thing) or id(thing) in written:
                continue
            written.add(id(thing))
            lines += _directive(name, thing)
        write(GENERATED / "api" / f"{package}.rst", "\n".join(lines))
    lines = [
        "API",
        "===",
        "",
        "The public names of the packages, and all that the documentation imports.",
        "",
    ]
    lines += [".. toctree::", "   :titlesonly:", "", *(f"   {name}" for name in PACKAGES), ""]
    write(GENERATED / "api" / "index.rst", "\n".join(lines))


def imported() -> set[str]:
    """What the pages and the examples import of the packages, by full name."""
    found = set()
    pages = [ROOT / "README.md", *DOCS.glob("*.md"), *(DOCS / "howto").glob("*.md")]
    codes = [code for page in pages for code in BLOCK.findall(page.read_text(encoding="utf-8"))]
    codes += [path.read_text(encoding="utf-8") for path in (ROOT / "examples").glob("*.py")]
    for code in codes:
        found |= set(_imports(code))
    return found


def _imports(code: str) -> Iterator[str]:
    for node in ast.walk(ast.parse(code)):
        module = node.module if isinstance(node, ast.ImportFrom) else None
        if isinstance(node, ast.ImportFrom) and module and module.partition(".")[0] in PACKAGES:
            yield from (f"{module}.{alias.name}" for alias in node.names)


def _load(name: str) -> Any:
    module, _, last = name.rpartition(".")
    try:
        return getattr(importlib.import_module(module), last)
    except AttributeError:
        return importlib.import_module(name)


def _directive(name: str, thing: Any) -> list[str]:
    """How Sphinx is asked to document something, by what it is."""
    if inspect.isclass(thing):
        return [f".. autoclass:: {name}", "   :members:", "   :show-inheritance:", ""]
    if callable(thing):
        return [f".. autofunction:: {name}", ""]
    # Sphinx would show what its type says of itself.
    return [f".. py:data:: {name}", ""]


if __name__ == "__main__":
    print(*sorted(imported()), sep="\n")
