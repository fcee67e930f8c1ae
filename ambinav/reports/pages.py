"""Common parts of written reports: templates, embedded pictures, formatted values."""

from __future__ import annotations

import base64
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from ambinav.reports.number_text import FILTERS


def fill(
    package: str,
    template: str,
    filters: Mapping[str, Callable[..., str]],
    shared: str = "ambinav.reports",
    **values: object,
) -> str:
    """Fill a template of a package's folder templates, which may build on those of `shared`.

    Args:
        package: Such as "ambinav.studies.audit".
        template: Name of the file; in one that ends in .html.j2 all values are escaped.
        filters: Further filters by name, besides `cell`, `moment`, `md`, `list_items` and those of
            `number_text`.
        shared: Package of the templates that it may build on.
        values: Values for the template; a missing one is an error.
    """
    is_html = template.endswith(".html.j2")
    templates = Environment(
        loader=ChoiceLoader([PackageLoader(package), PackageLoader(shared)]),
        autoescape=is_html,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    common_filters = {**FILTERS, "cell": cell, "moment": moment, "list_items": list_items}
    # In a page all values are escaped already, also in parts that are Markdown.
    templates.filters.update({**common_filters, "md": str if is_html else escape_cell, **filters})
    return templates.get_template(template).render(**values)


def data_uri(path: Path) -> str:
    """Encode a PNG or SVG as a data URI, so that a page needs no other file."""
    kind = {".png": "png", ".svg": "svg+xml"}[path.suffix]
    return f"data:image/{kind};base64," + base64.b64encode(path.read_bytes()).decode("ascii")


def cell(value: object) -> str:
    """Format a parameter for a table."""
    if value is None:
        return "default"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict):
        return ", ".join(f"{key} {_nested_value(entry)}" for key, entry in value.items())
    if isinstance(value, list | tuple):
        parts = any(isinstance(entry, dict) for entry in value)
        return ("; " if parts else ", ").join(map(cell, value))
    return str(value)


def escape_cell(text: str) -> str:
    """Escape a user's text for a table in Markdown: no bar ends a cell, no tag opens."""
    return text.replace("|", "\\|").replace("<", "&lt;").replace("\n", " ")


def list_items(text: str) -> Markup:
    """Convert a list in Markdown to HTML, so that both reports have the same sentences.

    Args:
        text: Lines that begin with "- ", with **bold** and `code`; values in it are escaped. An
            item that begins in bold gets a capital.
    """
    html = re.sub(r"^- \*\*(.)", lambda start: f"- **{start[1].upper()}", text, flags=re.MULTILINE)
    html = re.sub(r"\*\*(.*?)\*\*", r"<b>\1</b>", html)
    html = re.sub(r"`(.*?)`", r"<code>\1</code>", html)
    items = re.sub(r"^- (.*)$", r"<li>\1</li>", html.strip(), flags=re.MULTILINE)
    return Markup(f"<ul>\n{items}\n</ul>\n")


def counted(count: int, noun: str) -> str:
    """Format a number with its noun."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def listed(names: Sequence[str]) -> str:
    """List names in a sentence: "a, b and c"."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def moment(created: str) -> str:
    """Format a UTC time: day, hour and minute."""
    return created[:16].replace("T", " ") + " UTC" if created.endswith("+00:00") else created


def _nested_value(value: object) -> str:
    """Format a value of a mapping, in which a comma ends the value."""
    return f"({cell(value)})" if isinstance(value, list | tuple | dict) else cell(value)
