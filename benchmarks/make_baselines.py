"""Train the policies that ambinav ships, and put each with its card into the package.

Both are trained by `ambinav train configs/ppo.yaml`, with the rewards `shortest` and `ambiguity`
and nothing else different. A training that is in its folder already is not run again.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import yaml
from harness import ROOT, table
from stable_baselines3 import PPO

from ambinav.compare.leaderboard.board import CONDITIONS
from ambinav.compare.leaderboard.figures import make_rows, value_text
from ambinav_envs.evaluation import evaluate
from ambinav_envs.policies import load_policy, save_policy
from ambinav_envs.policies.file import Card, arguments_of, read_card
from ambinav_envs.policies.load import BASELINES
from ambinav_envs.scenario import scenario

CONFIG = ROOT / "configs" / "ppo.yaml"
POLICIES = {"ppo-shortest": "shortest", "ppo-ambiguity": "ambiguity"}
"""Reward by name of the policy."""
UNSEEN = {"first_building": 1_000_000, "buildings": 100}
EPISODES, SEED = 1000, 1
SHOWN = ("arrived", "missed", "collided", "lost", "error", "length", "exposure")


def train(reward: str, folder: Path, threads: int) -> Path:
    """Train with a reward, or go on with it; returns the policy's file."""
    run = folder / reward
    final = run / "final.zip"
    if not final.is_file():
        told = yaml.safe_load(CONFIG.read_text(encoding="utf-8"))
        told["environment"]["reward"], told["threads"] = reward, threads
        config = folder / f"{reward}.yaml"
        config.write_text(yaml.safe_dump(told, sort_keys=False), encoding="utf-8")
        words = ["train", str(config), "-o", str(run), *(["--resume"] if run.exists() else [])]
        subprocess.run([sys.executable, "-m", "ambinav.cli", *words], check=True)
    return final


def judged(name: str) -> str:
    """Figures of a policy in buildings that it has never seen, as a table."""
    policy = load_policy(name)
    rows = []
    for condition, changed in CONDITIONS.items():
        told = {**policy.environment, "obstacles": 0, "odometry_scale": 1.0, **changed}
        told.pop("suite", None)
        source, parameters = scenario(
            "procedural", None, UNSEEN["buildings"], UNSEEN["first_building"], None, told
        )
        episodes = evaluate(policy, source, parameters, EPISODES, SEED)
        (row,) = make_rows(condition, {name: episodes}, None, SEED)
        rows.append((condition, *(value_text(row[key]) for key in SHOWN)))
    titles = [f"{row[key].figure.title} {row[key].figure.unit}".strip() for key in SHOWN]
    return table(("", *titles), rows)


def card_text(name: str, reward: str, card: Card, told: dict[str, Any]) -> str:
    """What a policy is, what it does, and what that does not show."""
    versions = ", ".join(f"{package} {version}" for package, version in card.versions.items())
    trained = ", ".join(f"{key} {value}" for key, value in arguments_of(card).items())
    return f"""# {name}

{card.algorithm} with the reward `{reward}`, {card.steps:,} steps, seed {card.seed}. Trained in:
{trained}.

`ambinav train configs/ppo.yaml` with this reward; again: `python benchmarks/make_baselines.py`.
Network {told["policy"]["net_arch"]} after one layer of convolutions over scan and window.
{versions}.

## In 100 procedural buildings that it has never seen, {EPISODES} episodes

{judged(name)}

In brackets: 95 % intervals by the bootstrap over episodes. What conditions and figures are:
docs/leaderboard.md.

## What this does not show

- One training with one seed. What the ambiguity reward does, over several seeds:
  benchmarks/results/ablation.md.
- It sees a way point 1.5 m ahead on the shortest way from where it believes to be: it does not
  find the way by itself, it drives it.
- Its laser has 60 beams of 4 m all around, its robot a radius of 0.22 m. Another scanner or robot
  is another task: train anew.
"""


def main() -> None:
    """Train what is not there yet, and write the package's files."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path("out/baselines"), help="of trainings")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--threads", type=int, default=1, help="of each training")
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(args.jobs) as pool:
        files = pool.map(lambda reward: train(reward, args.folder, args.threads), POLICIES.values())
        made = dict(zip(POLICIES, list(files), strict=True))
    for name, path in made.items():
        card = read_card(path)
        told = {key: card.told[key] for key in ("training", "trained_in")}
        save_policy(
            PPO.load(path, device="cpu"), BASELINES / f"{name}.zip",
            environment=card.environment, told=told, slim=True,
        )  # fmt: skip
        text = card_text(name, POLICIES[name], card, told["training"])
        (BASELINES / f"{name}.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
