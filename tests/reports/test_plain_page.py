"""Reports without a map in a browser: narrow and wide, light and dark."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from jinja2 import ChoiceLoader, DictLoader, Environment, PackageLoader

COLUMNS = "".join(f'<th class="number">column {i}</th>' for i in range(12))
CELLS = "".join(f'<td class="number">{i}.123 m</td>' for i in range(12))
REPORT = f"""{{% extends "plain.html.j2" %}}
{{% block title %}}A report{{% endblock %}}
{{% block body %}}<h1>{"a_long_name_of_a_scanner" * 6}</h1>
<table><thead><tr><th>name</th>{COLUMNS}</tr></thead>
<tbody><tr><th class="name">scanner-with-a-long-name</th>{CELLS}</tr></tbody></table>
<p><code>{"0123456789abcdef" * 4}</code></p>
<pre>{"ambinav design scanners office.yaml " * 6}</pre>{{% endblock %}}"""


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 768, 1280])
def test_nothing_is_wider_than_the_page(
    chromium: Any, tmp_path: Path, width: int, scheme: str
) -> None:
    loader = ChoiceLoader([DictLoader({"report": REPORT}), PackageLoader("ambinav.reports")])
    (tmp_path / "report.html").write_text(
        Environment(loader=loader).get_template("report").render()
    )
    context = chromium.new_context(
        viewport={"width": width, "height": 800}, color_scheme=scheme, bypass_csp=True
    )
    page = context.new_page()
    page.goto(f"file://{tmp_path}/report.html")
    sizes = page.evaluate(
        "() => [document.documentElement.scrollWidth, document.documentElement.clientWidth]"
    )
    assert sizes == [width, width]

    def ground() -> str:
        return str(page.evaluate("() => getComputedStyle(document.body).backgroundColor"))

    before = ground()
    assert before == {"light": "rgb(255, 255, 255)", "dark": "rgb(22, 23, 24)"}[scheme]
    page.get_by_role("button", name="Light or dark").click()
    after = ground()
    page.get_by_role("button", name="Light or dark").click()
    assert ground() == before != after
    context.close()
