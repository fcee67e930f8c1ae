"""Maps and servers that the tests of the service share."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import shapely

import ambinav as an
from ambinav.runtime.processes import ChildProcess
from ambinav.server.http.app import create_app
from tests.server.live import Live, running


@pytest.fixture(scope="module", autouse=True)
def forked_workers(request: pytest.FixtureRequest) -> Iterator[None]:
    """Let the server's processes be copies of one, but in the tests of just these."""
    begin = ChildProcess.__init__

    def begun(self: ChildProcess, method: str, *arguments: Any) -> None:
        begin(self, "forkserver" if method == "spawn" else method, *arguments)

    with pytest.MonkeyPatch.context() as patch:
        if request.path.name != "test_edit_processes.py":
            patch.setattr(ChildProcess, "__init__", begun)
        yield


@pytest.fixture(scope="session")
def corridor(plan_map: Path) -> an.AmbiguityMap:
    """A map without headings: a room, a corridor, a door to unknown space, and a room apart."""
    return an.AmbiguityMap.open(plan_map)


@pytest.fixture(scope="session")
def turning() -> an.AmbiguityMap:
    """A map with headings: a room with a pillar."""
    room = shapely.box(0, 0, 4, 2) - shapely.box(3, 0.5, 3.6, 1.1)
    environment = an.environment_from_shapes([room], name="narrow room")
    scanner = an.RangeScanner.planar(
        sensor=an.RangeSensor(max_range=1.5, std=0.02, resolution=0.01), beams=12, aperture=math.pi
    )
    return an.build_map(environment, scanner, spacing=0.25, headings=4)


@pytest.fixture(scope="session")
def live(
    plan_map: Path, turning: an.AmbiguityMap, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Live]:
    """A server of both maps, by the ids `map` and `narrow-room`."""
    with running(create_app([plan_map, turning])) as one:
        yield one


@pytest.fixture
def serve() -> Iterator[Callable[..., Live]]:
    """Starts servers that are ended with the test."""
    with ExitStack() as stack:
        yield lambda *args, **kwargs: stack.enter_context(running(create_app(*args, **kwargs)))
