"""Template filling for a report in a single file: text first, then the map with its data."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ambinav.reports.page.single_file import page_parts
from ambinav.reports.pages import fill


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
        filters: Further filters by name, see `ambinav.reports.pages.fill`.
        values: Values for the template; a missing one is an error.
    """
    block, page = data["map"]["block"], page_parts(data)
    return fill(
        package, template, filters, "ambinav.reports.page", block=block, page=page, **values
    )
