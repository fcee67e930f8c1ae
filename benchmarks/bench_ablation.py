"""Does the ambiguity reward or the waypoint's route keep a trained robot from getting lost?

The criterion, written before the trainings that count; what trials changed in it stands at its end:

- Factors, in all combinations: the reward (the presets `shortest`, `ambiguity`, `fisher`, `error`)
  x `ambiguity_weight` (0, 5) x the localizer (`ekf`, a Kalman filter; `mcl`, Monte Carlo with 200
  particles). `ambiguity_weight` moves the waypoint and the term `progress` together: *route* means
  both. All policies see the window of the ambiguity map.
- The rewards weigh alike: where VFH+ drives the shortest route in the halls of training, a metre
  costs 0.45 of `ambiguity` with the Kalman filter (0.51 with Monte Carlo) and 0.53 (0.60) of
  `fisher`. The preset `error` would cost 7.6 (33), and a policy of a trial with it ran out of
  time in 45 % of the episodes; its term's weight is 1.2 here (0.3), which costs 0.46 (0.49).
- Trainings: benchmarks/ablation.yaml, five seeds, a thousand apart. For each seed, localizer and
  weight a policy is trained with `shortest`; each reward, `shortest` too, goes on from there with
  equally many steps. Nothing but the factors differs. The last policy counts, not the best one, and
  none is left out for learning badly. A replicate is the eight cells of a localizer and a seed;
  only whole replicates count.
- Judged on the same episodes, each policy with the localizer of its training: 128 in 100 halls that
  nobody trains in, and 64 on each of four recorded maps, both as mapped and disturbed (conditions
  of the leaderboard).
- Measures: ever lost; arrived; collided; length ratio, of the seeds and episodes that arrive in all
  cells that are compared. Differences are paired by seed and episode.
- Effects, of each localizer: of a reward at a given weight, y(reward, w) - y(shortest, w); of the
  route at a given reward, y(reward, 5) - y(reward, 0); the interaction of the two, effect of the
  reward at 5 less that at 0. The whole, y(ambiguity, 5) - y(shortest, 0), is the sum of two shares:
  the mean effect of the reward `ambiguity` at both weights, and the mean effect of the route at
  both rewards.
- Intervals: percentile bootstrap over seeds, buildings and episodes in them, the same draws for all
  cells. The four recorded maps weigh the same and are not drawn: those intervals are about these
  four.
- The main comparison: ever lost in disturbed halls; with each localizer the reward `ambiguity` at 0
  (the reward by itself) and at 5 (the reward on its route), the route at `shortest` (the route by
  itself) and at `ambiguity` (the route for its reward). Eight comparisons, so the intervals are of
  1 - 0.05 / 8 = 99.4 % (Bonferroni).
- *Helps*: the interval is below 0, at most one seed's difference is not, and arrivals are not shown
  to fall (95 %). *Harms*: the interval is above 0, and at most one seed's difference is not. *At
  most 5 points*: the interval lies within -5 and 5. Otherwise *no difference shown*, which does not
  say that there is none. Fewer than three replicates: no verdict.
- The reward helps by itself if it does at 0 with both localizers; the route does if it does at
  `shortest` with both; the two need each other if neither helps by itself and both do where the
  other one is. With one localizer, it is said of that one.
- All else is secondary (the rewards `fisher` and `error`, interactions, recorded maps, as mapped,
  other measures): intervals of 99 %, each by itself. One in a hundred misses 0 by chance; nothing
  is claimed that does not show with both localizers.
- Known beforehand: nine trials with seed 0 and nine cells with seed 1000, none of which counts.
  They settled the weights of `error`, and that the main comparison has the route for its reward too
  (it was of six comparisons before): `progress` is a difference of potentials, so it does not ask
  for the route, and a policy that was shown the aware waypoint with the reward `shortest` had
  ceased to follow it by the end of its training. They were of 500 thousand steps from nothing,
  after which two policies whose reward costs by the metre (`ambiguity` and `fisher` at 0) still ran
  out of time in 34 and 59 % of the episodes: hence the common beginning.
- VFH+ drives the same episodes on both routes, for comparison; it is no part of the criterion.

Changed since: shares of single cells have score intervals, with seeds and buildings as groups
(`drive.shares`). Effects, of which the criterion speaks, keep theirs.
"""

