"""Files of pictures: the same bytes each time, in each format."""

from __future__ import annotations

from pathlib import Path

import pytest

from ambinav.plotting.canvas import fit, new_figure, save_figure
from ambinav.plotting.style import FORMATS


@pytest.mark.parametrize("suffix", FORMATS)
def test_the_same_picture_is_the_same_file(tmp_path: Path, suffix: str) -> None:
    files = []
    for number in range(2):
        figure = new_figure(3, 2)
        axes = figure.subplots()
        axes.plot([0, 1], [1, 0], clip_on=True)
        files.append(tmp_path / f"{number}.{suffix}")
        save_figure(figure, files[-1])
    assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.slow
def test_dollar_signs_in_names_are_no_formula(tmp_path: Path) -> None:
    """Ticks of a logarithmic axis are formulas, also when the figure is saved again."""
    figure = new_figure(3, 2)
    axes = figure.subplots()
    axes.loglog([1, 1000], [1, 1000])
    axes.plot([1, 10], [1, 10], label=r"$\hall$")
    axes.set_xlabel(r"$\hall$")
    axes.set_title(r"$\hall$", loc="left")
    axes.legend()
    figure.suptitle(r"$\hall$")
    fit(axes)
    for _ in range(2):
        save_figure(figure, tmp_path / "picture.png")
    ticks = axes.get_xticklabels()
    assert any("$" in tick.get_text() for tick in ticks)
    assert all(tick.get_parse_math() for tick in ticks)
