"""Sixteen float32 side by side, against NumPy."""

from __future__ import annotations

import inspect

import numpy as np
import pytest
from numpy.typing import NDArray

from ambinav.ambiguity.gaussian import aligned
from ambinav.runtime.kernels import digest, kernel
from ambinav.runtime.lanes import (
    LANES,
    exponential,
    interpolated,
    interpolated_in,
    lane,
    lanes,
    least,
    load,
    most,
    narrow,
    root,
    store,
    totals,
    transpose,
    where,
    wide,
)

U = np.uint64


@kernel
def arithmetic(a, b, out):  # type: ignore[no-untyped-def]
    x, y = load(a, U(0)), load(b, U(0))
    both = (x < y) & (lanes(np.float32(1.0)) <= x)
    store(out, (U(0), U(0)), x + y)
    store(out, (U(1), U(0)), x - y)
    store(out, (U(2), U(0)), x * y)
    store(out, (U(3), U(0)), x / y)
    store(out, (U(4), U(0)), least(x, y))
    store(out, (U(5), U(0)), most(x, y))
    store(out, (U(6), U(0)), root(x))
    store(out, (U(7), U(0)), where(both, x, lanes(np.float32(-1.0))))
    store(out, (U(8), U(0)), where(x >= y, x, y))
    total = x
    total += y
    total *= y
    total -= x
    store(out, (U(9), U(0)), total)


@kernel
def sum_of_three(a, out):  # type: ignore[no-untyped-def]
    found = totals((load(a, (U(0), U(0))), load(a, (U(1), U(0))), load(a, (U(2), U(0)))))
    for k in range(3):
        out[k] = lane(found, U(k))


@kernel
def sum_of_ten(a, out):  # type: ignore[no-untyped-def]
    z = U(0)
    found = totals(
        (
            load(a, (U(0), z)), load(a, (U(1), z)), load(a, (U(2), z)), load(a, (U(3), z)),
            load(a, (U(4), z)), load(a, (U(5), z)), load(a, (U(6), z)), load(a, (U(7), z)),
            load(a, (U(8), z)), load(a, (U(9), z)),
        )
    )  # fmt: skip
    store(out, U(0), found)


@kernel
def sum_of_one(a, out):  # type: ignore[no-untyped-def]
    out[0] = lane(totals((load(a, (U(0), U(0))),)), U(0))


@kernel
def looked_up(table, first, place, out):  # type: ignore[no-untyped-def]
    store(out, U(0), interpolated(table, first, load(place, U(0))))


@kernel
def looked_up_in(table, row, place, out):  # type: ignore[no-untyped-def]
    store(out, U(0), interpolated_in(table, row, load(place, U(0))))


@kernel
def turned(source, which, row, first, target):  # type: ignore[no-untyped-def]
    transpose(source, which, U(2), row, first, target, U(3), U(LANES + 1))


@kernel
def power(x, out):  # type: ignore[no-untyped-def]
    store(out, U(0), exponential(load(x, U(0))))


@kernel
def in_float64(a, b, scale, out):  # type: ignore[no-untyped-def]
    x, y = wide(load(a, U(0))), load(b, U(0))
    store(out, (U(0), U(0)), 1.0 / (scale * x + y))
    store(out, (U(1), U(0)), root(where(x < y, x, y)) - 2.0)
    store(out, (U(2), U(0)), most(x * scale, least(x, y)))
    store(out, (U(3), U(0)), wide(narrow(y)))


@pytest.fixture
def numbers() -> NDArray[np.float32]:
    return np.random.default_rng(3).uniform(0.1, 3.0, (16, LANES)).astype(np.float32)


def test_lane_by_lane_as_numpy(numbers: NDArray[np.float32]) -> None:
    x, y = numbers[0], numbers[1]
    y[3] = x[3]
    out = np.empty((10, LANES), dtype=np.float32)
    arithmetic(x, y, out)
    expected = [
        x + y, x - y, x * y, x / y, np.minimum(x, y), np.maximum(x, y), np.sqrt(x),
        np.where((x < y) & (x >= 1.0), x, -1.0), np.maximum(x, y), (x + y) * y - x,
    ]  # fmt: skip
    for k, values in enumerate(expected):
        np.testing.assert_allclose(out[k], values, rtol=1e-6, atol=1e-6, err_msg=str(k))


