"""The checks of input: each complaint names file, field, value and remedy."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import pytest
from pydantic import InstanceOf

from ambinav.config import (
    ConfigModel,
    Count,
    MountDegrees,
    Positive,
    Switch,
    as_arrays,
    as_nonnegative,
    as_positive,
    check_fields,
    checked,
    choice,
    from_mapping,
    integer,
    number,
    of_mapping,
    row,
)
from ambinav.config.numbers import shown
from ambinav.runtime.errors import InputError


@dataclass(frozen=True)
class Motor:
    power: Positive
    poles: Annotated[int, integer(least=2, most=8)] = 2
    kind: Annotated[str, choice(("brushed", "brushless"))] = "brushed"
    limits: Annotated[tuple[Positive, Positive], row(2, "give the lower and the upper one")] = (
        1.0, 2.0,
    )  # fmt: skip
    spare: Switch = False

    def __post_init__(self) -> None:
        check_fields(self, "motor")


class Wheel(ConfigModel):
    radius: Annotated[float, number(above=0, most=1)]
    mount: MountDegrees = (0.0, 0.0, 0.0)


class Cart(ConfigModel):
    wheels: tuple[Wheel, ...]
    motor: Annotated[InstanceOf[Motor], of_mapping(Motor)] = Motor(1.0)
    seats: Count | None = None
    doors: int | None = None


UNUSABLE: list[object] = [math.nan, -math.inf, math.inf, True, "far", None, 10**400]

GOOD: dict[str, Any] = {"wheels": [{"radius": "1e-1", "mount": [0, 1, 180]}], "motor": {"power": 2}}


def test_values_come_back_in_their_types() -> None:
    cart = checked(Cart, GOOD, "cart.yaml")
    assert cart.wheels[0] == Wheel(radius=0.1, mount=(0.0, 1.0, 180.0))
    assert cart.wheels[0].mount == (0.0, 1.0, math.pi)
    assert cart.motor == Motor(2.0) and isinstance(cart.motor.power, float)
    numpy = Motor(np.float32(2.0), np.int64(4), limits=np.array([1, 2]), spare=np.True_)
    assert numpy == Motor(2.0, 4, spare=True)
    assert {type(value) for value in vars(numpy).values()} == {float, int, str, tuple, bool}


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ([], "f is []; give a mapping with the keys wheels, motor, seats, doors."),
        ({}, "f: the key 'wheels' is missing; add it."),
        ({**GOOD, "wheel": 1}, "f: the key 'wheel' is unknown; did you mean wheels."),
        ({"wheels": [3]}, "f: wheels[0] is 3; give a mapping with the keys radius, mount."),
        ({"wheels": [{}]}, "f: wheels[0]: the key 'radius' is missing; add it."),
        (
            {"wheels": [{"radius": 2}]},
            "f: wheels[0].radius is 2; give a number above 0, at most 1.",
        ),
        (
            {"wheels": [{"radius": math.nan}]},
            "f: wheels[0].radius is nan; give a number above 0, at most 1.",
        ),
        (
            {"wheels": [{"radius": 1, "mount": [0, "left", 0]}]},
            "f: wheels[0].mount[1] is 'left'; give a finite number.",
        ),
        ({**GOOD, "seats": 0}, "f: seats is 0; give a whole number of at least 1."),
        ({**GOOD, "seats": True}, "f: seats is True; give a whole number of at least 1."),
        ({**GOOD, "doors": True}, "f: doors is True; give a number."),
        ({**GOOD, "motor": {}}, "f: motor: the key 'power' is missing; add it."),
        ({**GOOD, "motor": {"powr": 1}}, "f: motor: the key 'powr' is unknown; did you mean power."),  # noqa: E501
        ({**GOOD, "motor": {"power": -1}}, "f: motor: power is -1; give a number above 0."),
        (
            {**GOOD, "motor": {"power": 1, "poles": 9}},
            "f: motor: poles is 9; give a whole number from 2 to 8.",
        ),
    ],
)  # fmt: skip
def test_one_sentence_with_file_place_value_and_remedy(value: object, message: str) -> None:
    with pytest.raises(InputError) as caught:
        checked(Cart, value, "f")
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"kind": "brush"}, "motor: kind is 'brush'; did you mean brushed, brushless."),
        ({"limits": 3}, "motor: limits is 3; give the lower and the upper one."),
        ({"limits": (1, 0)}, "motor: limits[1] is 0; give a number above 0."),
        ({"spare": 1}, "motor: spare is 1; give true or false."),
        ({"poles": "x" * 80}, f"motor: poles is '{'x' * 56}...; give a whole number from 2 to 8."),
    ],
)
def test_a_dataclass_checks_its_fields_by_their_annotations(values: Any, message: str) -> None:
    with pytest.raises(InputError) as caught:
        from_mapping(Motor, {"power": 1, **values})
    assert str(caught.value) == message


@pytest.mark.parametrize("bad", [[1.0, 2.0, 3.0], "north", [[1.0], [2.0, 3.0]], {}])
def test_arrays_that_do_not_match(bad: Any) -> None:
    with pytest.raises(InputError, match=r"^x and y cannot be broadcast together \(.*give"):
        as_arrays(x=[0.0, 1.0], y=bad)


def test_arrays_broadcast() -> None:
    shape, (x, y, theta) = as_arrays(x=[[1], [2]], y=np.float32([3, 4, 5]), theta=6)
    assert shape == (2, 3) and x.dtype == y.dtype == theta.dtype == np.float64
    assert x.shape == (2, 1) and theta.shape == ()


@pytest.mark.parametrize(
    ("check", "value", "unit", "message"),
    [
        (as_positive, 0, "", "x is 0; give a number above 0."),
        (as_positive, np.float64(-0.5), "metres", "x is -0.5; give metres above 0."),
        (as_nonnegative, "-1", "", "x is '-1'; give a number of at least 0."),
        (as_nonnegative, -1e-9, "metres", "x is -1e-09; give at least 0 metres."),
        *((as_positive, bad, "", f"x is {shown(bad)}; give a finite number.") for bad in UNUSABLE),
        *(
            (as_nonnegative, bad, "", f"x is {shown(bad)}; give a finite number.")
            for bad in UNUSABLE
        ),
    ],
)
def test_signs_of_single_numbers(check: Any, value: object, unit: str, message: str) -> None:
    assert check("1e-3", "x", unit) == 1e-3 and as_nonnegative(0, "x") == 0.0
    with pytest.raises(InputError) as caught:
        check(value, "x", unit)
    assert str(caught.value) == message
