"""Vectors of sixteen numbers, for kernels whose loops must fill the vector registers.

numba leaves it to LLVM to find loops that can work on several numbers at once. It does, but adds up
the lanes of each sum apart, which for ten sums over four vectors takes as long as the sums; and
where it cannot tell whether arrays overlap it works on one at a time. Within a kernel `Lanes` are
numbers like any other: `+ - * / < <= >=` and `&` work lane by lane. They hold float32, sixteen of
which fill a register of AVX-512 (elsewhere LLVM takes two or four registers for each), or float64
(`wide`), which mix with plain float64. Sums over lanes are taken together, see `totals`.

Rounding is free, as with `fastmath`: no lane may be infinite or nan.
"""

from __future__ import annotations

import operator
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing import signature
from numba.core.typing.templates import ConcreteTemplate, infer_global
from numba.extending import intrinsic, lower_builtin, models, register_model

LANES = 16
FLAGS = ("reassoc", "nsz", "contract", "arcp", "nnan", "ninf", "afn")
_INT = ir.IntType(32)
_VECTOR = ir.VectorType(ir.FloatType(), LANES)
_DOUBLE = ir.VectorType(ir.DoubleType(), LANES)
_TRUTH = ir.VectorType(ir.IntType(1), LANES)


class _Kind(types.Type):
    """Type of a vector of lanes in numba."""

    def __init__(self, name: str, vector: ir.VectorType) -> None:
        self.vector = vector
        super().__init__(name=name)


class _Lanes(_Kind):
    pass


class _Mask(_Kind):
    pass


class _Model(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: _Kind) -> None:
        super().__init__(manager, kind, kind.vector)


register_model(_Lanes)(_Model)
register_model(_Mask)(_Model)
NUMBERS = _Lanes("Lanes", _VECTOR)
WIDE = _Lanes("WideLanes", _DOUBLE)
MASK = _Mask("LanesMask", _TRUTH)


def _spread(builder: Any, number: Any, vector: ir.VectorType) -> Any:
    """Fill all lanes with the same number."""
    single = builder.insert_element(ir.Constant(vector, ir.Undefined), number, _INT(0))
    zeros = ir.Constant(ir.VectorType(_INT, LANES), [0] * LANES)
    return builder.shuffle_vector(single, single, zeros)


def _operator(function: Any, kind: _Kind, result: _Kind, build: Any) -> None:
    cases: list[tuple[Any, Any]] = [(kind, kind)]
    if kind is WIDE:
        cases += [(kind, types.float64), (types.float64, kind)]
    listed = [signature(result, *case) for case in cases]
    infer_global(function)(type("Template", (ConcreteTemplate,), {"cases": listed}))

    def lower(_: Any, builder: Any, __: Any, args: Any) -> Any:
        full = [a if a.type == kind.vector else _spread(builder, a, kind.vector) for a in args]
        return build(builder, *full)

    for case in cases:
        lower_builtin(function, *case)(lower)


for _kind in (NUMBERS, WIDE):
    for _name, _functions in (
        ("fadd", (operator.add, operator.iadd)),
        ("fsub", (operator.sub, operator.isub)),
        ("fmul", (operator.mul, operator.imul)),
        ("fdiv", (operator.truediv, operator.itruediv)),
    ):
        for _function in _functions:
            _operator(
                _function, _kind, _kind,
                lambda builder, a, b, name=_name: getattr(builder, name)(a, b, flags=FLAGS),
            )  # fmt: skip
    for _sign, _function in (("<", operator.lt), ("<=", operator.le), (">=", operator.ge)):
        _operator(
            _function, _kind, MASK,
            lambda builder, a, b, sign=_sign: builder.fcmp_ordered(sign, a, b),
        )  # fmt: skip
_operator(operator.and_, MASK, MASK, lambda builder, a, b: builder.and_(a, b))


