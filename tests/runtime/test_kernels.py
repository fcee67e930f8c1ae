"""Machine code on disk is never older than what it was made from."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from ambinav.runtime.arrays import copy_into
from ambinav.runtime.kernels import kernel
from tests.forked import ForkServer

ROOT = Path(__file__).parents[2]
PACKAGES = (ROOT / "ambinav", ROOT / "planners", ROOT / "envs")

CALLER = """
from numba import njit
from ambinav.runtime.arrays import copy_into
from ambinav.runtime.kernels import kernel
import callee
from callee import SCALE, inner

@kernel
def outer(x):
    return SCALE * inner(x)

if __name__ == "__main__":
    print(outer(3.0), sum(outer.stats.cache_hits.values()))
"""
CALLEE = """
import numpy as np
from typing import NamedTuple
from ambinav.runtime.arrays import copy_into
from ambinav.runtime.kernels import kernel

SCALE = 10.0
STEPS = (1.0, 2.0)
Real = np.float64

class Pair(NamedTuple):
    one: float
    two: float

@kernel({options})
def innermost(x):
    return Real(x + Pair(*STEPS).two)

@kernel
def inner(x):
    return innermost(x)
"""


READER = """
from typing import NamedTuple
from ambinav.runtime.arrays import copy_into
from ambinav.runtime.kernels import kernel

class Pair(NamedTuple):
    one: float
    two: float

@kernel
def first(pair):
    return pair.one

if __name__ == "__main__":
    print(first(Pair(one=1.0, two=2.0)), sum(first.stats.cache_hits.values()))
"""


Run = Callable[..., list[float]]


def settings(folder: Path = ROOT) -> dict[str, str]:
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])}
    env.pop("NUMBA_CACHE_DIR", None)  # the tests look for stored code beside the modules
    # Files change within a second, by which the age of byte code is counted.
    return env | {"PYTHONDONTWRITEBYTECODE": "1"}


@pytest.fixture(scope="module")
def run() -> Iterator[Run]:
    """Returns the numbers that a script prints in a process of its own."""
    server = ForkServer(settings(), "ambinav.runtime.kernels", "ambinav.runtime.arrays")

    def numbers(folder: Path, *command: str) -> list[float]:
        status, printed, errors = server(folder, *command)
        assert status == 0, errors
        return [float(word) for word in printed.split()]

    yield numbers
    server.close()


@pytest.mark.slow
def test_a_caller_follows_each_change_of_a_callee(tmp_path: Path, run: Run) -> None:
    (tmp_path / "caller.py").write_text(CALLER)
    callee = tmp_path / "callee.py"
    callee.write_text(CALLEE.format(options=""))
    assert run(tmp_path, "caller.py") == [50.0, 0.0]
    assert run(tmp_path, "caller.py") == [50.0, 1.0], "unchanged code is compiled once"
    edits = [
        ("x + Pair", "x - Pair", 10.0),  # a callee of a callee
        ("SCALE = 10.0", "SCALE = 20.0", 20.0),  # a constant that the caller imports
        ("(1.0, 2.0)", "(1.0, 1.0)", 40.0),  # a constant of a callee
        ("innermost(x)\n", "innermost(x) + 1.0\n", 60.0),  # a constant within a callee
        ("np.float64", "np.int64", 60.0),  # a type
        ("(1.0, 1.0)", "(1.5, 1.0)", 60.0),  # one that makes no difference here
        ("one: float\n    two: float", "two: float\n    one: float", 40.0),  # the order of fields
    ]
    for old, new, expected in edits:
        text = callee.read_text()
        assert old in text
        callee.write_text(text.replace(old, new))
        assert run(tmp_path, "caller.py") == [expected, 0.0], new
    assert run(tmp_path, "caller.py") == [expected, 1.0], "and once more after an edit"
    callee.write_text(callee.read_text().replace("@kernel()", '@kernel(inline="always")'))
    assert run(tmp_path, "caller.py") == [40.0, 0.0], "how a callee is compiled counts"
    caller = tmp_path / "caller.py"
    caller.write_text(caller.read_text().replace("@kernel\n", "@kernel(fastmath=True)\n"))
    assert run(tmp_path, "caller.py") == [40.0, 0.0], "how the caller itself is compiled counts"
    assert run(tmp_path, "caller.py") == [40.0, 1.0]


@pytest.mark.slow
def test_what_is_not_in_the_code_makes_no_difference(tmp_path: Path, run: Run) -> None:
    (tmp_path / "caller.py").write_text(CALLER)
    callee = tmp_path / "callee.py"
    callee.write_text(CALLEE.format(options=""))
    assert run(tmp_path, "caller.py") == [50.0, 0.0]
    callee.write_text(callee.read_text() + "# a remark\n")
    os.utime(tmp_path / "caller.py", (1e9, 1e9))
    assert run(tmp_path, "caller.py") == [50.0, 1.0]


@pytest.mark.slow
def test_processes_that_compile_at_once_keep_their_code_apart(tmp_path: Path, run: Run) -> None:
    """Both think that they are the first: what one has stored is not handed to the other."""
    code = """
