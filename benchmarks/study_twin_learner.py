"""Recurrent PPO in TwinRooms: by itself, as a correction of the script, and paid for its certainty.

Why a learner of speeds and declarations hardly learns here: an arrival has to be declared, by
random actions nearly all declarations are false, and the first thing that is learnt is to declare
nothing; an episode has up to 500 steps. So every action holds for `HOLD` steps, which is as long as
a declaration takes, and in the arms `script` and `certain` it corrects the script of the heaviest
hypothesis: how far to turn off its route, how fast to drive, whether to declare at its goal. An
action of 0 is the script. In `certain` the reward has the decrease of the entropy of the
hypotheses' shares too, as a difference of potentials (Ng, Harada and Russell 1999), which changes
no optimal policy.
"""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from belief_methods import BELIEF_METHODS
from harness import arguments, option, report, table
from numpy.typing import NDArray
from sb3_contrib import RecurrentPPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn, VecEnvWrapper
from study_twin_rooms import LEVELS, UNSEEN_BUILDINGS, Driven, driven_by, scores, with_error
from task_baselines import Baseline, Histogram

from ambinav.drive.bootstrap import share
from ambinav.runtime.array_types import Bools
from ambinav_envs import make_sb3
from ambinav_envs.observations import CLUSTER
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.normalization import Observation
from ambinav_envs.policies.policy import Policy
from ambinav_envs.registration import IDS
from ambinav_envs.simulation.layout import ARRIVED, COLLIDED, MISSED, OUTCOMES, TIMEOUT

Floats = NDArray[np.float64]
LIBRARIES = ("ambinav", "gymnasium", "numpy", "sb3-contrib", "stable-baselines3", "torch")
ARMS = ("plain", "script", "certain")
# Steps of an action, robots, discount of an action, and worth of a nat of certainty.
HOLD, ROBOTS, GAMMA, NAT = 5, 32, 0.99, 0.5
# A declaration is withheld below this third number of a correction.
WITHHELD = -0.5
# Seconds of training to a line of the curve.
LINE = 60.0
ENDS = ("arrived %", "missed %", "collided %", "timeout %")
CURVE = ("minutes", "actions", "episodes", *ENDS)
HEADER = ("method", *ENDS, "seconds", "score", "paired lead over bold")


class Corrected(Histogram):
    """The script of the heaviest hypothesis, corrected by three numbers from -1 to 1."""

    def corrected(self, seen: Observation, chosen: Floats) -> Any:
        """Return actions, given corrections, shape (N, 3): turn, speed, declaration."""
        withheld = chosen[:, 2] < WITHHELD
        point = seen[self._point].astype(np.float64)
        # A small turn from a small number, and all of them possible.
        angle = np.pi * chosen[:, 0] ** 3
        turned = np.arctan2(point[:, 2], point[:, 1]) + angle
        point[:, 1], point[:, 2] = np.cos(turned), np.sin(turned)
        point[withheld, 0] = np.maximum(point[withheld, 0], 0.12)
        goal = seen["goal"].copy()
        goal[withheld, 0] = 1.0
        actions = self.towards({**seen, "goal": goal}, point.astype(np.float32))
        slow = np.clip(1.0 + chosen[:, 1], 0.0, 1.0)
        actions[:, 0] = slow * (np.minimum(actions[:, 0], 1.0) + 1.0) - 1.0
        return actions


def entropy(seen: Observation) -> Floats:
    """Return the entropy of the hypotheses' shares, shape (N,), nats."""
    shares = np.clip(seen["hypotheses"][:, ::CLUSTER].astype(np.float64), 1e-9, 1.0)
    return np.asarray(-(shares * np.log(shares)).sum(axis=1))


