"""The notebooks of examples/ run from their first cell, and what they store is what they show."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
RUNNER = ROOT / "docs" / "site" / "run_notebooks.py"
LARGEST = 600_000
"""Bytes of a notebook with its pictures: the history keeps every version."""

pytestmark = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def cells(path: Path, kind: str) -> list[dict[str, Any]]:
    content = json.loads(path.read_text(encoding="utf-8"))
    return [cell for cell in content["cells"] if cell["cell_type"] == kind]


def words(path: Path) -> list[str]:
    """What is printed, without numbers: another processor may compute others."""
    texts = [
        "".join(output["text"])
        for cell in cells(path, "code")
        for output in cell["outputs"]
        if output["output_type"] == "stream"
    ]
    return [word for text in texts for word in re.sub(r"[-+]?\d[\d.]*|\bnan\b", " ", text).split()]


def pictures(path: Path) -> int:
    return sum(
        "image/png" in output.get("data", {})
        for cell in cells(path, "code")
        for output in cell["outputs"]
    )


def test_a_notebook_is_listed(path):
    for page in ("examples/README.md", "docs/notebooks.md"):
        assert path.name in (ROOT / page).read_text(encoding="utf-8")


def test_a_notebook_teaches(path):
    assert pictures(path) >= 1
    assert path.stat().st_size < LARGEST
    texts = ["".join(cell["source"]) for cell in cells(path, "markdown")]
    assert texts[0].startswith("# ")
    assert "## What to try next\n" in texts[-1]


def test_the_stored_outputs_are_of_the_cells_as_they_stand(path):
    code = "\0".join("".join(cell["source"]) for cell in cells(path, "code"))
    stored = json.loads(path.read_text(encoding="utf-8"))["metadata"]["code_sha256"]
    assert sha256(code.encode()).hexdigest() == stored, "run: make notebooks"


@pytest.mark.sweep
def test_a_notebook_runs(path, tmp_path):
    done = subprocess.run(
        [sys.executable, str(RUNNER), str(path), "--out", str(tmp_path)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    made = tmp_path / path.name
    assert words(made) == words(path), "run: make notebooks"
    assert pictures(made) == pictures(path)