@pytest.mark.parametrize(("add", "count"), [(sum_of_one, 1), (sum_of_three, 3), (sum_of_ten, 10)])
def test_totals_stand_in_order(add, count: int, numbers: NDArray[np.float32]) -> None:  # type: ignore[no-untyped-def]
    out = np.zeros(LANES, dtype=np.float32)
    add(numbers, out)
    np.testing.assert_allclose(out[:count], numbers[:count].sum(axis=1), rtol=1e-6)


def test_interpolated_in_a_row_of_its_own(numbers: NDArray[np.float32]) -> None:
    rng = np.random.default_rng(4)
    table = rng.uniform(0.0, 1.0, (40, 9)).astype(np.float32)
    place = rng.uniform(0.0, 7.9, LANES).astype(np.float32)
    place[0], place[1] = 0.0, 7.0
    out = np.empty(LANES, dtype=np.float32)
    looked_up(table, U(16), place, out)
    expected = [np.interp(place[k], np.arange(9), table[16 + k]) for k in range(LANES)]
    np.testing.assert_allclose(out, expected, rtol=1e-5, atol=1e-6)


def test_interpolated_in_the_same_row(numbers: NDArray[np.float32]) -> None:
    table = np.random.default_rng(4).uniform(0.0, 1.0, (5, 9)).astype(np.float32)
    out = np.empty(LANES, dtype=np.float32)
    looked_up_in(table, U(3), numbers[2], out)
    np.testing.assert_allclose(out, np.interp(numbers[2], np.arange(9), table[3]), rtol=1e-5)


def test_transpose_gives_each_scan_a_lane() -> None:
    source = np.arange(40 * 3 * 50, dtype=np.float32).reshape(40, 3, 50)
    which = np.random.default_rng(5).integers(0, 40, LANES + 2)
    target = np.full(3 + LANES * (LANES + 1), -1.0, dtype=np.float32)
    turned(source, which, U(1), U(7), target)
    found = target[3:].reshape(LANES, LANES + 1)
    assert np.array_equal(found[:, :LANES], source[which[2:], 1, 7 : 7 + LANES].T)
    assert (found[:, LANES] == -1.0).all() and (target[:3] == -1.0).all()


def test_exponential_to_the_last_bits() -> None:
    out = np.empty(LANES, dtype=np.float32)
    for x in np.concatenate([np.linspace(-87.0, 87.0, 3200), np.linspace(-1, 1, 320)]).reshape(
        -1, LANES
    ):
        x = x.astype(np.float32)
        power(x, out)
        np.testing.assert_allclose(out, np.exp(x.astype(np.float64)), rtol=4e-7)
    power(np.zeros(LANES, dtype=np.float32), out)
    assert (out == 1.0).all()


def test_float64_mixes_with_plain_numbers(numbers: NDArray[np.float32]) -> None:
    x, y = numbers[0], numbers[1].astype(np.float64) + 1e-9
    out = np.empty((4, LANES))
    in_float64(x, y, 3.0, out)
    x = x.astype(np.float64)
    expected = [1 / (3 * x + y), np.sqrt(np.minimum(x, y)) - 2, np.maximum(3 * x, np.minimum(x, y))]
    np.testing.assert_allclose(out[:3], expected, rtol=1e-12)
    assert np.array_equal(out[3], y.astype(np.float32))


@pytest.mark.parametrize("size", [1, 16, 1000])
def test_aligned_arrays_begin_a_cache_line(size: int) -> None:
    found = aligned(size)
    assert found.shape == (size,) and found.ctypes.data % 64 == 0 and not found.any()


def test_stored_code_is_made_anew_when_lanes_change(monkeypatch: pytest.MonkeyPatch) -> None:
    before = digest(sum_of_ten.py_func)
    source = inspect.getsource
    monkeypatch.setattr(inspect, "getsource", lambda module: source(module) + "# changed")
    assert digest(sum_of_ten.py_func) != before