from __future__ import annotations

import gc
import shutil
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, Final

import numba
import torch
import yaml
from ablation_effects import CELLS, Cell, Found
from ablation_kept import Key, keep, kept
from ablation_tables import body, plot_effects
from harness import ROOT, appended, arguments, commits, environment_path, kept_rows, option, report

from ambinav.plotting.canvas import save_figure
from ambinav_envs.buildings.source import BuildingSource
from ambinav_envs.evaluation import UNSEEN, Episodes, evaluate_in
from ambinav_envs.leaderboard.board import CONDITIONS
from ambinav_envs.leaderboard.store import load_episodes, save_episodes
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies import load_policy
from ambinav_envs.rewards import PRESETS
from ambinav_envs.scenario import scenario
from ambinav_envs.training.config_file import load_training_config
from ambinav_envs.training.folder import FINAL
from ambinav_envs.training.run import Run

CONFIG: Final = ROOT / "benchmarks" / "ablation.yaml"
RESULTS: Final = ROOT / "benchmarks" / "results" / "ablation"
LIBRARIES: Final = ("ambinav", "stable_baselines3", "torch", "numpy", "numba")
LOCALIZERS: Final[dict[str, dict[str, Any]]] = {
    "ekf": {"localizer": "ekf"},
    "mcl": {"localizer": "mcl", "mcl": {"min_particles": 200, "max_particles": 200}},
}
ERROR_WEIGHTS: Final = {"ekf": 1.2, "mcl": 0.3}
"""Weights of the term `error`, see the criterion."""
FOLLOWERS: Final = {Cell("vfh", 0): "vfh", Cell("vfh", 5): "vfh-aware"}
VENUES: Final = {
    "halls": ("hall",),
    "recorded maps": ("intel", "freiburg-079", "aces", "belgioioso"),
}
EPISODES: Final = {"halls": 128, "recorded maps": 64}
"""In all halls together, and on each map."""
HALLS, SEED = 100, 7
"""Number of halls of the episodes, and the seed of the episodes."""
APART = 1000
"""From one seed to the next: environment i of a training starts from its seed + i."""


