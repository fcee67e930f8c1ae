"""The Python of README.md and of the documentation runs as it stands there, block after block."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.forked import ForkServer

ROOT = Path(__file__).parents[1]
PATHS = os.pathsep.join(str(ROOT / name) for name in ("", "envs", "planners", "benchmarks"))
BLOCK = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)

DEMO = """
import math
import numpy as np
import ambinav as an
from ambinav.demo import DEMO_BUILDING
env = an.load_environment(DEMO_BUILDING)
scanner = an.RangeScanner.planar(
    sensor=an.RangeSensor(max_range=4.0, std=0.03, resolution=0.001), beams=60, aperture=math.tau
)
amap = an.build_map(env, scanner, spacing=0.4)
x, y = 3.0, 3.0
"""
PLACES = """
from pathlib import Path
Path("places.yaml").write_text("places: {dock: [19.3, 21.7], hall: [9, 21]}")
"""
COMPARED = """
rng = np.random.default_rng(1)
drives, shortest_drives = (
    an.drive_route(env, scanner, an.Robot(), route, "ekf", rng, runs=3)
    for route in (an.Route.through([(3, 3), (3.5, 3), (5, 3)]), an.Route.through([(3, 3), (5, 3)]))
)
"""
SCANS = """
poses = np.array([[3.0, 3.0, 0.0], [20.0, 13.0, 0.0]])
ranges = scanner.read(env, *poses.T, np.random.default_rng(1))
odometry_covariance = prior = np.diag([0.01, 0.01, 0.0025])
pose_covariance = np.diag([0.0025, 0.0025, 0.0004])
"""
EPISODE = """
import ambinav_envs
import gymnasium as gym
import numpy as np
env = gym.make("ambinav/Hall-v1", waypoint=True, buildings=1)
observations = {name: part[None] for name, part in env.reset(seed=1)[0].items()}
starts = np.array([True])
"""
SMALL = """
from pathlib import Path
Path("small.yaml").write_text(
    "{algorithm: ppo, steps: 9, envs: 4, threads: 1, "
    "environment: {id: ambinav/Hall-v1, buildings: 2, longest: 8, max_steps: 30}, "
    "evaluation: {episodes: 2, every: 512, environment: {first_building: 900, buildings: 2}}, "
    "hyperparameters: {n_steps: 64, n_epochs: 1}}"
)
"""


@dataclass(frozen=True)
class Page:
    """A page whose blocks are run.

    Attributes:
        name: From the root of the repository.
        given: Code that makes what the page takes for given.
        shorter: What is put in the place of numbers and files with which it would take minutes.
    """

    name: str
    given: str = ""
    shorter: dict[str, str] = field(default_factory=dict)


PAGES = (
    Page(
        "README.md",
        shorter={
            "spacing=0.1": "spacing=0.5",
            '"ambinav/Office-v1", num_envs=64': '"ambinav/Office-v1", num_envs=2, buildings=2',
        },
    ),
    Page("docs/concepts/rays-in-space.md", DEMO, {"runs=10": "runs=1"}),
    Page("docs/howto/audit-in-ci.md", shorter={'"0.2"': '"0.5"'}),
    Page("docs/howto/change.md", shorter={"spacing=0.2": "spacing=0.4"}),
    Page("docs/howto/export.md"),
    Page("docs/howto/my-scanner.md"),
    Page("docs/howto/nav2.md"),
    Page("docs/howto/ompl.md"),
    Page("docs/howto/plans.md"),
    Page("docs/howto/read-the-report.md", shorter={"spacing=0.2": "spacing=0.5"}),
    Page("docs/howto/store.md"),
    Page("docs/howto/reflectors.md", shorter={"most=60": "most=20"}),
    Page("docs/howto/serve.md"),
    Page("docs/howto/share-a-policy.md"),
    Page("docs/howto/sweep.md"),
    Page("docs/howto/tiles.md"),
    Page("docs/howto/train-a-policy.md", shorter={"2048": "512"}),
    Page("docs/howto/train-in-processes.md"),
    Page("docs/howto/what-would-help.md"),
    Page("docs/howto/which-scanner.md"),
    Page("docs/audit.md", DEMO + PLACES),
    Page("docs/compare.md", DEMO + COMPARED),
    Page(
        "docs/environments.md",
        shorter={
            '"ambinav/Procedural-v1", 64, buildings=64': '"ambinav/Procedural-v1", 4, buildings=2',
            "n_steps=128, batch_size=2048": "n_steps=64, batch_size=128",
            "100_000": "256",
            'render_mode="rgb_array", reward="ambiguity"': 'render_mode="rgb_array", buildings=1',
            "range(125)": "range(5)",
        },
    ),
    Page(
        "docs/forecast.md",
        shorter={
            "spacing=0.1": "spacing=0.3",
            # Where the odometry is good enough for the shortest route, no other is sought.
            'Forecaster(amap, "poor"': 'Forecaster(amap, "good"',
            "forecaster, 0.05": "forecaster, 0.5",
        },
    ),
    Page("docs/layers.md", DEMO),
    Page("docs/leaderboard.md", EPISODE, {"run/best.zip": "vfh"}),
    Page("docs/localizability.md", DEMO + SCANS),
    Page("docs/lost-routes.md"),
    Page("docs/tasks.md"),
    Page(
        "docs/training.md",
        SMALL,
        {
            "configs/ppo.yaml": "small.yaml",
            "100_000": "512",
            '"ambinav/Procedural-v1", window=False)': '"ambinav/Procedural-v1", 2, buildings=2), '
            "n_steps=16, batch_size=32",
            "10_000": "32",
        },
    ),
)
ELSEWHERE = {
    **{
        path.relative_to(ROOT).as_posix(): "tests/stranger"
        for path in ROOT.glob("docs/howto/add-a*.md")
    },
    "docs/planning.md": "tests/planners/test_docs.py",
    "docs/real-scans.md": "its data",
}
"""Pages that are tested elsewhere, or that need recorded data."""


def test_no_page_is_left_out():
    own = [path for path in ROOT.glob("*.md")] + [
        path for path in ROOT.glob("docs/**/*.md") if "_generated" not in path.parts
    ]
    having = {
        path.relative_to(ROOT).as_posix()
        for path in own
        if BLOCK.search(path.read_text(encoding="utf-8"))
    }
    assert having == {page.name for page in PAGES} | set(ELSEWHERE)


@pytest.fixture(scope="module")
def python() -> Iterator[ForkServer]:
    settings = {"PYTHONPATH": PATHS, "MPLBACKEND": "agg", "SDL_VIDEODRIVER": "dummy"}
    modules = (
        "ambinav.studies.audit.report", "ambinav_envs.training.run", "matplotlib.pyplot",
        "stable_baselines3", "tests.kernels_at_hand",
    )  # fmt: skip
    server = ForkServer({**os.environ, **settings}, *modules)
    yield server
    server.close()


# The longest: what they call is called by tests of audits, training and the leaderboard too.
SWEPT = {
    "docs/howto/audit-in-ci.md", "docs/howto/read-the-report.md", "docs/howto/reflectors.md",
    "docs/howto/train-a-policy.md", "docs/leaderboard.md", "docs/training.md",
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=pytest.mark.sweep if page.name in SWEPT else ()) for page in PAGES],
    ids=lambda page: page.name,
)
def test_the_blocks_run(page, tmp_path, python):
    code = "\n".join(BLOCK.findall((ROOT / page.name).read_text(encoding="utf-8")))
    for long, short in page.shorter.items():
        assert long in code, f"{page.name} has no {long!r} any more"
        code = code.replace(long, short)
    (tmp_path / "page.py").write_text(page.given + code, encoding="utf-8")
    status, _, errors = python(tmp_path, "page.py")
    assert status == 0, errors


def test_the_readme_is_short():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 120
