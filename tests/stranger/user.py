"""A user of the plug-in: one process that runs many commands, as each takes seconds to start."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PLUGIN = Path(__file__).parent / "plugin"
SHELL = """\
import json, runpy, sys
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typer.testing import CliRunner
from ambinav.cli import app

for line in sys.stdin:
    command, *arguments = json.loads(line)
    status, output = 0, StringIO()
    with redirect_stdout(output):
        if command == "ambinav":
            done = CliRunner().invoke(app, arguments)
            status = done.exit_code
            output.write(done.output if status else done.stdout)
        elif command == "cat":
            output.write(Path(*arguments).read_text())
        elif command == "python":
            runpy.run_path(*arguments)
    print(json.dumps([status, output.getvalue()]), flush=True)
"""


def environment(folder: Path) -> dict[str, str]:
    paths = [folder / "site", PLUGIN, ROOT, ROOT / "envs", ROOT / "planners"]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, paths))}


class User:
    """A process that has the plug-in on its path and runs commands.

    Attributes:
        folder: Where it works.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.process = subprocess.Popen(
            [sys.executable, "-c", SHELL], cwd=folder, env=environment(folder), text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip

    def __call__(self, *command: str, status: int = 0) -> str:
        """Run `ambinav`, `cat` or `python` with arguments, and return what is printed."""
        assert self.process.stdin and self.process.stdout
        print(json.dumps(command), file=self.process.stdin, flush=True)
        ended, output = json.loads(self.process.stdout.readline())
        assert ended == status, output
        return str(output)

    def python(self, code: str) -> str:
        """Run code."""
        (self.folder / "code.py").write_text(code)
        return self("python", "code.py")
