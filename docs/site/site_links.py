"""Links that hold in the repository, made to hold in the site."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
DOCS: Final = ROOT / "docs"
GENERATED: Final = DOCS / "_generated"
COPIED: Final = {
    ROOT / "CONTRIBUTING.md": "contributing.md",
    ROOT / "CHANGELOG.md": "changelog.md",
    ROOT / "configs" / "README.md": "configs.md",
    ROOT / "benchmarks" / "README.md": "benchmarks.md",
    ROOT / "examples" / "README.md": "examples.md",
    ROOT / "examples" / "ros2" / "README.md": "ros2.md",
    **{
        path: f"notebooks/{path.name}"
        for path in sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
    },
}
"""Pages from outside docs/, by the name that they have in `_generated`."""
RESULTS: Final = ROOT / "benchmarks" / "results"
LINK: Final = re.compile(r"(?<!\\)\]\((?!\w+:|#|/)([^)#\s]+)(#[^)\s]*)?\)")
"""The end of a Markdown link to a file, relative to the page."""


def relink(text: str, origin: Path, place: Path | None = None) -> str:
    """Lead links of a page to where the site has what they name.

    Pages become paths from the site's root; of a file that is no page MyST makes a download. The
    README is the site's first page, and folders are explained in CONTRIBUTING.

    Args:
        text: Markdown.
        origin: The file that the page is in the repository; links are relative to it.
        place: The file that Sphinx reads, where that is another one.
    """
    folder = (place or origin).parent

    def leading(found: re.Match[str]) -> str:
        target = (origin.parent / found[1]).resolve()
        anchor = found[2] or ""
        if target == ROOT / "README.md":
            return "](/index.md)"
        if target in COPIED:
            return f"](/_generated/{COPIED[target]}{anchor})"
        if target.parent == RESULTS and target.suffix == ".md":
            return f"](/_generated/results/{target.name}{anchor})"
        if target.is_relative_to(DOCS):
            return f"](/{target.relative_to(DOCS)}{anchor})"
        if target.is_dir():
            return "](/_generated/contributing.md)"
        return f"]({os.path.relpath(target, folder)})"

    return LINK.sub(leading, text)


def relink_notebook(text: str, origin: Path, place: Path) -> str:
    """Lead links of a notebook's texts to where the site has what they name; see `relink`."""
    notebook = json.loads(text)
    for cell in notebook["cells"]:
        if cell["cell_type"] == "markdown":
            cell["source"] = relink("".join(cell["source"]), origin, place)
    return json.dumps(notebook)


def write(path: Path, text: str) -> None:
    """Write a generated page, if it is not there as it is: Sphinx reads again what is newer."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def copy_pages() -> None:
    """Copy the pages from outside docs/, with their links set right, and list the reports."""
    for source, name in COPIED.items():
        place = GENERATED / name
        made = relink_notebook if source.suffix == ".ipynb" else relink
        write(place, made(source.read_text(encoding="utf-8"), source, place))
    reports = sorted(RESULTS.glob("*.md"))
    names = {path.name for path in reports} | {"index.md"}
    for path in (GENERATED / "results").glob("*.md"):
        if path.name not in names:
            path.unlink()  # of a report that is no more
    for source in reports:
        place = GENERATED / "results" / source.name
        write(place, relink(source.read_text(encoding="utf-8"), source, place))
    lines = [
        "# Reports",
        "",
        "What each benchmark wrote, as it stands in `benchmarks/results`.",
        "",
    ]
    lines += ["```{toctree}", ":titlesonly:", "", *(source.stem for source in reports), "```", ""]
    write(GENERATED / "results" / "index.md", "\n".join(lines))
