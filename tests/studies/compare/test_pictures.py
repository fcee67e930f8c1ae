"""Names and formats of the pictures in reports."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from ambinav.cli import app
from ambinav.studies.compare.report import STUDY


@pytest.mark.parametrize(
    ("name", "ours"),
    [
        ("overview.png", True),
        ("overview.svg", True),
        ("floor-01-lobby-to-store.svg", True),
        ("errors-02-across.png", True),
        ("overview.pdf", False),
        ("holiday.png", False),
        ("spread-01", False),
    ],
)
def test_only_our_own_pictures_are_replaced(name: str, ours: bool) -> None:
    assert STUDY.is_picture(name) is ours


@pytest.mark.parametrize(
    "arguments",
    [
        ("audit", "office.yaml", "-s", "hokuyo-urg-04lx"),
        ("compare", "scenario.yaml"),
        ("benchmark",),
    ],
)
def test_unknown_formats_are_one_sentence_and_status_2(arguments: tuple[str, ...]) -> None:
    result = CliRunner().invoke(app, [*arguments, "-o", "out", "--pictures", "gif"])
    assert result.exit_code == 2, result.output
    assert (
        result.stderr
        == "ambinav: error: --pictures: 'gif' is not a picture format; give png or svg.\n"
    )
