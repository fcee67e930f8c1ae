"""One episode with a localizer in the loop, driven by VFH+, a reactive baseline."""

import gymnasium as gym
import numpy as np

import ambinav_envs
from ambinav_envs import load_policy

gym.register_envs(ambinav_envs)
policy = load_policy("vfh")
env = gym.make("ambinav/Office-v1", reward="ambiguity", buildings=1, **policy.seeing)
policy.prepare(env.observation_space, env.action_space)
observation, info = env.reset(seed=1)
total, ended, first = 0.0, False, True
while not ended:
    row = {name: part[None] for name, part in observation.items()}
    observation, reward, over, cut, info = env.step(policy.act(row, np.array([first]))[0])
    total, ended, first = total + float(reward), over or cut, False
print(f"{info['outcome']}, return {total:.1f}, terms {info['terms']}")
