"""A forked process draws what this one draws, and says what goes wrong.

A process of pytest has threads, so that nothing is forked there: a fresh one does it.
"""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path

import pytest

from ambinav.studies.audit.drawing import drawing
from ambinav.studies.audit.pictures import save_pictures

FRESH = """
import os, signal, sys
from dataclasses import replace
from pathlib import Path
import shapely
import ambinav as an
from ambinav.studies.audit.audit import audit
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import silent
from ambinav.studies.audit.drawing import DrawingProcess, drawing

env = an.environment_from_shapes([shapely.box(0, 0, 8, 3)], name="room")
sensor = an.RangeSensor(max_range=2.0, std=0.03, resolution=0.001)
scanner = an.RangeScanner.planar(sensor, 24, 6.283185, name="laser")
folder = Path(sys.argv[1])
said = []
with drawing() as draw:
    assert isinstance(draw.__self__, DrawingProcess)
    found = audit(an.build_map(env, scanner, spacing=0.25, store=False), env, scanner, places=2)
    draw(found, folder / "apart", said.append, "png")
    assert said[-1] == 1.0 and said == sorted(said), said
    assert "matplotlib.figure" not in sys.modules
    (folder / "nowhere").touch()
    try:
        draw(found, folder / "nowhere", silent, "png")
    except InputError as error:
        print(error)
    try:
        draw(replace(found, findings=(None,)), folder / "apart", silent, "png")
    except RuntimeError as error:
        print(str(error).splitlines()[0])
    process = draw.__self__.process
    os.kill(process.pid, signal.SIGKILL)
    try:
        draw(found, folder / "apart", silent, "png")
    except RuntimeError as error:
        print(error)
from ambinav.studies.audit.pictures import save_pictures
save_pictures(found, folder / "here")
"""


@pytest.mark.slow
def test_a_process_draws_the_same_and_says_what_goes_wrong(tmp_path: Path) -> None:
    for name in ("apart", "here"):
        (tmp_path / name).mkdir()
    done = subprocess.run(
        [sys.executable, "-c", FRESH, str(tmp_path)], capture_output=True, text=True, timeout=200
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert "nowhere cannot be made (File exists); choose another output" in lines[0]
    assert lines[1:] == [
        "the pictures cannot be drawn",
        "the process that draws the pictures was killed, perhaps for lack of memory",
    ]
    names = sorted(path.name for path in (tmp_path / "here").iterdir())
    assert len(names) > 3
    for name in names:
        assert (tmp_path / "apart" / name).read_bytes() == (tmp_path / "here" / name).read_bytes()


def test_nothing_is_forked_beside_threads() -> None:
    ended = threading.Event()
    other = threading.Thread(target=ended.wait)
    other.start()
    try:
        with drawing() as draw:
            assert draw is save_pictures
    finally:
        ended.set()
        other.join()
