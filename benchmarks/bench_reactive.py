"""The reactive baselines in disturbed halls and on recorded maps, paired on the same route.

Every method drives the same episodes as in `ambinav benchmark`: boxes that the map lacks, people,
and odometry that errs twice as much as the localizer assumes. Differences are paired episode by
episode, to VFH+ on the same route. What has been driven stays in `--work`; the same
command goes on from there.

    AMBINAV_DATA=/data python benchmarks/bench_reactive.py --out benchmarks/results/reactive.md
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from harness import arguments, environment_path, option, report, table
from method_tables import LIBRARIES, figures_table, silent, titles

from ambinav.reports.table import difference_text
from ambinav_envs.evaluation import Episodes
from ambinav_envs.leaderboard.board import Board, Setting, run, settings_for
from ambinav_envs.leaderboard.figures import make_rows
from ambinav_envs.leaderboard.methods import policy_method

CONDITION: Final = "disturbed"
MAPS: Final = ("intel", "freiburg-079", "aces", "belgioioso")
PAIRS: Final[Mapping[str, tuple[str, ...]]] = {"vfh-aware": ("dwa-aware",), "vfh": ("dwa",)}
"""The others that drive on the same route."""
COMPARED: Final = ("arrived", "collided", "lost")
BUILDINGS: Final = 100


def section(setting: Setting, episodes: Mapping[str, Episodes], seed: int) -> str:
    """Return a setting's tables: figures, then differences to VFH+ on the same route."""
    rows = make_rows(setting.name, episodes, None, seed)
    figures = figures_table(rows)
    lines = []
    for policy, baselines in PAIRS.items():
        paired = make_rows(setting.name, episodes, policy, seed)
        for row in paired:
            if row.method in baselines:
                texts = [difference_text(row[key]) for key in COMPARED]
                lines.append((f"{row.method} less {policy}", *texts))
    differences = table(("paired", *titles(COMPARED, rows[0])), lines)
    return f"## {setting.name}, {rows[0].episodes} episodes\n\n{figures}\n\n{differences}"


def main() -> None:
    """Drive, and report."""
    chosen = arguments(
        __doc__, episodes=128, seed=3, maps=option(MAPS, nargs="*"), work=Path("out/reactive")
    )
    names = [name for policy, rivals in PAIRS.items() for name in (policy, *rivals)]
    paths = [environment_path(name) for name in chosen.maps]
    settings = [
        candidate
        for candidate in settings_for(paths, BUILDINGS, ["hall"])
        if candidate.condition == CONDITION
    ]
    chosen.work.mkdir(parents=True, exist_ok=True)
    methods = [policy_method(name) for name in names]
    sections = []
    for setting in settings:
        board = Board(methods, [setting], chosen.episodes, chosen.seed)
        episodes = run(board, chosen.work, silent)[setting.name]
        sections.append(section(setting, episodes, chosen.seed))
    text = (
        "Seeds of the episodes are none that the baselines' parameters were chosen on. In "
        "brackets: 95 % intervals over buildings and episodes in them.\n\n"
    )
    report("Reactive baselines", LIBRARIES, text + "\n\n".join(sections), chosen.out)


if __name__ == "__main__":
    main()
