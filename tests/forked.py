"""A process that forks for each script, so that what all scripts import is imported once."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

SERVER = """
import atexit, importlib, json, multiprocessing.process, os, runpy, sys, threading, traceback
for name in sys.argv[1:]:
    importlib.import_module(name)
if "numba" in sys.modules:
    # The half of a second in which numba gets ready for its first kernel.
    from numba.core.registry import cpu_target
    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()

def status_of(script):
    try:
        runpy.run_path(script, run_name="__main__")
    except SystemExit as ended:
        if ended.code is None or isinstance(ended.code, int):
            return ended.code or 0
        print(ended.code, file=sys.stderr)
        return 1
    except BaseException:
        traceback.print_exc()
        return 1
    return 0

for line in sys.stdin:
    folder, *sys.argv = json.loads(line)
    if os.fork() == 0:
        os.chdir(folder)
        # Processes that it starts look for the script there.
        sys.path[0] = multiprocessing.process.ORIGINAL_DIR = folder
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        for number, name in ((1, "stdout.txt"), (2, "stderr.txt")):
            os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        status = status_of(sys.argv[0])
        # As at the end of a process, but that modules are not taken apart, which takes a second.
        threading._shutdown()
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    print(os.waitstatus_to_exitcode(os.wait()[1]), flush=True)
"""


class ForkServer:
    """A process with these modules; each script runs in a copy of it, as in a fresh process.

    Modules are sought in `folder` first: the working folder of the process.
    """

    def __init__(
        self, environment: Mapping[str, str], *modules: str, folder: Path | None = None
    ) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", SERVER, *modules], env=environment, text=True, cwd=folder,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip

    def __call__(self, folder: Path, script: str, *arguments: str) -> tuple[int, str, str]:
        """Run a script in its folder; return its exit status and what it prints, with errors."""
        assert self.process.stdin and self.process.stdout
        print(json.dumps([str(folder), script, *arguments]), file=self.process.stdin, flush=True)
        status = int(self.process.stdout.readline())
        printed, errors = ((folder / f"{name}.txt").read_text() for name in ("stdout", "stderr"))
        return status, printed, errors

    def close(self) -> None:
        """End the process."""
        self.process.communicate(timeout=60)
