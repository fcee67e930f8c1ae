"""The scripts of examples/ run as they stand, each in a folder of its own."""

from __future__ import annotations

import os
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.forked import ForkServer

ROOT = Path(__file__).parents[1]
PATHS = os.pathsep.join(str(ROOT / name) for name in ("", "envs", "planners"))
SCRIPTS = sorted((ROOT / "examples").glob("*.py"))
SHORTER = {
    "06": {"= 64, 128, 10, 32": "= 8, 64, 2, 4", "500_000": "1024"},
    "07": {"= 64, 128, 10, 512": "= 8, 64, 2, 256", "500_000": "1024"},
}
"""What a script is cut short by, by its number."""
NEEDS = {"07": "torchrl"}
"""A package that a script needs and no extra brings, by its number."""
LEAVES = {"01": "out/01-level.png"}
"""What a script writes, by its number."""


def test_examples_are_numbered_and_listed():
    listed = (ROOT / "examples" / "README.md").read_text(encoding="utf-8")
    assert [script.name[:2] for script in SCRIPTS] == [f"{n:02d}" for n in range(1, 8)]
    assert all(f"[{script.name}]({script.name})" in listed for script in SCRIPTS)


@pytest.fixture(scope="module")
def python() -> Iterator[ForkServer]:
    settings = {
        "PYTHONPATH": PATHS,
        "MPLBACKEND": "agg",
        "PYTHONWARNINGS": "error::ambinav.runtime.errors.InputWarning",
    }
    server = ForkServer({**os.environ, **settings}, "matplotlib.pyplot", "tests.kernels_at_hand")
    yield server
    server.close()


@pytest.mark.slow(
    kept=(
        "01_ambiguity_map",
        "02_my_scanner",
        "03_localizability_online",
        "04_gymnasium_episode",
        "05_policy_from_messages",
        "07_torchrl",
    )
)
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_an_example_runs(script, tmp_path, python):
    needed = NEEDS.get(script.name[:2])
    if needed is not None and find_spec(needed) is None:
        pytest.skip(f"{needed} is not installed")
    if shorter := SHORTER.get(script.name[:2]):
        code = script.read_text(encoding="utf-8")
        for long, short in shorter.items():
            assert long in code
            code = code.replace(long, short)
        script = tmp_path / script.name
        script.write_text(code, encoding="utf-8")
    status, printed, errors = python(tmp_path, str(script))
    assert status == 0, errors
    assert printed.strip()
    if made := LEAVES.get(script.name[:2]):
        assert (tmp_path / made).is_file()