class Study:
    """The folders of the study: trainings, drives, and stored results.

    Args:
        folder: Holds trained/ and driven/.
        results: Holds the episodes of each whole seed, which is not made again, and its rows.
    """

    def __init__(self, folder: Path, results: Path) -> None:
        self._folder, self._results = folder, results
        self._sources: dict[str, BuildingSource] = {}
        self._episodes: dict[int | None, dict[Key, Episodes]] = {}

    def make(self, number: int) -> None:
        """Train and evaluate the missing ones of a seed's sixteen cells."""
        if self._log_path(number).is_file():
            return
        with appended(self.log(number)) as append:
            for localizer, cell in product(LOCALIZERS, CELLS):
                name = run_name(localizer, cell, number)
                seconds = self._train(name, localizer, cell, number)
                if seconds:
                    append({"run": name, "trained": seconds})
                seconds = self._judge(name, localizer, str(self._policy(name)))
                if seconds:
                    append({"run": name, "driven": seconds})
        self._keep(
            number, [run_name(who, cell, number) for who, cell in product(LOCALIZERS, CELLS)]
        )

    def follow(self) -> None:
        """Run the route followers, which are not trained."""
        if self._log_path(None).is_file():
            return
        for localizer, (cell, policy) in product(LOCALIZERS, FOLLOWERS.items()):
            self._judge(run_name(localizer, cell), localizer, policy)
        self._keep(None, [run_name(who, cell) for who, cell in product(LOCALIZERS, FOLLOWERS)])

    def log(self, number: int) -> Path:
        """Return the file of a seed's rows."""
        return self._log_path(number).with_suffix(".jsonl")

    def episodes(
        self, localizer: str, cell: Cell, number: int | None, venue: str, condition: str
    ) -> list[Episodes]:
        """Return a run's episodes in the buildings of a venue; empty if its seed is incomplete."""
        if number not in self._episodes:
            self._episodes[number] = kept(self._log_path(number))
        name = run_name(localizer, cell, number)
        keys = [Key(name, place, condition) for place in VENUES[venue]]
        driven = self._episodes[number]
        return [driven[key] for key in keys] if all(key in driven for key in keys) else []

    def _log_path(self, number: int | None) -> Path:
        """Return the result file of a seed, or of the followers."""
        return self._results / ("followers.npz" if number is None else f"seed-{number * APART}.npz")

    def _keep(self, number: int | None, names: Sequence[str]) -> None:
        """Store the results of runs, all of which have driven."""
        driven = {}
        for name, (venue, places), condition in product(names, VENUES.items(), CONDITIONS):
            for place in places:
                driven_episodes = self._driven(name, place, condition)
                assert driven_episodes is not None and len(driven_episodes) == EPISODES[venue]
                driven[Key(name, place, condition)] = driven_episodes
        keep(self._log_path(number), driven)

    def _train(self, name: str, localizer: str, cell: Cell, number: int) -> float:
        """Train a policy unless it exists; return the seconds."""
        settings = yaml.safe_load(CONFIG.read_text(encoding="utf-8"))
        tuned = settings.pop("tuned")
        settings["seed"] = number * APART
        settings["environment"] |= LOCALIZERS[localizer]
        settings["environment"] |= {"reward": "shortest", "ambiguity_weight": cell.weight}
        base = run_name(localizer, Cell("base", cell.weight), number)
        seconds = self._run(base, settings, None)
        settings["hyperparameters"] |= tuned.pop("hyperparameters")
        reward = dict(PRESETS[cell.reward])
        if "error" in reward:
            reward["error"] = ERROR_WEIGHTS[localizer]
        settings["environment"]["reward"] = reward
        return seconds + self._run(name, settings | tuned, self._policy(base))

    def _run(self, name: str, settings: Mapping[str, Any], begin: Path | None) -> float:
        """Run one training, from a policy's weights if one is given; return the seconds.

        Who was interrupted begins anew.
        """
        folder, written = self._policy(name).parent, self._folder / "trained" / f"{name}.yaml"
        text = yaml.safe_dump(settings, sort_keys=False)
        if self._policy(name).is_file():
            if written.read_text(encoding="utf-8") != text:
                raise SystemExit(f"{written} is not what {CONFIG} says now; take another --folder.")
            return 0.0
        shutil.rmtree(folder, ignore_errors=True)
        written.parent.mkdir(parents=True, exist_ok=True)
        written.write_text(text, encoding="utf-8")
        begun = time.perf_counter()
        run = Run(load_training_config(written), folder, False, sys.argv, lambda status: None)
        if begin is not None:
            policy: Any = load_policy(begin)
            run.model.policy.load_state_dict(policy.model.state_dict())
        run.go()
        # A training is a reference cycle of half a gigabyte.
        del run
        gc.collect()
        return log_step(f"trained: {name}", begun)

    def _policy(self, name: str) -> Path:
        return self._folder / "trained" / name / FINAL

    def _judge(self, name: str, localizer: str, policy_source: str) -> float:
        """Run all episodes that a policy has not driven; return the seconds."""
        begun, policy, driven = time.perf_counter(), load_policy(policy_source), False
        for (venue, places), condition in product(VENUES.items(), CONDITIONS):
            for place in places:
                episodes = self._driven(name, place, condition)
                if episodes is None or len(episodes) != EPISODES[venue]:
                    parameters = NavigationParameters.of(
                        {**CONDITIONS[condition], **policy.seeing, **LOCALIZERS[localizer]}
                    )
                    count = EPISODES[venue]
                    episodes = evaluate_in(
                        policy, self._source(place), parameters, count, SEED, chunk=count
                    )
                    save_episodes(episodes, self._path(name, place, condition))
                    driven = True
        return log_step(f"driven: {name}", begun) if driven else 0.0

    def _source(self, place: str) -> BuildingSource:
        """Return the buildings of a venue, shared by all runs."""
        if place not in self._sources:
            if place in VENUES["halls"]:
                self._sources[place], _ = scenario(place, None, HALLS, UNSEEN, None, {})
            else:
                path = environment_path(place)
                self._sources[place], _ = scenario(None, path, None, 0, None, {})
        return self._sources[place]

    def _driven(self, name: str, place: str, condition: str) -> Episodes | None:
        return load_episodes(self._path(name, place, condition))

    def _path(self, name: str, place: str, condition: str) -> Path:
        return self._folder / "driven" / name / f"{place}, {condition}.npz"


