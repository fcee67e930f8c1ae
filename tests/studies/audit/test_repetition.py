"""Rows of equal parts behind aliased pairs are found in any order, and only where there are any."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from ambinav.studies.audit.aliased_pairs import AliasedPair
from ambinav.studies.audit.repetition import WITHIN, find_repetitions

NONE = np.empty((0, 2))


def pairs(places: list[complex], letter: str = "A", turn: float = 0.0) -> list[AliasedPair]:
    """The first place with each of the others."""
    start = places[0]
    return [
        AliasedPair(letter, start.real, start.imag, end.real, end.imag, turn, 0.9, 2.0, NONE, NONE)
        for end in places[1:]
    ]


@pytest.mark.slow
@example(count=9, period=2.0, direction=0.0, seed=97)
@given(
    count=st.integers(3, 9),
    period=st.floats(1.5, 12.0),
    direction=st.floats(0.0, math.pi),
    seed=st.integers(0, 99),
)
def test_a_row_is_found(count: int, period: float, direction: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    step = period * complex(math.cos(direction), math.sin(direction))
    off = rng.uniform(-0.05, 0.05, (2, count)).T @ (1.0, 1.0j)
    places = complex(*rng.uniform(-20.0, 20.0, 2)) + step * rng.permutation(count) + off
    (row,) = find_repetitions(pairs(places.tolist()))
    assert row.count == count
    assert row.period_m == pytest.approx(period, abs=0.1)
    turned = (math.radians(row.direction_deg) - direction + math.pi / 2) % math.pi - math.pi / 2
    assert abs(turned) < 0.1 / period + math.radians(0.6)


def test_what_is_no_row() -> None:
    """Two places; three of which one stands off; turned ones; far multiples by chance."""
    assert find_repetitions([]) == ()
    assert find_repetitions(pairs([0j, 4 + 0j])) == ()
    assert find_repetitions(pairs([0j, 4 + 0j, 8 + 2.1j * WITHIN])) == ()
    assert find_repetitions(pairs([0j, 4 + 0j, 8 + 0j], turn=math.pi)) == ()
    assert find_repetitions(pairs([0j, 2 + 0j, 14 + 0j, 33 + 0j])) == ()


def test_letters_have_rows_of_their_own() -> None:
    first = pairs([0j, 2.7j, 5.4j, 8.1j, 40 + 3j])
    other = pairs([9 + 0j, 12 + 0j], "B")
    (row,) = find_repetitions([*first, *other])
    assert (row.letter, row.count) == ("A", 4)
    assert row.sentence == (
        "A repeats: 4 equal parts of the building stand in a row, 2.7 m apart, "
        "at 90° from the x axis."
    )
