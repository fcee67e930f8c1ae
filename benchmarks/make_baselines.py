"""Train the shipped policies, write each with its card into the package, and report.

Both are trained by `ambinav train configs/ppo.yaml`: `ppo-ambiguity` as that is, `ppo-shortest`
with the reward `shortest` and the shortest path to follow (`ambiguity_weight: 0`), and nothing else
different. A training that is in its folder already is not run again. The report says how long the
trainings took and how arrival rose; the picture of one of them goes to docs/images.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml
from harness import ROOT, arguments, option, report, table
from method_tables import LIBRARIES, figures_table

from ambinav_envs.evaluation import UNSEEN, evaluate
from ambinav_envs.leaderboard.board import CONDITIONS
from ambinav_envs.leaderboard.figures import make_rows
from ambinav_envs.policies import Card, load_policy, upgrade_policy
from ambinav_envs.policies.file import read_policy_file, write_policy_file
from ambinav_envs.policies.load import BASELINES
from ambinav_envs.scenario import scenario
from ambinav_envs.training import folder as files
from ambinav_envs.training.progress import Row, read_rows

CONFIG = ROOT / "configs" / "ppo.yaml"
OUT = ROOT / "benchmarks" / "results" / "baselines.md"
PICTURE = ROOT / "docs" / "images" / "training-curve.png"
PICTURED = "ppo-ambiguity"
POLICIES: dict[str, dict[str, Any]] = {
    "ppo-shortest": {"reward": "shortest", "ambiguity_weight": 0},
    "ppo-ambiguity": {},
}
"""Arguments of the environment that are not the configuration's."""
TRAINED_AT = "d655462224ff5680156bae133ad28f4da020ab02"
"""Commit that the shipped policies were trained at, as benchmarks/results/baselines.md says. Its
defaults of scanner (60 beams of 4 m all around) and robot (0.22 m, 0.5 m/s) are those of when their
cards were completed."""
BUILDINGS, EPISODES, SEED = 100, 1000, 1
SHOWN = ("arrived", "missed", "collided", "lost", "error", "length", "exposure")
CURVE = ("eval_arrived", "eval_missed", "eval_collided", "eval_timeout", "eval_lost")
WANTED = 0.9
"""Share of the judged episodes that is to arrive."""


def train(name: str, folder: Path, threads: int) -> Path:
    """Train a policy, or resume its training; return the run's folder."""
    run = folder / name
    if not (run / files.FINAL).is_file():
        settings = yaml.safe_load(CONFIG.read_text(encoding="utf-8"))
        settings["environment"].update(POLICIES[name])
        settings["threads"] = threads
        config = folder / f"{name}.yaml"
        config.write_text(yaml.safe_dump(settings, sort_keys=False), encoding="utf-8")
        words = ["train", str(config), "-o", str(run)]
        words += ["--resume"] if (run / files.CONFIG).is_file() else []
        subprocess.run([sys.executable, "-m", "ambinav.cli", *words], check=True)
    return run


def judged(name: str) -> str:
    """Return a table of a policy's figures in unseen buildings."""
    policy = load_policy(name)
    rows = []
    source = None
    for condition, changed in CONDITIONS.items():
        settings = {**policy.environment, "obstacles": 0, "odometry_scale": 1.0, **changed}
        settings.pop("suite", None)
        fresh, parameters = scenario("procedural", None, BUILDINGS, UNSEEN, None, settings)
        # The buildings do not depend on the condition, and are cached.
        source = source or fresh
        episodes = evaluate(policy, source, parameters, EPISODES, SEED)
        rows += make_rows(condition, {condition: episodes}, None, SEED)
    return figures_table(rows, SHOWN)


def card_text(name: str, card: Card, settings: Mapping[str, Any], figures: str) -> str:
    """Return the card: description of a policy, its results, and their limits."""
    versions = ", ".join(f"{package} {version}" for package, version in card.versions.items())
    environment = settings["environment"]
    trained = ", ".join(f"{key} {value}" for key, value in environment.items())
    weight = environment["ambiguity_weight"]
    path = f"path on which a metre counts 1 + {weight:g} * ambiguity" if weight else "shortest path"
    return f"""# {name}

{card.algorithm} with the reward `{environment["reward"]}`, {card.steps:,} steps, seed {card.seed}.
Trained in:
{trained}.

`ambinav train configs/ppo.yaml` with these arguments; again: `python benchmarks/make_baselines.py`.
Network {settings["policy"]["net_arch"]} after one layer of convolutions over scan and window.
{versions}.

## In {BUILDINGS} procedural buildings that it has never seen, {EPISODES} episodes

{figures}

In brackets: 95 % intervals over buildings and episodes in them. What conditions
and figures are: docs/leaderboard.md. How arrival rose: benchmarks/results/baselines.md.

## What this does not show

- One training with one seed. What the ambiguity reward does, over several seeds:
  benchmarks/results/ablation.md.
- It sees a waypoint 1.5 m ahead on the {path},
  from its estimated pose: it does not find the route by itself, it drives it.
- Its laser has 60 beams of 4 m all around, its robot a radius of 0.22 m. Another scanner or robot
  is another task: train anew.
"""


