"""A training, cut short: a folder with the policy, its curve and all that it takes to repeat it."""

from pathlib import Path

from ambinav_envs import load_policy, load_training_config, train

folder = Path("out/07-policy")
figures = train(load_training_config(Path(__file__).with_suffix(".yaml")), folder)
print(f"arrived in {figures['final']['arrived']:.0%} of the episodes")
policy = load_policy(folder / "final.zip")
print(f"{policy.name}: {sorted(path.name for path in folder.iterdir())}")
