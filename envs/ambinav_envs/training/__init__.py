"""Training policies with Stable-Baselines3: `ambinav train`, and from Python `train`."""
