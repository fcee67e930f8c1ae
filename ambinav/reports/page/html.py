"""Template filling for a report in a single file: text first, then the map with its data."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

from ambinav.reports.page.single_file import page_parts
from ambinav.reports.pages import cell, moment


def fill_page(
    package: str,
    template: str,
    data: Mapping[str, Any],
    filters: Mapping[str, Callable[..., str]],
    **values: object,
) -> str:
    """Fill a template that extends `base.html.j2`; all values are escaped.

    Args:
        package: Package whose folder templates contains the template, such as
            "ambinav.studies.audit".
        template: Name of the file.
        data: Map data of the page, see `ambinav.reports.page.map_data`.
        filters: Further filters by name, besides `cell` and `moment`.
        values: Values for the template; a missing one is an error.
    """
    templates = Environment(
        loader=ChoiceLoader([PackageLoader(package), PackageLoader("ambinav.reports.page")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    templates.filters.update({"cell": cell, "moment": moment, **filters})
    return templates.get_template(template).render(page=page_parts(data), **values)
