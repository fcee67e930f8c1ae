"""The Dockerfile, as far as it can be tried without Docker: what is copied, and what is run."""

from __future__ import annotations

import fnmatch
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from ambinav.cli import app
from tests.forked import ForkServer

ROOT = Path(__file__).parents[1]
WARM = "/tmp/warm"


def instructions() -> list[tuple[str, str]]:
    """Each instruction of the Dockerfile with its arguments, on one line."""
    lines = (ROOT / "Dockerfile").read_text().splitlines()
    text = "\n".join(line for line in lines if not line.startswith("#"))
    whole = re.sub(r"\\\n\s*", " ", text).splitlines()
    return [(name, rest) for name, _, rest in (line.partition(" ") for line in whole if line)]


def copied() -> list[str]:
    """What is copied from the repository."""
    arguments = [rest.split() for name, rest in instructions() if name == "COPY"]
    return [name for words in arguments if words[0][:2] != "--" for name in words[:-1]]


def test_the_base_is_pinned_by_its_digest() -> None:
    bases = {rest.split()[0] for name, rest in instructions() if name == "FROM"}
    assert len(bases) == 1 and re.fullmatch(r"python:3\.11[\w.-]*@sha256:[0-9a-f]{64}", *bases)


def ignored(name: str) -> bool:
    """Whether .dockerignore keeps a path out: the last pattern that fits it or a folder decides."""
    found = False
    path = Path(name)
    for pattern in (ROOT / ".dockerignore").read_text().split():
        plain = pattern.removeprefix("!")
        for part in (path, *path.parents[:-1]):
            if part.match(plain) if "**" in plain else fnmatch.fnmatch(str(part), plain):
                found = not pattern.startswith("!")
    return found


def commands() -> list[list[str]]:
    """The arguments of every call of ambinav."""
    found = []
    for name, rest in instructions():
        if name == "RUN":
            calls = (shlex.split(part) for part in rest.split("&&"))
            plain = ([word for word in call if not re.match(r"[A-Z_]+=", word)] for call in calls)
            found += [call[1:] for call in plain if call[0] == "ambinav"]
    entry, default = (
        json.loads(next(rest for name, rest in instructions() if name == wanted))
        for wanted in ("ENTRYPOINT", "CMD")
    )
    assert entry[0] == "ambinav"
    return [*found, [*entry[1:], *default]]


def test_what_is_copied_is_there_and_not_ignored() -> None:
    assert copied()
    for name in copied():
        assert (ROOT / name).exists(), name
        assert not ignored(name), name


def test_code_that_was_compiled_elsewhere_stays_out() -> None:
    assert not ignored("ambinav/version.py")
    for name in ("ambinav/__pycache__/x.pyc", "ambinav/layers/__pycache__/x.nbi", ".git", "tests"):
        assert ignored(name), name


@pytest.mark.parametrize("arguments", commands(), ids=lambda arguments: arguments[0])
def test_every_call_is_one_that_ambinav_takes(arguments: list[str]) -> None:
    group: Any = get_command(app)  # of the click that typer has of its own
    context = group.context_class(group)
    name, command, rest = group.resolve_command(context, arguments)
    command.make_context(name, rest, parent=context)


def test_the_health_check_asks_what_the_server_answers() -> None:
    check = next(rest for name, rest in instructions() if name == "HEALTHCHECK")
    assert "http://127.0.0.1:8765/v1/ready" in check
    *_, code = json.loads(check[check.index("[") :])
    compile(code, "HEALTHCHECK", "exec")
    entry = next(rest for name, rest in instructions() if name == "ENTRYPOINT")
    assert json.loads(entry)[4:6] == ["--port", "8765"]


@pytest.mark.slow
def test_what_is_copied_makes_the_wheel(tmp_path: Path) -> None:
    skipped = shutil.ignore_patterns("__pycache__")
    for name in copied():
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, tmp_path / name, ignore=skipped)
        else:
            shutil.copy(ROOT / name, tmp_path)
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel"]
    subprocess.run(build, cwd=tmp_path, check=True)
    assert list((tmp_path / "dist").glob("ambinav-*.whl"))


@pytest.fixture
def ambinav() -> Iterator[ForkServer]:
    """Runs the commands, and says which machine code they read or write."""
    modules = ("cli.audit", "studies.audit.report", "map_building.build", "server.http.app")
    environment = {**os.environ, "NUMBA_DEBUG_CACHE": "1"}
    server = ForkServer(environment, *(f"ambinav.{name}" for name in modules))
    yield server
    server.close()


@pytest.mark.sweep
def test_what_the_image_compiles_leaves_nothing_to_compile(
    tmp_path: Path, ambinav: ForkServer
) -> None:
    """By the names of the machine code that is read or written: what the tests share is used."""
    run = next(rest for name, rest in instructions() if name == "RUN" and WARM in rest)
    # Processes for plans and edits import it again.
    guarded = (
        "from pathlib import Path\n"
        "from matplotlib.figure import Figure\n"
        "from ambinav.cli import main\n"
        # Pictures take half of the time, and compile nothing.
        "Figure.savefig = lambda self, path, **options: Path(path).write_bytes(b'')\n"
        "if __name__ == '__main__':\n"
        "    main()\n"
    )
    (tmp_path / "call.py").write_text(guarded)

    def code(*words: str) -> set[str]:
        status, printed, errors = ambinav(tmp_path, "call.py", *words)
        assert status == 0, errors
        return set(re.findall(r"data (?:loaded from|saved to) '(.*)'", printed))

    # The shell itself puts the arguments together, line by line.
    line = run.partition(f"&& rm -r {WARM}")[0].replace(WARM, "warm")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    calls = subprocess.run(
        'ambinav() { printf "%s\\t" "$@"; echo; }; ' + line, shell=True, check=True,
        capture_output=True, text=True, env={**os.environ, "PATH": path},
    ).stdout  # fmt: skip
    arguments = [call.split("\t")[:-1] for call in calls.splitlines()]
    assert [words[0] for words in arguments] == ["audit", "plan", "serve"]
    # Less than what the image runs, so that what suffices here does so there too. That a map can be
    # served is seen in tests/server.
    audited, planned, _ = arguments
    compiled = code(*audited, "--no-advice") | code(*planned)
    building = str(ROOT / "ambinav" / "demo" / "demo.geojson")
    audit = code(
        "audit", building, "-s", "rplidar-a1", "--spacing", "0.5", "--no-advice", "-o", "report"
    )
    assert len(audit) > 10 and audit <= compiled
    plan = code(
        "plan", "warm/map.zarr", "--start", "3", "3", "--goal", "20", "13",
        "--planner", "reference", "-o", "r.csv",
    )  # fmt: skip
    assert len(plan) > 10 and plan <= compiled