def _shuffled(builder: Any, a: Any, b: Any, order: list[int]) -> Any:
    """Return lanes of a (0 to 15) and b (16 to 31) in this order."""
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_INT, LANES), order))


def _held_in(array: Any) -> _Lanes:
    """Return the type of the lanes that elements of an array make."""
    return WIDE if array.dtype == types.float64 else NUMBERS


def _address(context: Any, builder: Any, kinds: Any, args: Any) -> Any:
    """Return a pointer to sixteen consecutive elements of a C array, from an index on."""
    array = context.make_array(kinds[0])(context, builder, args[0])
    count = kinds[0].ndim
    index = cgutils.unpack_tuple(builder, args[1], count) if count > 1 else [args[1]]
    pointer = cgutils.get_item_pointer(context, builder, kinds[0], array, index)
    return builder.bitcast(pointer, _held_in(kinds[0]).vector.as_pointer())


@intrinsic
def load(_: Any, array: Any, index: Any) -> Any:
    """Load sixteen numbers of a C array from `index` on, unsigned, or a tuple of indices."""

    def build(context: Any, builder: Any, kinds: Any, args: Any) -> Any:
        return builder.load(_address(context, builder, kinds.args, args), align=4)

    return _held_in(array)(array, index), build


@intrinsic
def store(_: Any, array: Any, index: Any, numbers: Any) -> Any:
    """Store to sixteen elements; see `load`."""

    def build(context: Any, builder: Any, kinds: Any, args: Any) -> Any:
        builder.store(args[2], _address(context, builder, kinds.args, args), align=4)
        return context.get_dummy_value()

    return types.void(array, index, numbers), build


@intrinsic
def lanes(_: Any, number: Any) -> Any:
    """Fill all lanes with the same float32."""
    return NUMBERS(types.float32), lambda _, builder, __, args: _spread(builder, args[0], _VECTOR)


@intrinsic
def wide(_: Any, numbers: Any) -> Any:
    """Convert to float64."""
    return WIDE(NUMBERS), lambda _, builder, __, args: builder.fpext(args[0], _DOUBLE)


@intrinsic
def narrow(_: Any, numbers: Any) -> Any:
    """Convert to float32."""
    return NUMBERS(WIDE), lambda _, builder, __, args: builder.fptrunc(args[0], _VECTOR)


@intrinsic
def lane(_: Any, numbers: Any, k: Any) -> Any:
    """Return the float32 in lane k."""

    def build(context: Any, builder: Any, kinds: Any, args: Any) -> Any:
        return builder.extract_element(args[0], builder.trunc(args[1], _INT))

    return types.float32(numbers, types.uint64), build


@intrinsic
def where(_: Any, mask: Any, yes: Any, no: Any) -> Any:
    """Return `yes` in the lanes where the mask is true, else `no`."""
    return yes(mask, yes, no), lambda _, builder, __, args: builder.select(*args)


@intrinsic
def least(_: Any, a: Any, b: Any) -> Any:
    """Return the smaller of the two in each lane."""

    def build(context: Any, builder: Any, kinds: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered("<", *args, flags=FLAGS), *args)

    return a(a, b), build


