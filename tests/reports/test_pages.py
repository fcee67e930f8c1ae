"""Common parts of written reports."""

from __future__ import annotations

from jinja2 import Environment

from ambinav.reports.pages import counted, list_items, listed


def test_a_list_in_markdown_becomes_one_in_html() -> None:
    text = "- **bad floor**: 3 m² in `a.geojson`.\n- A **wrong** one.\n"
    assert list_items(text) == (
        "<ul>\n<li><b>Bad floor</b>: 3 m² in <code>a.geojson</code>.</li>\n"
        "<li>A <b>wrong</b> one.</li>\n</ul>\n"
    )


def test_values_in_a_list_stay_escaped() -> None:
    page = Environment(autoescape=True)
    page.filters["list_items"] = list_items
    template = page.from_string("{% filter list_items %}- in **{{ name }}**{% endfilter %}")
    assert template.render(name="<i>") == "<ul>\n<li>in <b>&lt;i&gt;</b></li>\n</ul>\n"


def test_nouns_are_counted_and_listed() -> None:
    assert [counted(count, "post") for count in (0, 1, 2)] == ["0 posts", "1 post", "2 posts"]
    assert [listed(names) for names in (["a"], ["a", "b"], ["a", "b", "c"])] == [
        "a", "a and b", "a, b and c"
    ]  # fmt: skip
