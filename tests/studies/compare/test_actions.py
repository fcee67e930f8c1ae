"""Actions that a comparison recommends."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

from ambinav.studies.compare.actions import actions
from ambinav.studies.compare.document import Document


def report(**routes: tuple[str, float, float, float, float]) -> Document:
    """A report on one pair: outcome, lost %, error, collided % and length of each route."""

    def figure(value: float) -> Any:
        return SimpleNamespace(value=SimpleNamespace(value=value))

    rows, verdicts = [], []
    for name, (outcome, lost, error, collided, length) in routes.items():
        figures = {"lost": lost, "error_p95": error, "collided": collided}
        rows.append(
            SimpleNamespace(
                pair="A", route=name, figures={key: figure(v) for key, v in figures.items()}
            )
        )
        parts = {"lost": outcome == "met", "error": outcome == "met", "walls": collided < 50}
        if name != "shortest":
            verdicts.append(
                SimpleNamespace(
                    route=name, outcome=outcome, effect="better", length_ratio=length, parts=parts
                )
            )
    pair = SimpleNamespace(baseline="shortest", routes=verdicts, text="")
    return cast(Document, SimpleNamespace(verdicts={"A": pair}, rows=rows, parameters={}))


SHORTEST = ("not met", 100.0, 2.0, 17.0, 1.0)


def test_of_better_routes_the_one_that_loses_least_is_named() -> None:
    """Not the shortest one; its collisions are stated."""
    first = actions(
        report(
            shortest=SHORTEST,
            short=("not met", 92.0, 1.0, 75.0, 1.01),
            careful=("not met", 67.0, 0.67, 20.0, 1.2),
        )
    )[0]
    assert first.title == "Consider careful on A"
    assert "Lost 67 instead of 100 %" in first.text
    assert "collided 20 instead of 17 %" in first.text
    assert "The criterion is missed by lost and error." in first.text


def test_of_routes_that_meet_the_criterion_the_shortest_is_named() -> None:
    first = actions(
        report(
            shortest=("not met", 100.0, 2.0, 0.0, 1.0),
            far=("met", 0.0, 0.1, 0.0, 1.09),
            near=("met", 10.0, 0.2, 0.0, 1.02),
        )
    )[0]
    assert first.title == "Drive near on A" and "collided" not in first.text
