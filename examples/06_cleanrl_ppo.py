"""PPO in one file, in the manner of CleanRL: torch, Gymnasium, and of ambinav an id alone."""

import argparse
import time

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from torch import nn
from torch.distributions import Normal

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("id", nargs="?", default="ambinav_envs:ambinav/Procedural-v1")
parser.add_argument("--window", action="store_true", help="see the map around, 512 more numbers")
parser.add_argument("--steps", type=int, default=500_000)
parser.add_argument("--seed", type=int, default=1)
parser.add_argument("--curve", help="a CSV file for the curve")
args = parser.parse_args()

ENVS, ROUND, EPOCHS, MINIBATCHES = 64, 128, 10, 32
RATE, GAMMA, LAMBDA, CLIP, VALUE, NORM = 3e-4, 0.99, 0.95, 0.2, 0.5, 0.5
torch.manual_seed(args.seed)
torch.set_num_threads(1)
rng = np.random.default_rng(args.seed)


def flat(seen):
    """The parts of the observation in one row a robot."""
    return torch.from_numpy(np.concatenate(list(seen.values()), axis=1))


def layer(inputs, outputs, gain=2.0**0.5):
    made = nn.Linear(inputs, outputs)
    nn.init.orthogonal_(made.weight, gain)
    nn.init.zeros_(made.bias)
    return made


def network(inputs, outputs, gain):
    return nn.Sequential(
        layer(inputs, 64), nn.Tanh(), layer(64, 64), nn.Tanh(), layer(64, outputs, gain)
    )


class Agent(nn.Module):
    """Actor and critic."""

    def __init__(self, inputs, actions):
        super().__init__()
        self.actor, self.critic = network(inputs, actions, 0.01), network(inputs, 1, 1.0)
        self.log_std = nn.Parameter(torch.zeros(actions))

    def act(self, seen, action=None):
        """An action, its logarithmic density, and what is to be expected."""
        chosen = Normal(self.actor(seen), self.log_std.exp())
        action = chosen.sample() if action is None else action
        log = chosen.log_prob(action).sum(1)
        return action, log, self.critic(seen)[:, 0]


def make(**options):
    """Robots that are stepped together; a robot's next episode begins in the step that ends one."""
    options = {"window": args.window, "autoreset_mode": AutoresetMode.SAME_STEP, **options}
    return gym.make_vec(args.id, num_envs=ENVS, **options)


envs = make()
first, _ = envs.reset(seed=args.seed)
now = flat(first)
agent = Agent(now.shape[1], envs.single_action_space.shape[0])
optimizer = torch.optim.Adam(agent.parameters(), lr=RATE, eps=1e-5)
size = (ROUND, ENVS)
seen = torch.zeros(*size, now.shape[1])
actions = torch.zeros(*size, envs.single_action_space.shape[0])
logs, rewards, ends, values = (torch.zeros(size) for _ in range(4))
rounds = max(1, args.steps // (ROUND * ENVS))
began, curve = time.perf_counter(), []
for k in range(rounds):
    optimizer.param_groups[0]["lr"] = RATE * (1.0 - k / rounds)
    arrived = []
    for t in range(ROUND):
        seen[t] = now
        with torch.no_grad():
            actions[t], logs[t], values[t] = agent.act(now)
        following, reward, over, cut, infos = envs.step(actions[t].clamp(-1.0, 1.0).numpy())
        ended = over | cut
        rewards[t], ends[t] = torch.from_numpy(reward).float(), torch.from_numpy(ended).float()
        if ended.any():
            arrived += infos["final_info"]["is_success"][ended].tolist()
        now = flat(following)
    with torch.no_grad():
        advantages, later, value = torch.zeros(size), torch.zeros(ENVS), agent.critic(now)[:, 0]
        for t in reversed(range(ROUND)):
            go_on = 1.0 - ends[t]
            error = rewards[t] + GAMMA * value * go_on - values[t]
            advantages[t] = later = error + GAMMA * LAMBDA * go_on * later
            value = values[t]
        wanted = (advantages + values).flatten()
    rows, did, was = seen.flatten(0, 1), actions.flatten(0, 1), logs.flatten()
    gains = advantages.flatten()
    for _ in range(EPOCHS):
        for part in np.array_split(rng.permutation(len(rows)), MINIBATCHES):
            _, log, value = agent.act(rows[part], did[part])
            gain = gains[part]
            gain = (gain - gain.mean()) / (gain.std() + 1e-8)
            ratio = (log - was[part]).exp()
            policy = -torch.min(gain * ratio, gain * ratio.clamp(1.0 - CLIP, 1.0 + CLIP)).mean()
            loss = policy + VALUE * (value - wanted[part]).square().mean()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), NORM)
            optimizer.step()
    steps, seconds = (k + 1) * ROUND * ENVS, time.perf_counter() - began
    share = sum(arrived) / max(1, len(arrived))
    curve.append(f"{steps},{len(arrived)},{share:.4f},{seconds:.1f}")
    print(f"{steps:8d} steps, {share:4.0%} arrived, {steps / seconds:6.0f} steps/s", flush=True)

# Without exploration, in buildings that it has not seen: the first three episodes of each robot.
envs = make(first_building=1_000_000)
now, ended, how = flat(envs.reset(seed=0)[0]), np.zeros(ENVS, dtype=int), []
while (ended < 3).any():
    with torch.no_grad():
        action = agent.actor(now).clamp(-1.0, 1.0).numpy()
    following, _, over, cut, infos = envs.step(action)
    now = flat(following)
    for robot in np.flatnonzero((over | cut) & (ended < 3)):
        how.append(str(infos["final_info"]["outcome"][robot]))
    ended += over | cut
print(f"of {len(how)} episodes " + ", ".join(f"{how.count(one)} {one}" for one in sorted(set(how))))
if args.curve:
    with open(args.curve, "w") as file:
        file.write("steps,episodes,arrived,seconds\n" + "\n".join(curve) + "\n")
