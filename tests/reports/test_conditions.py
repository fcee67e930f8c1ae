"""Conditions: what is read, what is refused with which position, and what holds."""

from __future__ import annotations

import contextlib
import math
import operator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambinav.reports.conditions import Limit, Quantity, catalogue, judge, parse_condition
from ambinav.runtime.errors import InputError
from ambinav.studies.audit.figures import QUANTITIES
from ambinav.studies.diff.figures import QUANTITIES as CHANGES

COMPARE = {">": operator.gt, ">=": operator.ge, "<": operator.lt, "<=": operator.le}


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("open > 2 %", "open > 2 %"),
        ("open>2%", "open > 2 %"),
        ("  Open  >=  .5 percent ", "open >= 0.5 %"),
        ("longest open stretch > 4 m", "longest open stretch > 4 m"),
        ("longest-open_stretch ≤ 4.0 metres", "longest open stretch <= 4 m"),
        ("open area < 1e1 m2", "open area < 10 m²"),
        ("open area ≥ +10 m^2", "open area >= 10 m²"),
        ("open area > 10 ㎡", "open area > 10 m²"),
        ("open > 2\uff05", "open > 2 %"),
        ("open\u00a0>\u00a02\u202f%", "open > 2 %"),
        ("places > 3", "places > 3"),
        ("open at worst heading > 5 %", "open at worst heading > 5 %"),
    ],
)
def test_a_condition_is_read_however_it_is_written(text, meant):
    condition = parse_condition(text, QUANTITIES)
    assert str(condition) == meant
    assert str(parse_condition(str(condition), QUANTITIES)) == meant


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "at position 1 it ends where the name of a figure is expected"),
        ("> 2 %", "at position 1 stands '> 2 %' where the name of a figure"),
        ("open 2 %", "at position 6 stands '2 %' where one of > >= < <= is expected"),
        ("open == 2 %", "at position 6 stands '== 2 %' where one of"),
        ("open", "at position 5 it ends where one of"),
        ("open > ", "at position 8 it ends where a number is expected"),
        ("open > two %", "at position 8 stands 'two %' where a number"),
        ("open > nan %", "at position 8 stands 'nan %' where a number"),
        ("open > 1e999 %", "1e999 is too large"),
        ("open > 2,5 %", "at position 9 the number 2 is followed by ',5 %'; write numbers as 2.5"),
        ("open area > 10 000 m2", "at position 15 the number 10 is followed by ' 000 m2'; write"),
        ("open > 1.2.3 %", "at position 11 the number 1.2 is followed by '.3 %'; write numbers"),
        ("open > 2 % and places > 3", "where the unit '%' is expected; give one condition, its"),
        ("open > 2 furlongs", "at position 10 stands 'furlongs' where the unit '%' is expected"),
        ("places > 2 furlongs", "at position 12 stands 'furlongs' where nothing more is expected"),
        ("opne > 2 %", "'opne' is not a figure of the report; did you mean 'open'"),
        ("longest stretch > 2 m", "did you mean 'longest open stretch'"),
        ("zzz > 2 m", "'zzz' is not a figure of the report; `--fail-if list` names them all"),
        ("open > 2", 'open is in %, and the condition gives no unit; write "open > 2 %".'),
        ("open > 0.02", 'write "open > 0.02 %", or "open > 2 %" if 0.02 is a share of 1.'),
        ("open > 2 m2", 'not in m²; write "open area > 2 m²", or give a limit in %.'),
        ("places > 2 m", "a number without a unit, not in m; give a limit as a number without"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_sentence(text, expected):
    with pytest.raises(InputError) as caught:
        parse_condition(text, QUANTITIES)
    message = str(caught.value)
    assert expected in message
    assert message.startswith(f"--fail-if: {text!r}: ")
    assert "\n" not in message and message.endswith(".")


@pytest.mark.parametrize(
    ("text", "remedy"),
    [
        ("longest open stretch > 400 cm", "longest open stretch > 4 m"),
        ("longest open stretch > 4000 mm", "longest open stretch > 4 m"),
        ("longest open stretch > 0.01 km", "longest open stretch > 10 m"),
        ("longest open stretch > 10 ft", "longest open stretch > 3.048 m"),
        ("open area > 0.5 ha", "open area > 5000 m²"),
        ("open area > 20000 cm²", "open area > 2 m²"),
        ("open area > 100 ft^2", "open area > 9.290304 m²"),
        ("open > 20 ‰", "open > 2 %"),
    ],
)
def test_a_remedy_keeps_the_quantity(text, remedy):
    with pytest.raises(InputError) as caught:
        parse_condition(text, QUANTITIES)
    assert str(caught.value).endswith(f'; write "{remedy}".')
    assert str(parse_condition(remedy, QUANTITIES)) == remedy


@pytest.mark.parametrize(
    ("text", "quantities", "how"),
    [
        ("open > 100 %", QUANTITIES, "never"),
        ("open >= 0 %", QUANTITIES, "always"),
        ("localizable < 0 %", QUANTITIES, "never"),
        ("localizable <= 100 %", QUANTITIES, "always"),
        ("open area < 0 m2", QUANTITIES, "never"),
        ("places > -1", QUANTITIES, "always"),
        ("open change > 100 %", CHANGES, "never"),
        ("mean level change >= -1", CHANGES, "always"),
        ("largest level rise > 1", CHANGES, "never"),
    ],
)
def test_a_gate_that_judges_nothing_is_refused(text, quantities, how):
    with pytest.raises(InputError, match=f" {how} holds, for .* is .*; give a limit that it can"):
        parse_condition(text, quantities)


@pytest.mark.parametrize(
    ("text", "quantities"),
    [
        ("open >= 100 %", QUANTITIES),
        ("open > 0 %", QUANTITIES),
        ("localizable < 100 %", QUANTITIES),
        ("open area change < -3 m2", CHANGES),
        ("mean level change < 0", CHANGES),
    ],
)
def test_a_limit_within_the_range_is_read(text, quantities):
    assert parse_condition(text, quantities).quantity.name in text


@given(st.text(max_size=30))
def test_any_text_is_read_or_refused(text):
    with contextlib.suppress(InputError):
        parse_condition(text, QUANTITIES)


@given(
    st.sampled_from(sorted(QUANTITIES)),
    st.sampled_from(sorted(COMPARE)),
    st.floats(-1e6, 1e6).map(lambda number: float(f"{number:.6g}")),
)
def test_what_is_printed_is_read_back(name, sign, number):
    quantity = QUANTITIES[name]
    text = f"{name} {sign} {number!r} {quantity.unit}"
    values = [value for value in (*quantity.range, number, number - 1, number + 1)
              if quantity.range[0] <= value <= quantity.range[1]]  # fmt: skip
    if len({Limit(sign, number).holds(value) for value in values}) == 1:
        with pytest.raises(InputError, match=r"(always|never) holds, for .*; give a limit that"):
            parse_condition(text, QUANTITIES)
        return
    condition = parse_condition(text, QUANTITIES)
    assert (condition.quantity, condition.limit) == (quantity, Limit(sign, number))
    assert parse_condition(str(condition), QUANTITIES) == condition


@given(st.sampled_from(sorted(COMPARE)), st.integers(-50, 50), st.integers(-50, 50))
def test_limits_compare_as_numbers_do(sign, value, number):
    assert Limit(sign, number / 10).holds(value / 10) == COMPARE[sign](value, number)


def test_a_value_on_a_limit_is_on_it_whatever_the_rounding():
    assert 0.1 + 0.2 > 0.3
    assert not Limit(">", 0.3).holds(0.1 + 0.2)
    assert Limit("<=", 0.3).holds(0.1 + 0.2)


def test_a_missing_figure_is_no_passed_condition():
    known = catalogue(
        *(
            Quantity(name, "", "whatever", lambda report, value=value: value, needs="look at it")
            for name, value in (("none", None), ("nan", math.nan))
        )
    )
    for name in known:
        with pytest.raises(InputError, match=f"there is no figure for {name}, look at it"):
            judge(parse_condition(f"{name} > 1", known), None)


@pytest.mark.parametrize("quantities", [QUANTITIES, CHANGES])
def test_every_figure_says_what_it_is(quantities):
    for name, quantity in quantities.items():
        assert name == quantity.name == name.lower()
        assert quantity.unit in ("", "%", "m", "m²")
        assert len(quantity.meaning) > 10 and not quantity.meaning.endswith(".")
        assert str(parse_condition(f"{name} > 0.5 {quantity.unit}", quantities))
