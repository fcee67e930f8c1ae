"""Pages of the API: what the public modules offer."""

from __future__ import annotations

import importlib
import inspect
from typing import Any

from site_links import GENERATED, write

MODULES = {
    "ambinav": "maps, routes, drives and studies",
    "ambinav.plugin": "what plug-ins of the core are made of",
    "ambinav_planners": "planners and OMPL's objective",
    "ambinav_planners.plugin": "what planners of other packages are made of",
    "ambinav_envs": "Gymnasium environments and policies",
    "ambinav_envs.plugin": "what rewards and observations of other packages are made of",
}


def write_pages() -> None:
    """Write a page for each module, and their list."""
    for name, about in MODULES.items():
        module = importlib.import_module(name)
        title = f"{name}: {about}"
        lines = [title, "=" * len(title), "", f".. automodule:: {name}", "   :no-members:", ""]
        for public in module.__all__:
            if public != "__version__":
                lines += _directive(f"{name}.{public}", getattr(module, public))
        write(GENERATED / "api" / f"{name}.rst", "\n".join(lines))
    lines = [
        "API",
        "===",
        "",
        "The public names: what semantic versioning covers, see :doc:`/_generated/contributing`.",
        "",
    ]
    lines += [".. toctree::", "   :titlesonly:", "", *(f"   {name}" for name in MODULES), ""]
    write(GENERATED / "api" / "index.rst", "\n".join(lines))


def _directive(name: str, thing: Any) -> list[str]:
    """How Sphinx is asked to document something, by what it is."""
    if "\n|--" in (inspect.getdoc(thing) or ""):
        # Markdown: `NavigationEnv`, whose docstring is a page of its own.
        common = "See :doc:`/_generated/environments/common`."
        return [f".. py:class:: {name}", "", f"   {common}", ""]
    if inspect.isclass(thing):
        return [f".. autoclass:: {name}", "   :members:", "   :show-inheritance:", ""]
    if callable(thing):
        return [f".. autofunction:: {name}", ""]
    # Sphinx would show what its type says of itself.
    return [f".. py:data:: {name}", ""]
