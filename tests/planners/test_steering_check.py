"""The turning radius that a space of OMPL has, and steerings and spaces that are refused."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ompl import base as ob

from ambinav.geometry.motion.steering import Steering
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from ambinav_planners.objective import AmbiguityObjective
from ambinav_planners.spaces import make_space
from ambinav_planners.steering_check import steering_of

BOUNDS = (0.0, 0.0, 45.0, 28.0)


@settings(max_examples=30, deadline=None)
@given(st.sampled_from(["dubins", "reeds-shepp"]), st.floats(0.01, 100.0))
def test_the_radius_is_read_off_the_space(kind: str, radius: float) -> None:
    found = steering_of(ob.SpaceInformation(make_space(Steering(kind, radius), BOUNDS)))
    assert found.space == kind
    assert found.radius == pytest.approx(radius, rel=1e-9)


def test_round_radii_come_out_round(demo: AmbiguityService) -> None:
    for kind, radius in (("dubins", 0.05), ("dubins", 0.4), ("reeds-shepp", 1.3)):
        si = ob.SpaceInformation(make_space(Steering(kind, radius), BOUNDS))
        assert AmbiguityObjective(si, demo).steering == Steering(kind, radius)
    for kind in ("r2", "se2"):
        si = ob.SpaceInformation(make_space(Steering(kind), BOUNDS))
        assert AmbiguityObjective(si, demo).steering == Steering(kind)


@pytest.mark.parametrize("kind", ["dubins", "reeds-shepp"])
def test_another_radius_is_refused(demo: AmbiguityService, kind: str) -> None:
    si = ob.SpaceInformation(make_space(Steering(kind, 0.5), BOUNDS))
    with pytest.raises(
        InputError, match=r"a turning radius of 2 m and the state space .* one of 0\.5 m; leave"
    ):
        AmbiguityObjective(si, demo, steering=Steering(kind, 2.0))
    same = AmbiguityObjective(si, demo, steering=Steering(kind, 0.5))
    assert same.steering == Steering(kind, 0.5)


def test_symmetric_dubins_is_refused(demo: AmbiguityService) -> None:
    si = ob.SpaceInformation(ob.DubinsStateSpace(0.5, True))
    for steering in (None, Steering("dubins", 0.5)):
        with pytest.raises(InputError, match="is a symmetric Dubins space, in which"):
            AmbiguityObjective(si, demo, steering=steering)


def test_spaces_over_se2_with_motions_of_their_own_are_refused(demo: AmbiguityService) -> None:
    si = ob.SpaceInformation(ob.TrochoidStateSpace(1.0, 0.5, 0.3))
    with pytest.raises(InputError, match=r"motions in the state space .* are not those of se2; g"):
        AmbiguityObjective(si, demo)
