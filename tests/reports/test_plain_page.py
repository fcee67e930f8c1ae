"""Reports without a map in a browser: narrow and wide, light and dark."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pytest
from jinja2 import ChoiceLoader, DictLoader, Environment, PackageLoader
from PIL import Image

COLUMNS = "".join(f'<th class="number">column {i}</th>' for i in range(12))
CELLS = "".join(f'<td class="number">{i}.123 m</td>' for i in range(12))
SQUARE = """data:image/svg+xml,<svg xmlns='http://www.w3.org/2000/svg' width='200' height='100'>\
<rect width='200' height='100' fill='{}'/></svg>"""
PICTURES = {"before": SQUARE.format("blue"), "after": SQUARE.format("red")}
REPORT = f"""{{% extends "plain.html.j2" %}}
{{% from "before_after.html.j2" import before_after %}}
{{% block title %}}A report{{% endblock %}}
{{% block body %}}<h1>{"a_long_name_of_a_scanner" * 6}</h1>
{{{{ before_after(pictures, ("Before: 37.3 m² bad", "After: 2.1 m² bad"), "Floor", "Here.") }}}}
<table><thead><tr><th>name</th>{COLUMNS}</tr></thead>
<tbody><tr><th class="name">scanner-with-a-long-name</th>{CELLS}</tr></tbody></table>
<p><code>{"0123456789abcdef" * 4}</code></p>
<pre>{"ambinav design scanners office.yaml " * 6}</pre>{{% endblock %}}"""


@pytest.mark.slow(kept=("390-dark", "768-light", "1280-dark"))
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 768, 1280])
def test_nothing_is_wider_than_the_page(
    chromium: Any, tmp_path: Path, width: int, scheme: str
) -> None:
    loader = ChoiceLoader([DictLoader({"report": REPORT}), PackageLoader("ambinav.reports")])
    (tmp_path / "report.html").write_text(
        Environment(loader=loader).get_template("report").render(pictures=PICTURES)
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

    slider = page.get_by_role("slider")
    for key, border in (("Home", 0), ("ArrowRight", 1), ("End", 100)):
        slider.press(key)
        shades = {at: shade(page, at) for at in (0.03, 0.25, 0.75, 0.97)}
        assert shades == {at: "red" if 100 * at > border else "blue" for at in shades}
    context.close()


def shade(page: Any, share: float) -> str:
    """The colour of the pictures that lie on one another, at this share of their width."""
    box = page.locator(".before-after img").first.bounding_box()
    shot = page.screenshot(
        clip={"x": box["x"] + share * box["width"] - 1, "y": box["y"] + 9, "width": 2, "height": 2},
        full_page=True,
    )
    with Image.open(io.BytesIO(shot)) as picture:
        red, _, blue = picture.convert("RGB").getpixel((0, 0))
    return "red" if red > blue else "blue"
