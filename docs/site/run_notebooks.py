"""Run the notebooks of examples/ from their first cell, and store what they show.

`make notebooks` runs all of them in place. The site shows the stored outputs, so that building it
runs none of them; `tests/test_notebooks.py` runs each, and sees that it prints the same words;
numbers may differ.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import sys
import tempfile
from pathlib import Path
from typing import Final

import nbformat
from nbclient import NotebookClient

ROOT: Final = Path(__file__).parents[2]
NOTEBOOKS: Final = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
PATHS: Final = [str(ROOT / name) for name in ("", "envs", "planners")]
CELL_SECONDS: Final = 600
"""Longest time of a cell, on a machine with other work."""


def digest(notebook: nbformat.NotebookNode) -> str:
    """Return the SHA-256 of the code, which tells whether the stored outputs are of it."""
    code = "\0".join(cell.source for cell in notebook.cells if cell.cell_type == "code")
    return hashlib.sha256(code.encode()).hexdigest()


def run(path: Path, folder: Path) -> nbformat.NotebookNode:
    """Run a notebook in a folder, and return it with its outputs.

    Raises:
        CellExecutionError: a cell failed.
        RuntimeError: a cell wrote to stderr, where warnings go.
    """
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(
        notebook,
        timeout=CELL_SECONDS,
        kernel_name="python3",
        record_timing=False,
        resources={"metadata": {"path": str(folder)}},
    ).execute()
    for number, cell in enumerate(notebook.cells):
        for output in cell.get("outputs", ()):
            if output.get("name") == "stderr":
                raise RuntimeError(f"{path.name}, cell {number} wrote to stderr:\n{output.text}")
    notebook.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
        "code_sha256": digest(notebook),
    }
    return notebook


def main() -> None:
    """Run the notebooks that are named, or all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("notebooks", nargs="*", type=Path, default=NOTEBOOKS)
    parser.add_argument("--out", type=Path, help="folder to write to; by default in place")
    args = parser.parse_args()
    inherited = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = os.pathsep.join([*PATHS, *([inherited] if inherited else [])])
    for path in args.notebooks:
        with tempfile.TemporaryDirectory() as folder:
            notebook = run(path, Path(folder))
        nbformat.write(notebook, (args.out or path.parent) / path.name)
        print(path.name, file=sys.stderr)


if __name__ == "__main__":
    main()