@intrinsic
def most(_: Any, a: Any, b: Any) -> Any:
    """Return the greater of the two in each lane."""

    def build(context: Any, builder: Any, kinds: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", *args, flags=FLAGS), *args)

    return a(a, b), build


@intrinsic
def root(_: Any, numbers: Any) -> Any:
    """Compute the square root."""

    def build(context: Any, builder: Any, kinds: Any, args: Any) -> Any:
        vector = kinds.args[0].vector
        name = f"llvm.sqrt.v{LANES}f{32 if vector == _VECTOR else 64}"
        kind = ir.FunctionType(vector, [vector])
        function = cgutils.get_or_insert_function(builder.module, kind, name)
        return builder.call(function, args, fastmath=FLAGS)

    return numbers(numbers), build


@intrinsic
def exponential(_: Any, numbers: Any) -> Any:
    """Compute exp of numbers from -87 to 87, accurate to the last bits of float32."""

    def build(context: Any, builder: Any, kinds: Any, args: Any) -> Any:
        def number(value: float) -> Any:
            return ir.Constant(_VECTOR, [value] * LANES)

        def fused(a: Any, b: Any, c: Any) -> Any:
            return builder.fadd(builder.fmul(a, b, flags=FLAGS), c, flags=FLAGS)

        # exp(x) = 2^n exp(r), n whole and |r| <= log(2) / 2; log(2) in two parts, the first short.
        scaled = builder.fmul(args[0], number(1.4426950408889634), flags=FLAGS)
        half = builder.select(
            builder.fcmp_ordered("<", scaled, number(0.0)), number(-0.5), number(0.5)
        )
        integers = ir.VectorType(_INT, LANES)
        n = builder.fptosi(builder.fadd(scaled, half, flags=FLAGS), integers)
        steps = builder.sitofp(n, _VECTOR)
        r = fused(steps, number(-0.693359375), args[0])
        r = fused(steps, number(2.12194440e-4), r)
        series = number(1.0 / 5040.0)
        for k in (720.0, 120.0, 24.0, 6.0, 2.0, 1.0, 1.0):
            series = fused(series, r, number(1.0 / k))
        # The exponent of a float32 stands from bit 23 on.
        shift = ir.Constant(integers, [23] * LANES)
        bits = builder.shl(builder.add(n, ir.Constant(integers, [127] * LANES)), shift)
        return builder.fmul(series, builder.bitcast(bits, _VECTOR), flags=FLAGS)

    return NUMBERS(NUMBERS), build


def _interpolated(context: Any, builder: Any, kinds: Any, args: Any, apart: int) -> Any:
    """Build `interpolated`; lane k reads row `args[1]` + k * `apart`."""
    array = context.make_array(kinds[0])(context, builder, args[0])
    columns = builder.fptosi(args[2], ir.VectorType(ir.IntType(64), LANES))
    low = high = ir.Constant(_VECTOR, ir.Undefined)
    for k in range(LANES):
        row = builder.add(args[1], args[1].type(k * apart))
        column = builder.extract_element(columns, _INT(k))
        pointer = cgutils.get_item_pointer(context, builder, kinds[0], array, [row, column])
        low = builder.insert_element(low, builder.load(pointer), _INT(k))
        after = builder.load(builder.gep(pointer, [_INT(1)]))
        high = builder.insert_element(high, after, _INT(k))
    share = builder.fsub(args[2], builder.sitofp(columns, _VECTOR), flags=FLAGS)
    rise = builder.fmul(share, builder.fsub(high, low, flags=FLAGS), flags=FLAGS)
    return builder.fadd(low, rise, flags=FLAGS)


@intrinsic
def interpolated(_: Any, table: Any, first: Any, place: Any) -> Any:
    """Interpolate row `first` + k of a float32 C table at place[k] in each lane k, linearly."""

    def build(context: Any, builder: Any, kinds: Any, args: Any) -> Any:
        return _interpolated(context, builder, kinds.args, args, 1)

    return NUMBERS(table, first, place), build


@intrinsic
def interpolated_in(_: Any, table: Any, row: Any, place: Any) -> Any:
    """Interpolate as `interpolated` does, with the same row for all lanes."""

    def build(context: Any, builder: Any, kinds: Any, args: Any) -> Any:
        return _interpolated(context, builder, kinds.args, args, 0)

    return NUMBERS(table, row, place), build


@intrinsic
def transpose(
    _: Any, source: Any, which: Any, low: Any, row: Any, first: Any, target: Any, begin: Any,
    step: Any,
) -> Any:  # fmt: skip
    """Transpose sixteen columns of sixteen scans so that each scan has a lane.

    target[begin + i * step + k] = source[which[low + k], row, first + i] for i, k < 16; C arrays of
    float32 but for `which`, and unsigned numbers.
    """

    def build(context: Any, builder: Any, kinds: Any, args: Any) -> Any:
        names = ("source", "which", "low", "row", "first", "target", "begin", "step")
        kind = dict(zip(names, kinds.args, strict=True))
        given = dict(zip(kind, args, strict=True))

        def element(name: str, index: list[Any]) -> Any:
            array = context.make_array(kind[name])(context, builder, given[name])
            return cgutils.get_item_pointer(context, builder, kind[name], array, index)

        def halves(a: Any, b: Any, order: list[int]) -> Any:
            # Within each quarter of the register: numbers of a from 0, those of b from 4.
            full = [4 * q + j % 4 + LANES * (j // 4) for q in range(4) for j in order]
            return _shuffled(builder, a, b, full)

        def quarters(a: Any, b: Any, odd: int) -> Any:
            full = [LANES * s + 4 * q + j for s in (0, 1) for q in (odd, 2 + odd) for j in range(4)]
            return _shuffled(builder, a, b, full)

        rows = []
        for k in range(LANES):
            place = builder.add(given["low"], ir.Constant(ir.IntType(64), k))
            scan = builder.load(element("which", [place]))
            pointer = element("source", [scan, given["row"], given["first"]])
            rows.append(builder.load(builder.bitcast(pointer, _VECTOR.as_pointer()), align=4))
        # Four by four within quarters, then quarter by quarter: each is one instruction.
        fours = []
        for g in range(0, LANES, 4):
            a, b, c, d = rows[g : g + 4]
            low, high = [0, 4, 1, 5], [2, 6, 3, 7]
            ab = halves(a, b, low), halves(a, b, high)
            cd = halves(c, d, low), halves(c, d, high)
            pairs = ([0, 1, 4, 5], [2, 3, 6, 7])
            fours.append([halves(ab[h], cd[h], order) for h in (0, 1) for order in pairs])
        for j in range(4):
            for odd in (0, 1):
                left_pair, right_pair = (
                    quarters(fours[g][j], fours[g + 1][j], odd) for g in (0, 2)
                )
                for half in (0, 1):
                    column = ir.Constant(ir.IntType(64), 4 * (2 * half + odd) + j)
                    place = builder.add(given["begin"], builder.mul(column, given["step"]))
                    pointer = builder.gep(
                        context.make_array(kind["target"])(context, builder, given["target"]).data,
                        [place],
                    )
                    pointer = builder.bitcast(pointer, _VECTOR.as_pointer())
                    builder.store(quarters(left_pair, right_pair, half), pointer, align=4)
        return context.get_dummy_value()

    return types.void(source, which, low, row, first, target, begin, step), build


@intrinsic
def totals(_: Any, several: Any) -> Any:
    """Return in lane k the sum over all lanes of the k-th of at most sixteen vectors."""

    def build(context: Any, builder: Any, kinds: Any, args: Any) -> Any:
        # Two by two, halves are added to halves: what is left of each sum is half as wide.
        parts = [(v, [k]) for k, v in enumerate(cgutils.unpack_tuple(builder, args[0]))]
        width = LANES
        while width > 1:
            half, merged = width // 2, []
            low = [source + j for source in range(0, 2 * LANES, width) for j in range(half)]
            high = [j + half for j in low]
            for k in range(0, len(parts), 2):
                (a, mine), (b, other) = parts[k], parts[k + 1] if k + 1 < len(parts) else parts[k]
                both = [_shuffled(builder, a, b, order) for order in (low, high)]
                blank = [-1] * (LANES // width - len(mine))
                owners = mine + blank + (other if k + 1 < len(parts) else [])
                merged.append((builder.fadd(*both, flags=FLAGS), owners))
            parts, width = merged, half
        total, owners = parts[0]
        order = [owners.index(k) if k in owners else 0 for k in range(LANES)]
        return _shuffled(builder, total, total, order)

    return NUMBERS(several), build
