"""PPO with TorchRL: its collector, advantage and loss, on the batched environment."""

import argparse
import time

import gymnasium as gym
import torch
from gymnasium.vector import AutoresetMode
from tensordict.nn import TensorDictModule
from tensordict.nn.distributions import NormalParamExtractor
from torch import nn
from torchrl.collectors import Collector
from torchrl.envs import CatTensors, GymWrapper, TransformedEnv
from torchrl.modules import MLP, ProbabilisticActor, TanhNormal, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("id", nargs="?", default="ambinav_envs:ambinav/Procedural-v1")
parser.add_argument("--steps", type=int, default=500_000)
args = parser.parse_args()

ENVS, ROUND, EPOCHS, BATCH = 64, 128, 10, 512
torch.manual_seed(1)

# TorchRL begins the next episodes itself, by `reset` with a mask.
robots = gym.make_vec(args.id, ENVS, autoreset_mode=AutoresetMode.DISABLED, window=False)
wrapped = GymWrapper(robots)
parts = list(wrapped.observation_spec.keys())
env = TransformedEnv(wrapped, CatTensors(parts, "observation", del_keys=False))
env.set_seed(1)
action = env.action_spec.shape[-1]

shape = {"num_cells": [64, 64], "activation_class": nn.Tanh}
network = nn.Sequential(MLP(out_features=2 * action, **shape), NormalParamExtractor())
actor = ProbabilisticActor(
    TensorDictModule(network, ["observation"], ["loc", "scale"]),
    in_keys=["loc", "scale"],
    distribution_class=TanhNormal,
    return_log_prob=True,
)
critic = ValueOperator(MLP(out_features=1, **shape), in_keys=["observation"])
start = env.reset()
critic(actor(start))  # makes the lazy layers
advantage = GAE(gamma=0.99, lmbda=0.95, value_network=critic)
loss = ClipPPOLoss(actor, critic, clip_epsilon=0.2, entropy_coeff=0.0, critic_coeff=0.5)
optimizer = torch.optim.Adam(loss.parameters(), lr=3e-4)
collector = Collector(
    env,
    actor,
    frames_per_batch=ENVS * ROUND,
    total_frames=max(1, args.steps // (ENVS * ROUND)) * ENVS * ROUND,
    auto_register_policy_transforms=False,
)
torch.set_num_threads(1)  # two are slower on networks of this size, and the collector takes all

done, began = 0, time.perf_counter()
for data in collector:
    with torch.no_grad():
        advantage(data)
    rows = data.select(*loss.in_keys, "advantage", "value_target", strict=False).reshape(-1)
    for _ in range(EPOCHS):
        for part in torch.randperm(len(rows)).split(BATCH):
            losses = loss(rows[part])
            optimizer.zero_grad()
            sum(losses[f"loss_{name}"] for name in ("objective", "critic")).backward()
            nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
            optimizer.step()
    done += len(rows)
    score = data["next", "reward"].sum() / data["next", "done"].sum().clamp(min=1)
    rate = done / (time.perf_counter() - began)
    print(f"{done:8d} steps, {score:6.2f} an episode, {rate:6.0f} steps/s", flush=True)
collector.shutdown()