class Held(VecEnvWrapper):
    """Robots whose actions hold for `HOLD` steps, or until the episode ends.

    An episode that begins in the middle of an action is driven by the action 0 until the next, and
    without a reward.
    """

    def __init__(self, arm: str, arguments: dict[str, Any], seed: int) -> None:
        envs = make_sb3("ambinav/Navigation-v1", ROBOTS, seed=seed, **arguments)
        space = gym.spaces.Box(-1.0, 1.0, (3,), np.float32)
        super().__init__(envs, action_space=space)
        self._script = None if arm == "plain" else Corrected(NavigationParameters.of(
            {k: v for k, v in arguments.items() if k not in ("suite", "buildings")}
        ))  # fmt: skip
        self._pays = arm == "certain"
        self._seen: Observation = {}
        self._chosen = np.zeros((ROBOTS, 3))

    def reset(self) -> VecEnvObs:
        """See `VecEnv`."""
        self._seen = self.venv.reset()  # type: ignore[assignment]
        return dict(self._seen)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Set the actions that hold, shape (N, 3)."""
        self._chosen = np.array(actions, dtype=np.float64)

    def step_wait(self) -> VecEnvStepReturn:
        """See `VecEnv`."""
        rewards, ended = np.zeros(ROBOTS, np.float32), np.zeros(ROBOTS, dtype=np.bool_)
        infos: list[dict[str, Any]] = [{} for _ in range(ROBOTS)]
        before = entropy(self._seen)
        for _ in range(HOLD):
            chosen = np.where(ended[:, None], 0.0, self._chosen)
            actions = chosen
            if self._script is not None:
                actions = self._script.corrected(self._seen, chosen)
            self.venv.step_async(actions.astype(np.float32).clip(-1.0, 1.0))
            seen, reward, dones, step_infos = self.venv.step_wait()
            rewards += np.where(ended, 0.0, reward)
            for i in np.flatnonzero(~ended):
                infos[i] = step_infos[i]
            ended |= dones
            self._seen = seen  # type: ignore[assignment]
        if self._pays:
            after = np.where(ended, 0.0, entropy(self._seen))
            rewards += (NAT * (before - GAMMA * after)).astype(np.float32)
        return dict(self._seen), rewards, ended, infos


class Curve(BaseCallback):
    """Counts how training episodes end, a line a minute, and ends the training in time."""

    def __init__(self, seconds: float) -> None:
        super().__init__()
        self._until, self._began = seconds, time.monotonic()
        self._ends: list[str] = []
        self.rows: list[list[str]] = []

    def _on_step(self) -> bool:
        for i in np.flatnonzero(self.locals["dones"]):
            self._ends.append(self.locals["infos"][i]["outcome"])
        gone = time.monotonic() - self._began
        if gone >= LINE * (len(self.rows) + 1):
            shares = [
                100.0 * np.mean([float(end == OUTCOMES[code]) for end in self._ends] or [np.nan])
                for code in (ARRIVED, MISSED, COLLIDED, TIMEOUT)
            ]
            numbers = (self.num_timesteps, len(self._ends), *shares)
            self.rows.append([f"{gone / 60:.0f}", *(f"{value:.0f}" for value in numbers)])
            print(*self.rows[-1], sep=" | ", flush=True)
            self._ends = []
        return gone < self._until


class Learnt(Policy):
    """A trained model that drives without exploration."""

    def __init__(self, model: RecurrentPPO, arm: str, parameters: NavigationParameters) -> None:
        super().__init__(arm, {"discrete": False})
        self._model = model
        self._script = None if arm == "plain" else Corrected(parameters)
        self._memory: Any = None
        self._chosen = np.zeros((0, 3))
        self._step = 0

    def prepare(self, observation_space: Any, action_space: Any) -> None:
        """Forget the last episode."""
        self._memory, self._step = None, 0

    def act(self, observations: Observation, starts: Bools) -> Any:
        """Return the actions; all robots start together."""
        if self._step % HOLD == 0:
            self._chosen, self._memory = self._model.predict(
                observations, self._memory,
                np.full(len(starts), self._step == 0), deterministic=True,
            )  # fmt: skip
        self._step += 1
        if self._script is None:
            return self._chosen
        return self._script.corrected(observations, self._chosen.astype(np.float64))


def train(arm: str, arguments: dict[str, Any], seconds: float, seed: int) -> tuple[Any, Any]:
    """Return a trained model, and its curve."""
    torch.set_num_threads(1)
    model = RecurrentPPO(
        "MultiInputLstmPolicy", Held(arm, arguments, seed), n_steps=64, batch_size=512, n_epochs=4,
        learning_rate=5e-4, gamma=GAMMA, ent_coef=0.0, seed=seed,
        policy_kwargs={"net_arch": [64], "lstm_hidden_size": 64, "log_std_init": -1.0},
    )  # fmt: skip
    curve = Curve(seconds)
    model.learn(100_000_000, callback=curve)
    return model, curve.rows


def main() -> None:
    """Train the arms one after the other, drive them and the script, and report."""
    args = arguments(
        __doc__,
        level=option("1", choices=tuple(LEVELS)),
        arm=option(None, "default: all", action="append", choices=ARMS),
        minutes=option(12.0, "of training, for each arm"),
        episodes=200,
        seed=1,
        kept=option(None, "see study_twin_rooms.py", type=Path),
    )
    plain = {**IDS[LEVELS[args.level]], "window": False}
    judged = {**IDS[LEVELS[args.level]], **UNSEEN_BUILDINGS}
    key = {"level": args.level, "place": UNSEEN_BUILDINGS, "episodes": args.episodes, "seed": 1}
    driven: dict[str, Driven] = {}
    driven["bold"] = driven_by(BELIEF_METHODS["bold"], {**key, "method": "bold"}, judged, args.kept)
    parts = []
    for arm in args.arm or ARMS:
        model, curve = train(arm, plain, 60.0 * args.minutes, args.seed)
        make = partial(Learnt, model, arm)
        who = Baseline(arm, make, {"window": False}, "learner")
        driven[arm] = driven_by(who, key, judged, None)
        parts.append(f"## Training of {arm}, seed {args.seed}\n\n{table(CURVE, curve)}")
    scored = {name: scores(who, judged["reward"]) for name, who in driven.items()}
    rows = []
    for name, episodes in driven.items():
        often = share(episodes.ended(ARRIVED)).scaled(100.0)
        mean, error = with_error(scored[name])
        lead, margin = with_error(scored[name] - scored["bold"])
        rows.append([
            name, f"{often.value:.0f} ({often.low:.0f} to {often.high:.0f})",
            *(f"{100 * episodes.ended(code).mean():.0f}" for code in (MISSED, COLLIDED, TIMEOUT)),
            f"{episodes.seconds.mean():.0f}", f"{mean:.2f} ± {error:.2f}",
            f"{lead:.2f} ± {margin:.2f}" if name != "bold" else "",
        ])  # fmt: skip
    title = f"## {LEVELS[args.level]}, buildings that no policy has seen"
    parts.append(f"{title}\n\n{table(HEADER, rows)}")
    report("Learners in twin rooms", LIBRARIES, "\n\n".join(parts), args.out)


if __name__ == "__main__":
    main()
