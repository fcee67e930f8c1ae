"""Lines between aliased regions stay in their picture."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.patches import ConnectionStyle
from matplotlib.path import Path

from ambinav.plotting.aliasing import BENDS, _choose_bend
from ambinav.studies.audit.aliased_pairs import AliasedPair

BOX = (0.0, 0.0, 30.0, 4.0)
inside = st.tuples(st.floats(0.5, 29.5), st.floats(0.3, 3.7))


def pair(first: tuple[float, float], second: tuple[float, float]) -> AliasedPair:
    nothing = np.empty((0, 2))
    return AliasedPair("A", *first, *second, 0.0, 1.0, 1.0, nothing, nothing)


@given(inside, inside)
def test_lines_stay_in_the_picture(first: tuple[float, float], second: tuple[float, float]) -> None:
    bend = _choose_bend(pair(first, second), BOX)
    drawn: Path = ConnectionStyle.Arc3(rad=bend)(first, second, shrinkA=0.0, shrinkB=0.0)
    points = drawn.interpolated(1).to_polygons(closed_only=False)[0]
    assert points[:, 0].min() > 0.0 and points[:, 0].max() < 30.0
    assert points[:, 1].min() > -1e-6 and points[:, 1].max() < 4.0 + 1e-6


@pytest.mark.parametrize(
    ("ends", "bend"),
    [
        (((1.0, 2.0), (3.0, 2.0)), BENDS[0]),  # there is room
        (((1.0, 0.1), (9.0, 0.1)), BENDS[1]),  # on one side
        (((1.0, 2.0), (29.0, 2.0)), BENDS[2]),  # for less
    ],
)
def test_lines_bend_as_far_as_there_is_room(
    ends: tuple[tuple[float, float], tuple[float, float]], bend: float
) -> None:
    assert _choose_bend(pair(*ends), BOX) == bend
