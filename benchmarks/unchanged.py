"""Digests of maps, routes, drives, episodes and a training, before and after a code change.

Run it before and after a change that should keep every figure, on the same machine:

    python benchmarks/unchanged.py --out before.json
    python benchmarks/unchanged.py --against before.json

Only the command line and the contract of names are used, so that it runs on both sides.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import yaml

import ambinav as an

ROOT = Path(__file__).parents[1]
DEMO = ROOT / "configs" / "demo.geojson"
SCANNERS = ("hokuyo-urg-04lx", "polaroid-6500-ring", "pioneer-sonar-laser")
PLANNERS = {
    "reference": (),
    "prmstar": ("--time", "inf", "--iterations", "400"),
    "rrtstar": ("--space", "se2", "--time", "inf", "--iterations", "2000"),
    "bitstar": ("--time", "inf", "--iterations", "60000"),
    "belief": (),
    "belief-roadmap": ("--time", "inf", "--iterations", "400"),
}
STEPS = 60


def digest(*arrays: object) -> str:
    """Return the first half of the SHA-256 of arrays, with their types and shapes."""
    sha = hashlib.sha256()
    for array in map(np.ascontiguousarray, arrays):
        sha.update(f"{array.dtype}{array.shape}".encode())
        sha.update(array.tobytes())
    return sha.hexdigest()[:32]


def command(*arguments: object) -> None:
    """Run one command of `ambinav`; its output is shown only if it fails."""
    line = [sys.executable, "-m", "ambinav.cli", *map(str, arguments)]
    result = subprocess.run(line, capture_output=True, text=True)
    if result.returncode:
        raise SystemExit(f"{' '.join(line)}: exit status {result.returncode}\n{result.stderr}")


def maps(folder: Path) -> dict[str, str]:
    """Return digests of every layer of maps for three kinds of scanner."""
    digests = {}
    for scanner in SCANNERS:
        out = folder / f"{scanner}.zarr"
        layers = ("--layers", "all") if scanner == SCANNERS[0] else ()
        command("map", DEMO, "--scanner", scanner, "--spacing", 0.3, *layers, "-o", out)
        dataset = an.AmbiguityMap.open(out).dataset
        for name in sorted(map(str, dataset.data_vars)):
            digests[f"map {scanner} {name}"] = digest(dataset[name].values)
    return digests


def routes(folder: Path) -> dict[str, str]:
    """Return digests of the poses of one route of every kind of planner."""
    digests = {}
    amap = folder / f"{SCANNERS[0]}.zarr"
    for planner, how in PLANNERS.items():
        out = folder / f"{planner}.csv"
        # The others are not random, and refuse a seed.
        seed = ("--seed", 1) if how else ()
        ends = ("--start", 3, 3, "--goal", 42, 20, *seed)
        command("plan", amap, *ends, "--planner", planner, *how, "-o", out)
        lines = [line for line in out.read_text().splitlines() if not line.startswith("#")]
        digests[f"route {planner}"] = digest(np.array(lines[1:]))
    return digests


def drives(folder: Path) -> dict[str, str]:
    """Return digests of the table of a comparison with few runs."""
    config = (ROOT / "configs" / "compare-demo.yaml").read_text()
    config = config.replace("environment: demo", f"environment: {DEMO.parent}/demo")
    config = config.replace("runs: 30", "runs: 4").replace("spacing: 0.1", "spacing: 0.3")
    scenario = folder / "scenario.yaml"
    scenario.write_text(config)
    command("compare", scenario, "-o", folder / "compare")
    digests = {}
    for table in sorted((folder / "compare").glob("*.csv")):
        with table.open() as file:
            digests[f"drives {table.name}"] = digest(
                np.array([str(row) for row in csv.reader(file)])
            )
    return digests


def episodes() -> dict[str, str]:
    """Return digests of a batch's observations and rewards under random actions."""
    import gymnasium

    import ambinav_envs

    ambinav_envs.register_envs()
    digests = {}
    for name in sorted(ambinav_envs.registration.IDS):
        envs = gymnasium.make_vec(name, num_envs=8)
        envs.action_space.seed(3)
        seen, _ = envs.reset(seed=5)
        parts = [np.concatenate([np.ravel(seen[key]) for key in sorted(seen)])]
        for _ in range(STEPS):
            seen, reward, ended, cut, _ = envs.step(envs.action_space.sample())
            parts += [
                np.concatenate([np.ravel(seen[key]) for key in sorted(seen)]),
                reward,
                ended,
                cut,
            ]
        envs.close()
        digests[f"episodes {name}"] = digest(*parts)
    return digests


def training(folder: Path) -> dict[str, str]:
    """Return digests of the weights of a policy after a very short training."""
    import torch

    from ambinav_envs.policies import load_policy

    config = yaml.safe_load((ROOT / "configs" / "ppo.yaml").read_text())
    config |= {"steps": 8192, "envs": 32}
    config["environment"]["buildings"] = 4
    config["evaluation"] |= {"episodes": 8, "every": 4096}
    config["evaluation"]["environment"]["buildings"] = 2
    short = folder / "ppo.yaml"
    short.write_text(yaml.safe_dump(config))
    command("train", short, "-o", folder / "train")
    policies = sorted((folder / "train").rglob("*.zip"))
    state = load_policy(policies[-1]).model.state_dict()  # type: ignore[attr-defined]
    values = [value.detach().numpy() for value in state.values() if isinstance(value, torch.Tensor)]
    return {f"training {policies[-1].stem}": digest(*values)}


def main() -> None:
    """Print the digests, and which differ."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--against", type=Path, help="digests from before, by --out")
    args = parser.parse_args()
    os.environ["AMBINAV_CACHE"] = ""  # compute everything, without stored results
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        digests = maps(folder) | routes(folder) | drives(folder) | episodes() | training(folder)
    if args.out:
        args.out.write_text(json.dumps(digests, indent=1) + "\n")
    if args.against is None:
        print(json.dumps(digests, indent=1))
        return
    before = json.loads(args.against.read_text())
    changed = [key for key in before if digests.get(key) != before[key]]
    print(f"{len(before) - len(changed)} of {len(before)} as before")
    for key in changed:
        print(f"differs: {key}" if key in digests else f"missing: {key}")
    raise SystemExit(bool(changed))


if __name__ == "__main__":
    main()
