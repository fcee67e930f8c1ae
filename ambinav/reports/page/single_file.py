"""The page of a map in one HTML file: styles, modules and data, without external addresses."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from ambinav.reports.page.style import style_module

FOLDER: Final = Path(__file__).parents[2] / "server" / "page"
"""The page's files. They are read, not imported: the server needs packages that reports do not."""
ENTRY: Final = "report.js"
STYLES: Final = ("leaflet/leaflet.css", "base.css", "explorer.css", "report.css")
GENERATED: Final = "style.js"
"""Module of the page that is no file but made of the table of colours."""

_IMPORT: Final = re.compile(r'from "\./([\w-]+\.js)";')
POLICY: Final = (
    "default-src 'none'; script-src 'unsafe-inline' data:; style-src 'unsafe-inline'; "
    "img-src data: blob:"
)
"""Content policy of a report: only embedded content."""


@dataclass(frozen=True)
class PageParts:
    """HTML parts that a template inserts.

    Attributes:
        head: Policy and styles.
        scripts: Data, Leaflet and the modules, for the end of the body.
    """

    head: str
    scripts: str


def page_parts(data: Mapping[str, Any]) -> PageParts:
    """Return the parts of a page that shows `data` (see `ambinav.reports.page.map_data`)."""
    css = "\n".join((FOLDER / name).read_text(encoding="utf-8") for name in STYLES)
    # No pictures of Leaflet are used, and a report names no other file, not even in comments.
    css = re.sub(r"/\*.*?\*/", "", re.sub(r"url\([^)]*\)", "none", css), flags=re.DOTALL)
    leaflet = (FOLDER / "leaflet" / "leaflet.js").read_text(encoding="utf-8")
    leaflet = leaflet.rpartition("//# sourceMappingURL")[0] or leaflet
    imports = {f"page/{name}": _data_uri(text) for name, text in modules(ENTRY).items()}
    shown = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return PageParts(
        head=f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        f"<style>\n{css}\n</style>",
        scripts=f'<script type="application/json" id="ambinav-data">{shown}</script>\n'
        f"<script>{leaflet}</script>\n"
        f'<script type="importmap">{json.dumps({"imports": imports})}</script>\n'
        f'<script type="module">import "page/{ENTRY}";</script>',
    )


def modules(entry: str) -> dict[str, str]:
    """Return the text of a page module and of all that it imports, by name.

    Imports of "./name.js" are written "page/name.js", which an import map gives a meaning.
    """
    texts: dict[str, str] = {}
    waiting = [entry]
    while waiting:
        name = waiting.pop()
        if name in texts:
            continue
        text = style_module() if name == GENERATED else (FOLDER / name).read_text(encoding="utf-8")
        waiting += _IMPORT.findall(text)
        texts[name] = _IMPORT.sub(r'from "page/\1";', text)
    return texts


def _data_uri(text: str) -> str:
    encoded = base64.b64encode(text.encode("utf-8")).decode("ascii")
    return f"data:text/javascript;base64,{encoded}"
