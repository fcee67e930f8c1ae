"""Accessibility by axe-core, which lies in the folder axe with its licence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

SCRIPT = Path(__file__).parent / "axe" / "axe.min.js"


def violations(page: Any) -> list[str]:
    """What axe-core finds wrong with a page by WCAG 2.2 AA and best practice, in lines.

    The page's context must bypass its content policy, since the script is none of its own.
    """
    page.evaluate(SCRIPT.read_text(encoding="utf-8"))
    found = page.evaluate("() => axe.run(document, {resultTypes: ['violations']})")
    return [
        f"{one['id']}: {node['target']} {node['failureSummary']}"
        for one in found["violations"]
        for node in one["nodes"]
    ]