def run_name(localizer: str, cell: Cell, number: int | None = None) -> str:
    """Return the name of a training's or follower's files."""
    seed = "" if number is None else f"-seed-{number * APART}"
    return f"{localizer}-{cell.reward}-{cell.weight}{seed}"


def log_step(text: str, begun: float) -> float:
    """Print what is done; return the seconds that it took."""
    seconds = time.perf_counter() - begun
    print(f"{time.strftime('%H:%M:%S')} {text}, {seconds:.0f} s", file=sys.stderr, flush=True)
    return round(seconds, 1)


def found_in(study: Study, numbers: Sequence[int]) -> Iterator[Found]:
    """Return the complete replicates, by localizer and setting; empty where there is none."""
    settings = list(product(VENUES, CONDITIONS))
    for localizer in LOCALIZERS:
        # Whole in all settings, so that all tables are of the same seeds.
        complete = [
            number
            for number in numbers
            if all(
                study.episodes(localizer, cell, number, *setting)
                for cell, setting in product(CELLS, settings)
            )
        ]
        for setting in settings if complete else ():
            cells = {
                cell: [study.episodes(localizer, cell, seed, *setting) for seed in complete]
                for cell in CELLS
            }
            for cell in FOLLOWERS:
                cells[cell] = [study.episodes(localizer, cell, None, *setting)]
            seeds = tuple(number * APART for number in complete)
            yield Found(", ".join(setting), localizer, seeds, cells)


def about(study: Study, results: Sequence[Found], numbers: Sequence[int]) -> str:
    """Describe the study: criterion, trainings, replicates."""
    settings = yaml.safe_load(CONFIG.read_text(encoding="utf-8"))
    rows = [row for number in numbers for row in kept_rows(study.log(number))]
    took = {
        task: sum(row[task] for row in rows if task in row) / 60.0 for task in ("trained", "driven")
    }
    counts = {item.localizer: ", ".join(map(str, item.seeds)) for item in results}
    replicates = "; ".join(f"`{name}`: seeds {seeds}" for name, seeds in counts.items())
    return "\n\n".join([
        str(__doc__).split("\n\n", 1)[1].strip(),
        "## What was trained",
        f"`{CONFIG.relative_to(ROOT)}`: {settings['algorithm']}, {settings['steps']:,} steps with "
        f"`shortest`, then {settings['tuned']['steps']:,} with each reward. "
        f"{sum('trained' in row for row in rows)} trainings in {took['trained']:.0f} minutes, and "
        f"{took['driven']:.0f} minutes of driving, on one core. Whole replicates: {replicates}. "
        f"Made at: {commits(rows)}.",
        "Few seeds: percentile intervals of so few groups hold less than they say, for which "
        "reason seeds are counted beside them. With one seed they hold nothing of how trainings "
        "differ.",
    ])  # fmt: skip


def main() -> None:
    """Train and evaluate what is missing, seed by seed, and report."""
    args = arguments(
        __doc__,
        folder=option(Path("out/ablation"), "where trainings go on"),
        results=option(RESULTS, "keeps the episodes of each whole seed"),
        seeds=option(range(2, 7), "numbers of the replicates", type=int),
        report_only=option(False, "train and drive nothing more"),
        picture=option(None, "draw the effects into this file", type=Path),
    )
    study = Study(args.folder, args.results)
    if not args.report_only:
        for place in VENUES["recorded maps"]:
            environment_path(place)  # better now than after the first training
        torch.set_num_threads(1)
        numba.set_num_threads(1)
        study.follow()
        for number in args.seeds:
            study.make(number)
    results = list(found_in(study, args.seeds))
    if not results:
        raise SystemExit(f"{args.results}: no replicate is whole; leave --report-only out.")
    text = f"{about(study, results, args.seeds)}\n\n{body(results)}"
    report("The ambiguity reward, and the route that avoids ambiguity", LIBRARIES, text, args.out)
    if args.picture is not None:
        save_figure(plot_effects(results), args.picture)


if __name__ == "__main__":
    main()
