"""Steps per second of the navigation environments, single and batched, and the parts of a step.

A policy drives to the waypoint ahead, so episodes are as long as an agent's; all that a step gives
is made: observation, reward, infos, and new episodes where old ones have ended.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import gymnasium as gym
import numba
import numpy as np
import psutil
from harness import arguments, interleave, option, report, spread, table
from numpy.typing import NDArray
from peers import IrSim, world_of

from ambinav.drive.readings import Readings
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.vector import NavigationVectorEnv

LIBRARIES = ("ambinav", "gymnasium", "numba", "numpy")
# What the project asks for, on 2 cores, 60 beams and the Kalman filter: steps a second of 64 robots
# or more, and of one.
WANTED, WANTED_ALONE = 300_000, 10_000
# And on one core, with Monte Carlo localization by so many particles.
WANTED_PARTICLES, PARTICLES = 20_000, 200
SIZES = (64, 256, 1024, 2048)
Floats = NDArray[np.float32]
Clock = Callable[[], float]


def towards(seen: dict[str, Floats]) -> Floats:
    """Return actions towards the waypoint: turn first, then drive."""
    angle = np.arctan2(seen["waypoint"][..., 2], seen["waypoint"][..., 1])
    speed = 2.0 * np.clip(1.5 * np.cos(angle) - 0.5, 0.0, 1.0) - 1.0
    return np.stack([speed, np.clip(angle, -1.0, 1.0)], axis=-1)


class Driving:
    """Driving robots, a batch or the one of a single environment; each call makes some steps."""

    def __init__(
        self,
        count: int | None,
        steps: int,
        options: dict[str, Any],
        clock: Clock = time.perf_counter,
    ) -> None:
        chosen = {"waypoint": True, "waypoint_distance": 0.5, **options}
        self.env: NavigationEnv | NavigationVectorEnv = (
            NavigationEnv(**chosen) if count is None else NavigationVectorEnv(count, **chosen)
        )
        self.count, self.is_alone = count or 1, count is None
        _visit(self.env, options)
        self.seen, _ = self.env.reset(seed=0)
        self.steps, self.ended, self.taken, self.seconds = steps, 0, 0, 0.0
        self.clock = clock

    def __call__(self) -> None:
        """Make the steps; the policy's own time is not counted."""
        for _ in range(self.steps):
            actions = towards(self.seen)
            begin = self.clock()
            self.seen, _, terminated, truncated, _ = self.env.step(actions)
            ended = int(np.sum(terminated | truncated))
            if self.is_alone and ended:
                self.seen, _ = self.env.reset()
            self.seconds += self.clock() - begin
            self.ended += ended
            self.taken += self.count


def _visit(env: NavigationEnv | NavigationVectorEnv, options: dict[str, Any]) -> None:
    """Begin an episode in every building, so that later ones find it prepared."""
    for number in range(options["buildings"]):
        env.reset(seed=0, options={"building": number})


def rates(drivers: dict[str, Driving], repeats: int) -> dict[str, tuple[str, str]]:
    """Return steps per second, median and extremes over the rounds, and steps per episode."""
    for run in drivers.values():
        run()
        run.taken = run.ended = 0
    rates_by_name: dict[str, list[float]] = {name: [] for name in drivers}
    for _ in range(repeats):
        for name, run in drivers.items():
            steps_before, run.seconds = run.taken, 0.0
            run()
            rates_by_name[name].append((run.taken - steps_before) / run.seconds / 1e3)
    return {
        name: (spread(values, 1), f"{drivers[name].taken / max(drivers[name].ended, 1):.0f}")
        for name, values in rates_by_name.items()
    }


