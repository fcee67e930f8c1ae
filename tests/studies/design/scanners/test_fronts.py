"""Pareto fronts against the definition, spelt out pair by pair."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambinav.runtime.errors import InputError
from ambinav.studies.design.scanners.fronts import Front

FIGURE = st.integers(0, 6).map(float)


@pytest.mark.slow
@given(st.lists(st.tuples(FIGURE, FIGURE), min_size=1, max_size=9), st.randoms())
def test_dominated_is_who_has_a_better_one(figures, random):
    values = [(f"scanner {i}", bad, cost) for i, (bad, cost) in enumerate(figures)]
    shuffled = random.sample(values, len(values))
    front = Front.of("price", "price", "", shuffled)
    assert front == Front.of("price", "price", "", values)  # the order plays no part
    for name, bad, cost in values:
        better = {
            other
            for other, b, c in values
            if b <= bad and c <= cost and (b < bad or c < cost)
        }  # fmt: skip
        point = front.point(name)
        assert point is not None and (point.bad_area, point.against) == (bad, cost)
        assert (point.dominated_by in better) if better else (point.dominated_by is None)
    steps = [(one.against, one.bad_area) for one in front.best]
    assert steps == sorted(steps) and [b for _, b in steps] == sorted((b for _, b in steps))[::-1]


def test_equal_ones_do_not_dominate_each_other_and_rounding_is_no_difference():
    third = [("a", 0.1 + 0.2, 3.0), ("b", 0.3, 3.0), ("c", 0.3, 3.1)]
    front = Front.of("beams", "beams", "", third)
    assert [one.name for one in front.best] == ["b", "a"]
    assert front.point("c").dominated_by == "b"
    assert front.point("d") is None


def test_no_scanner_is_no_front():
    with pytest.raises(InputError, match="price: no scanner has a figure"):
        Front.of("price", "price", "", [])
