"""A headless browser and a server, for scripts that test the page."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

FLAGS = ("--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage")


@contextmanager
def browser() -> Iterator[Any]:
    """Start a headless chromium of this machine, with Playwright."""
    from playwright.sync_api import sync_playwright

    path = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as drivers:
        opened = drivers.chromium.launch(executable_path=path, args=list(FLAGS))
        yield opened
        opened.close()


@contextmanager
def serving(maps: Sequence[Path]) -> Iterator[str]:
    """Run `ambinav serve` with maps on a free port; yield its address."""
    command = [sys.executable, "-m", "ambinav.cli", "serve", *map(str, maps), "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        if not line:
            raise SystemExit(f"{' '.join(command)} did not start.")
        yield line.split()[0]
    finally:
        process.terminate()
        process.wait(30)
