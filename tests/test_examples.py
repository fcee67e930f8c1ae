"""The scripts of examples/ run as they stand, each in a folder of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PATHS = os.pathsep.join(str(ROOT / name) for name in ("", "envs", "planners"))
SCRIPTS = sorted((ROOT / "examples").glob("*.py"))
ARGUMENTS = {"06": ["--steps", "8192"]}
"""Cut short, by its number."""
LEAVES = {"01": "out/01-level.png"}
"""What a script writes, by its number."""


def test_examples_are_numbered_and_listed():
    listed = (ROOT / "examples" / "README.md").read_text(encoding="utf-8")
    assert [script.name[:2] for script in SCRIPTS] == [f"{n:02d}" for n in range(1, 7)]
    assert all(f"[{script.name}]({script.name})" in listed for script in SCRIPTS)


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_an_example_runs(script, tmp_path):
    done = subprocess.run(
        [
            sys.executable,
            "-W",
            "error::ambinav.runtime.errors.InputWarning",
            str(script),
            *ARGUMENTS.get(script.name[:2], []),
        ],
        env={**os.environ, "PYTHONPATH": PATHS, "MPLBACKEND": "agg"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
    if made := LEAVES.get(script.name[:2]):
        assert (tmp_path / made).is_file()
