from __future__ import annotations

from collections import Counter

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ambinav.ambiguity.tensor import classify_over_headings
from ambinav.maps.zones import BAD, CORRIDOR, LOCALIZABLE, NOT_FREE, OPEN, TRANSITION

CODES = (LOCALIZABLE, TRANSITION, CORRIDOR, OPEN, NOT_FREE)


@given(st.lists(st.sampled_from(CODES), min_size=1, max_size=9))
def test_the_zone_of_a_place_is_that_of_most_headings(codes: list[int]) -> None:
    count = Counter(code for code in codes if code != NOT_FREE)
    zone = int(classify_over_headings(np.array([codes], dtype=np.uint8))[0])
    if not count:
        assert zone == NOT_FREE
        return
    is_bad = sum(count[code] for code in BAD) >= count.total() / 2
    assert (zone in BAD) == is_bad
    alike = [code for code in CODES[:4] if (code in BAD) == is_bad]
    assert zone == max(alike, key=lambda code: (count[code], code))


@given(st.lists(st.sampled_from(CODES), min_size=1, max_size=9))
def test_the_order_of_headings_does_not_matter(codes: list[int]) -> None:
    turned = codes[1:] + codes[:1]
    zones = classify_over_headings(np.array([codes, turned, codes[::-1]], dtype=np.uint8))
    assert len(set(zones.tolist())) == 1