import sys
from unittest import mock
import plain
with mock.patch("numba.core.caching.IndexDataCacheFile._load_index", lambda self: {}):
    plain.twice(eval(sys.argv[1]))
"""
    (tmp_path / "plain.py").write_text(
        "from ambinav.runtime.kernels import kernel\n\n@kernel\ndef twice(x):\n    return x + x\n"
    )
    (tmp_path / "both.py").write_text(code)
    run(tmp_path, "both.py", "1")
    run(tmp_path, "both.py", "1.5")
    assert len(list(tmp_path.rglob("plain.twice*.nbc"))) == 2
    (tmp_path / "each.py").write_text("import plain; print(plain.twice(1.5), plain.twice(1))")
    assert run(tmp_path, "each.py") == [3.0, 2]


@pytest.mark.slow
def test_stored_code_of_a_caller_does_not_pile_up(tmp_path: Path, run: Run) -> None:
    (tmp_path / "caller.py").write_text(CALLER)
    for k in range(3):
        text = CALLEE.format(options="").replace("10.0", f"{k}.0")
        (tmp_path / "callee.py").write_text(text)
        run(tmp_path, "caller.py")
    assert len(list(tmp_path.rglob("caller.outer*.nbc"))) == 1


@pytest.mark.sweep
def test_an_edit_of_circles_reaches_the_length_of_motions(tmp_path: Path) -> None:
    """In a fresh copy of the package, as a pull in an editable checkout does it."""
    shutil.copytree(ROOT / "ambinav", tmp_path / "ambinav", ignore=shutil.ignore_patterns("*.nb?"))
    length = (
        "from ambinav.geometry.motion.curves import motion_length;"
        "from ambinav.geometry.motion.steering import Steering;"
        "s = Steering('dubins', 1.0);"
        "print(motion_length(s.kind, s.kernel_radius, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0))"
    )

    def printed() -> str:
        command = [sys.executable, "-c", length]
        return subprocess.check_output(command, cwd=tmp_path, env=settings(tmp_path), text=True)

    before = printed()
    circles = tmp_path / "ambinav" / "geometry" / "motion" / "circles.py"
    text = circles.read_text()
    assert "wrap(t1 - t0)" in text
    circles.write_text(text.replace("wrap(t1 - t0)", "wrap(t0 - t1)"))
    assert printed() != before


def test_every_kernel_knows_its_callees() -> None:
    plain = re.compile(r"^\s*@(numba\.)?(njit|jit)\b", re.MULTILINE)
    for package in PACKAGES:
        for path in package.rglob("*.py"):
            assert not plain.search(path.read_text()), f"{path}: use ambinav.runtime.kernels.kernel"


@pytest.mark.slow
def test_fields_of_an_argument_may_change_places(tmp_path: Path, run: Run) -> None:
    reader, caller = tmp_path / "pairs.py", tmp_path / "reader.py"
    head, tail = READER.split("@kernel\n")
    reader.write_text(head)
    caller.write_text(f"from pairs import Pair, kernel\n\n@kernel\n{tail}")
    assert run(tmp_path, "reader.py") == [1.0, 0.0]
    assert run(tmp_path, "reader.py") == [1.0, 1.0]
    swapped = head.replace("one: float\n    two: float", "two: float\n    one: float")
    assert swapped != head
    reader.write_text(swapped)
    assert run(tmp_path, "reader.py") == [1.0, 0.0]


@pytest.mark.slow
def test_stored_code_that_names_a_class_which_has_moved_is_left_alone(
    tmp_path: Path, run: Run
) -> None:
    moved = "from pair import Pair"
    (tmp_path / "pair.py").write_text(
        "from typing import NamedTuple\nclass Pair(NamedTuple):\n    one: float\n    two: float\n"
    )
    body = READER[: READER.index("class")] + moved + READER[READER.index("\n\n@kernel") :]
    (tmp_path / "reader.py").write_text(body)
    assert run(tmp_path, "reader.py") == [1.0, 0.0]
    (tmp_path / "pair.py").rename(tmp_path / "couple.py")
    (tmp_path / "reader.py").write_text(body.replace("from pair", "from couple"))
    assert run(tmp_path, "reader.py") == [1.0, 0.0]
    assert run(tmp_path, "reader.py") == [1.0, 1.0]


def test_references_are_counted_where_nothing_else_is_said() -> None:
    @kernel
    def part(values):
        return values[1:]

    @kernel(_nrt=False)
    def outer(values):
        return part(values)[0]

    values = np.arange(3.0)
    before = sys.getrefcount(values)
    assert outer(values) == 1.0
    # Compiled by a caller that counts nothing; who takes its arrays along needs the count.
    kept = part(values)
    assert sys.getrefcount(values) == before + 1
    del values
    assert kept.tolist() == [1.0, 2.0]


def test_constants_of_callers_compile_a_callee_once() -> None:
    @kernel
    def callee(x, k):
        return x + k

    @kernel
    def caller(x, k):
        return callee(x, 1) + callee(x, 2) + callee(x, k)

    assert caller(1.0, 3) == 9.0
    assert len(callee.signatures) == 1


@pytest.mark.slow
def test_machine_code_calls_none_of_another_kernel() -> None:
    @kernel
    def callee(values, depth):
        # Too much to be expanded where it is called.
        return values[0] if depth == 0 else callee(values, depth - 1) + np.cos(values).sum()

    @kernel
    def caller(values, depth):
        return 2.0 * callee(values, depth)

    assert caller(np.zeros(3), 2) == 12.0
    for compiled in (callee, caller):
        (assembly,) = compiled.inspect_asm().values()
        # A weak symbol is resolved to whichever copy of a function a process has loaded first.
        assert ".weak" not in assembly


@pytest.mark.slow
def test_a_function_of_somebody_else_is_not_led_into_a_kernel() -> None:
    """LLVM drops or changes arguments of copies that nobody else calls."""

    @njit
    def shared(values, depth):
        return values[0] if depth == 0 else shared(values, depth - 1) + np.cos(values).sum()

    @kernel
    def ours(values, depth):
        return 2.0 * shared(values, depth)

    @njit
    def theirs(values, depth):
        return 3.0 * shared(values, depth)

    values = np.arange(5.0)
    expected = 2.0 * np.cos(values).sum()
    assert ours(values, 2) == pytest.approx(2.0 * expected)
    assert theirs(values, 2) == pytest.approx(3.0 * expected)
    assert shared(values, 2) == pytest.approx(expected)


@pytest.mark.slow
def test_copies_are_those_of_slices() -> None:
    @kernel
    def copied(out, values):
        copy_into(out, values)

    for shape in ((3,), (2, 3), (2, 3, 4)):
        values = np.random.default_rng(1).random(shape)
        out = np.zeros((shape[0] + 2, *shape[1:]))
        copied(out, values)
        assert np.array_equal(out[: shape[0]], values)
        assert not out[shape[0] :].any()
    with pytest.raises(ValueError, match="more values than room"):
        copied(np.zeros(2), np.zeros(3))