def rows_of_rates(options: dict[str, Any], steps: int, repeats: int) -> list[tuple[str, ...]]:
    """Return steps per second by number of robots and threads, with and without the window."""
    rows = []
    before = numba.get_num_threads()
    for window in (False, True):
        chosen = options | {"window": window}
        drivers: dict[str, Driving] = {"1": Driving(None, 4 * steps, chosen)}
        drivers |= {str(n): Driving(n, max(steps * 64 // n, 4), chosen) for n in SIZES}
        for threads in sorted({1, before}):
            numba.set_num_threads(threads)
            for name, (rate, length) in rates(drivers, repeats).items():
                rows.append((name, "yes" if window else "no", str(threads), rate, length))
    numba.set_num_threads(before)
    return rows


def rows_of_parts(options: dict[str, Any], repeats: int) -> list[tuple[str, ...]]:
    """Return microseconds of a step of 64 robots on one thread, with single parts varied."""
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    parts: dict[str, dict[str, Any]] = {
        "all but the window": {"window": False},
        "with the window": {"window": True},
        "one round of the filter": {"window": False, "iterations": 1},
        "dead reckoning": {"window": False, "localizer": "odometry"},
        "5 people and 5 boxes": {"window": False, "people": 5, "obstacles": 5},
    }
    runs: dict[str, Callable[[], object]] = {}
    count, steps = 64, 20
    for name, part in parts.items():
        envs = NavigationVectorEnv(count, **options | part)
        envs.reset(seed=0)
        # Slow circles: no episode ends, and every scan differs.
        still = np.tile(np.array([[-0.99, 0.2]]), (count, 1))
        out, everyone = envs.simulation.outcome(), np.ones(count, dtype=np.bool_)
        step = partial(envs.simulation.step, still, everyone, out)
        runs[name] = partial(_often, step, steps)
    site = envs.simulation.sites[0]
    assert site is not None
    readings = Readings(site.building.environment, envs.simulation.parameters.scanner)
    poses = envs.simulation.state["truth"].copy()
    runs["one cast of the scan, for comparison"] = partial(
        _often, partial(readings.true_ranges, np.tile(poses, (steps, 1))), 1
    )
    timings = interleave(runs, repeats)
    numba.set_num_threads(before)
    return [
        (name, spread([seconds / steps / count * 1e6 for seconds in timing.seconds]))
        for name, timing in timings.items()
    ]


def rows_of_localizers(options: dict[str, Any], steps: int, repeats: int) -> list[tuple[str, ...]]:
    """Return thousand steps per second of 1 and 64 robots on one thread, by localizer.

    Seconds are the processor's, since the clock's count what else the machine is doing.
    """
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    few = {"min_particles": PARTICLES, "max_particles": PARTICLES}
    product = few | {"laser_model_type": "likelihood_field_prob"}
    ring = {"scanner": "polaroid-6500-ring"}
    cases: dict[str, dict[str, Any]] = {
        "dead reckoning": {"localizer": "odometry"},
        "Kalman filter": {"localizer": "ekf"},
        f"{PARTICLES} particles, likelihood field (default of lasers)": {"mcl": few},
        f"{PARTICLES} particles, product of the likelihood field": {"mcl": product},
        "500 to 2000 particles (AMCL's defaults)": {},
        f"{PARTICLES} particles, scan taken in at every step": {
            "mcl": few | {"update_min_d": 0.0, "update_min_a": 0.0}
        },
        "16 sonars, Kalman filter": ring | {"localizer": "ekf"},
        f"16 sonars, {PARTICLES} particles, product of cones (their default)": ring | {"mcl": few},
    }
    rows = []
    for name, case in cases.items():
        chosen = options | {"window": False, "localizer": "mcl"} | case
        run: dict[str, Driving] = {
            "1": Driving(None, 4 * steps, chosen, time.process_time),
            "64": Driving(64, steps, chosen, time.process_time),
        }
        rates_by_count = rates(run, repeats)
        rows.append((name, rates_by_count["1"][0], rates_by_count["64"][0]))
    numba.set_num_threads(before)
    return rows


def _often(run: Callable[[], object], times: int) -> None:
    for _ in range(times):
        run()


def rows_beside_irsim(
    python: Path, options: dict[str, Any], steps: int, repeats: int
) -> tuple[str, list[tuple[str, ...]]]:
    """Return ir-sim's version, and rows of thousand steps per second of both simulators.

    One building, no window: all else of the environments (filter, reward, infos) is made, and
    what ir-sim makes of a step as well.
    """
    chosen = options | {"window": False, "buildings": 1, "max_episode_steps": 10**6}
    rows, version = [], ""
    for count in (1, 16):
        ours = NavigationVectorEnv(count, **chosen) if count > 1 else NavigationEnv(**chosen)
        ours.reset(seed=0)
        # As `peer_irsim.ACTION`.
        action = np.tile(np.array([-0.99, 0.2], dtype=np.float32), (count, 1))
        single = action[0] if count == 1 else action
        with TemporaryDirectory() as folder:
            world = world_of(ours.simulation)
            with IrSim(python, world, Path(folder), max(steps // count, 2)) as peer:
                version, ratios = peer.version, []
                for _ in range(repeats + 1):
                    theirs = peer.steps * count / peer.seconds()
                    begin = time.perf_counter()
                    _often(partial(ours.step, single), steps)
                    ratios.append((steps * count / (time.perf_counter() - begin), theirs))
        # The first round compiles.
        rates = np.array(ratios[1:]) / 1e3
        rows.append(
            (
                str(count), spread(rates[:, 1].tolist(), 2), spread(rates[:, 0].tolist(), 1),
                spread((rates[:, 0] / rates[:, 1]).tolist(), 0),
            )
        )  # fmt: skip
    return version, rows


def rows_beside_cartpole(
    options: dict[str, Any], steps: int, repeats: int
) -> list[tuple[str, ...]]:
    """Return microseconds of a step of one robot and of CartPole-v1, on one thread.

    Seconds are the processor's. Both choose nothing: their actions are drawn beforehand.
    """
    numba.set_num_threads(1)
    envs: dict[str, gym.Env[Any, Any]] = {
        "CartPole-v1": gym.make("CartPole-v1"),
        "one robot, no window": NavigationEnv(window=False, **options),
        "one robot, with the window": NavigationEnv(window=True, **options),
    }

    def stepping(env: gym.Env[Any, Any]) -> Callable[[], object]:
        env.reset(seed=0)
        env.action_space.seed(0)
        actions = [env.action_space.sample() for _ in range(steps)]

        def run() -> None:
            for action in actions:
                _, _, terminated, truncated, _ = env.step(action)
                if terminated or truncated:
                    env.reset()

        return run

    timings = interleave(
        {name: stepping(env) for name, env in envs.items()}, repeats, time.process_time
    )
    cart = timings["CartPole-v1"]
    return [
        (name, spread([1e6 * s / steps for s in timing.seconds], 1), cart.ratio(timing))
        for name, timing in timings.items()
    ]


def growth_of_memory(options: dict[str, Any]) -> str:
    """Return by how much the process grows in a million steps of 64 robots, in megabytes.

    A tenth of the steps comes before, in which what is kept for each goal is made.
    """
    run = Driving(64, 1_000_000 // (64 * 10), options | {"window": True})
    run()
    before = psutil.Process().memory_info().rss
    for _ in range(10):
        run()
    return f"{(psutil.Process().memory_info().rss - before) / 1e6:.1f}"


def milliseconds_of_buildings(options: dict[str, Any], repeats: int) -> str:
    """Return the time to begin an episode in a new building."""
    env = NavigationEnv(**options | {"buildings": None})
    env.reset(seed=0, options={"building": 10**6})
    milliseconds = []
    for number in range(repeats):
        begin = time.perf_counter()
        env.reset(options={"building": 10**6 + 1 + number})
        milliseconds.append((time.perf_counter() - begin) * 1e3)
    return spread(milliseconds, 0)


def microseconds_of_resets(options: dict[str, Any], repeats: int) -> str:
    """Return the time to begin an episode in a known building."""
    envs = NavigationVectorEnv(64, window=False, **options)
    _visit(envs, options)
    # Until every goal has been drawn, and its distances are known.
    for seed in range(8 * options["buildings"]):
        envs.reset(seed=1000 * seed)
    timing = interleave({"reset": envs.reset}, repeats)["reset"]
    return spread([seconds / 64 * 1e6 for seconds in timing.seconds], 0)


def main() -> None:
    """Measure and report."""
    args = arguments(
        __doc__,
        repeats=7,
        steps=option(100, "of 64 robots in a round"),
        suite="procedural",
        buildings=8,
        localizers=option(False, "the localizers beside each other, nothing else"),
        irsim_python=option(None, "a Python with ir-sim, to measure beside it", type=Path),
    )
    options = {"suite": args.suite, "buildings": args.buildings}
    if args.localizers:
        body = (
            f"{args.buildings} buildings of the suite {args.suite}, no window, thousand steps a "
            f"second of one core (the processor's seconds). Wanted with {PARTICLES} particles: "
            f"{WANTED_PARTICLES // 1000} thousand.\n\n"
        )
        header = ("localizer", "1 robot", "64 robots")
        body += table(header, rows_of_localizers(options, args.steps, args.repeats))
        report("Localizers in the navigation environments", LIBRARIES, body, args.out)
        return
    rows = rows_of_rates(options, args.steps, args.repeats)
    body = "\n\n".join(
        [
            f"{args.buildings} buildings of the suite {args.suite}, 60 beams of 4 m, Kalman filter "
            f"on the ranges. Wanted on 2 cores: {WANTED // 1000} thousand steps a second of 64 "
            f"robots or more, {WANTED_ALONE // 1000} thousand of one.",
            table(
                ("robots", "window", "threads", "thousand steps a second", "steps an episode"), rows
            ),
            "## What a step is made of\n\n64 robots on one thread, microseconds a robot and step, "
            "the kernel alone.",
            table(("step", "microseconds"), rows_of_parts(options, args.repeats)),
            f"The first episode in a new building, its map included: "
            f"{milliseconds_of_buildings(options, args.repeats)} milliseconds.\n\n"
            f"A new episode: {microseconds_of_resets(options, args.repeats)} microseconds where "
            "the distances to its goal are known from an earlier one.",
            "## Beside CartPole\n\nMicroseconds of the processor for a step, random actions, new "
            "episodes included.",
            table(
                ("environment", "microseconds", "times CartPole-v1"),
                rows_beside_cartpole(options, 20 * args.steps, args.repeats),
            ),
            f"## Memory\n\nA million steps of 64 robots with the window, after 100 000 others: the "
            f"process grows by {growth_of_memory(options)} MB.",
        ]
    )
    if args.irsim_python is not None:
        version, beside = rows_beside_irsim(
            args.irsim_python, options, 2 * args.steps, args.repeats
        )
        body += (
            f"\n\n## Beside ir-sim {version}\n\nThe same walls, robot and beams, in turn, "
            "thousand steps a second. ir-sim has no localizer, reward or infos; its robots share "
            "one world and see each other.\n\n"
        )
        body += table(("robots", "ir-sim", "ambinav", "times as fast"), beside)
    report("The navigation environments", LIBRARIES, body, args.out)


if __name__ == "__main__":
    main()
