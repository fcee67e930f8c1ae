"""Localizers of plug-ins: what fails in one is named, from making it to its last estimate."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ambinav.drive.localizer_spec import LOCALIZERS, LocalizerSpec, chosen_localizer
from ambinav.drive.localizers import DeadReckoning
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.robot import Robot
from ambinav.runtime.errors import InputError

NOISE = OdometryNoise()
CONTEXT: Any = SimpleNamespace(noise=NOISE, runs=2)


class Failing(DeadReckoning):
    """Fails where it is asked for what `where` names."""

    def __init__(self, where: str) -> None:
        super().__init__(NOISE, 2)
        self.where = where

    def __getattribute__(self, name: str) -> Any:
        if name == object.__getattribute__(self, "__dict__").get("where"):
            raise ZeroDivisionError("by nought")
        return super().__getattribute__(name)


def made(monkeypatch: pytest.MonkeyPatch, make: Any) -> Any:
    monkeypatch.setattr(LOCALIZERS, "_registered", {})
    LOCALIZERS.register(LocalizerSpec(name="failing", title="", make=make))
    return chosen_localizer("failing", NOISE, Robot(), 10.0).make(CONTEXT)


def use(localizer: Any) -> Any:
    localizer.start(np.zeros((2, 3)), np.eye(3))
    localizer.update(np.zeros((2, 3)), np.zeros((2, 4), np.float32))
    return localizer.mean, localizer.covariance


@pytest.mark.parametrize("where", ["start", "update", "mean", "covariance"])
def test_what_fails_within_is_named(monkeypatch: pytest.MonkeyPatch, where: str) -> None:
    localizer = made(monkeypatch, lambda parameters, context: Failing(where))
    message = r"localizer 'failing', registered by .*failed \(ZeroDivisionError: by nought"
    with pytest.raises(InputError, match=message):
        use(localizer)


def test_what_cannot_be_made_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"localizer 'failing', registered .*IndexError"):
        made(monkeypatch, lambda parameters, context: [][1])


def test_one_that_works_is_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    mean, covariance = use(made(monkeypatch, lambda parameters, context: Failing("")))
    own = DeadReckoning(NOISE, 2)
    np.testing.assert_array_equal(mean, use(own)[0])
    np.testing.assert_array_equal(covariance, own.covariance)
    # Ours are not wrapped.
    assert isinstance(chosen_localizer("odometry", NOISE, Robot(), 10.0).make(CONTEXT), type(own))