def course_of(run: Path, rows: Sequence[Row]) -> str:
    """Describe a training: its setup, duration, and rise of the arrival rate."""
    about = files.read_json(run / files.ABOUT)
    last = rows[-1]
    steps, minutes = int(last["steps"] or 0), (last["seconds"] or 0.0) / 60.0
    judged_rows = [row for row in rows if row["eval_episodes"]]
    there = next((row for row in judged_rows if (row["eval_arrived"] or 0.0) >= WANTED), None)
    first = "never"
    if there is not None:
        first = f"after {there['steps']:,.0f} steps, {(there['seconds'] or 0.0) / 60.0:.1f} minutes"
    versions = ", ".join(f"{name} {version}" for name, version in about["versions"].items())
    lines = [
        f"{steps:,} steps in {minutes:.1f} minutes, evaluations and checkpoints included and maps "
        f"of the buildings not; {about['threads']} thread of torch and of the simulation, "
        f"{about['cores']} cores, the other training beside it. {100 * WANTED:.0f} % of the judged "
        f"episodes arrive: first {first}.",
        f"- begun: {about['sessions'][0]['started']}, in {len(about['sessions'])} session(s)\n"
        f"- commit: {about['commit']}\n"
        f"- versions: {versions}",
    ]
    shown = [
        (f"{row['steps']:,.0f}", f"{(row['seconds'] or 0.0) / 60.0:.1f}",
         *(f"{100.0 * (row[name] or 0.0):.1f}" for name in CURVE))
        for row in judged_rows
    ]  # fmt: skip
    titles = [f"{name.removeprefix('eval_')} %" for name in CURVE]
    return "\n\n".join([*lines, table(("steps", "minutes", *titles), shown, words=0)])


def main() -> None:
    """Train what is missing, and write the package's files and the report."""
    args = arguments(
        __doc__,
        folder=option(Path("out/baselines"), "of trainings"),
        out=option(OUT, "the report"),
        jobs=2,
        threads=option(1, "of each training"),
        report_only=option(
            None,
            "train nothing and leave the shipped policies: judge them, and write cards, report and "
            "picture from the trainings in this folder, which must be theirs",
            type=Path,
            metavar="FOLDER",
        ),
        cards_only=option(
            False,
            "train nothing, judge nothing and leave the weights: write shipped files of earlier "
            "versions in the present format, with scanner and robot in their cards",
        ),
    )
    if args.cards_only:
        for name in POLICIES:
            done = upgrade_policy(BASELINES / f"{name}.zip", {"commit": TRAINED_AT})
            print(f"{name}: {'written anew' if done else 'up to date'}")
        return
    if args.report_only is None:
        args.folder.mkdir(parents=True, exist_ok=True)
        with ThreadPoolExecutor(args.jobs) as pool:
            runs = pool.map(lambda name: train(name, args.folder, args.threads), POLICIES)
            made = dict(zip(POLICIES, list(runs), strict=True))
    else:
        made = {name: args.report_only / name for name in POLICIES}
    parts = [
        "Both by `ambinav train configs/ppo.yaml`, with another reward and another path to follow "
        "each, one seed. Judged while "
        "they train: 200 episodes, always the same, in 100 procedural buildings that they never "
        "train in, boxes and odometry as in training."
    ]
    for name, run in made.items():
        policy = read_policy_file(run / files.FINAL)
        notes = {key: policy.card.notes[key] for key in ("training", "trained_in")}
        if args.report_only is None:
            shipped = replace(policy, card=replace(policy.card, notes=notes))
            write_policy_file(shipped, BASELINES / f"{name}.zip")
        figures = judged(name)
        text = card_text(name, policy.card, notes["training"], figures)
        (BASELINES / f"{name}.md").write_text(text, encoding="utf-8")
        parts += [f"## {name}", course_of(run, read_rows(run / files.PROGRESS))]
        parts += [
            f"The last policy, which is the shipped one, in {BUILDINGS} other buildings (from "
            f"number {UNSEEN:,} on), {EPISODES} episodes:",
            figures,
        ]
    shutil.copyfile(made[PICTURED] / files.CURVE, PICTURE)
    report("The policies that are shipped", LIBRARIES, "\n\n".join(parts), args.out)


if __name__ == "__main__":
    main()
