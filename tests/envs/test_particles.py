"""Particle filters in the environments: each is the one-robot localizer, whoever drives beside."""

from __future__ import annotations

import pickle
from typing import Any

import numba
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import SyncVectorEnv

from ambinav.geometry.environment import Environment
from ambinav.localization.filter_state import filter_bytes
from ambinav.localization.mcl import MonteCarloLocalizer
from ambinav.localization.odometry import wrapped
from ambinav.runtime import threads
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.simulation.layout import PARTICLES
from ambinav_envs.simulation.particles import ParticleFilters
from ambinav_envs.simulation.simulation import SHARED_FILTERS
from ambinav_envs.vector import NavigationVectorEnv
from tests.envs.cases import equal, room

FEW: dict[str, Any] = {"min_particles": 60, "max_particles": 120}
SUITE: dict[str, Any] = {
    "suite": "procedural", "buildings": 2, "localizer": "mcl", "mcl": FEW, "people": 1,
    "obstacles": 2, "max_steps": 25, "window": False,
}  # fmt: skip
RING = RangeScanner.from_preset("polaroid-6500-ring")
PRODUCT = {
    "laser_model_type": "likelihood_field_prob", "likelihood_interpolation": "bilinear",
    "localizability_weighting": 0.5, "recovery_alpha_slow": 0.001, "recovery_alpha_fast": 0.1,
}  # fmt: skip


def actions(count: int, steps: int, seed: int = 0) -> Any:
    return np.random.default_rng(seed).uniform(-0.5, 1, (steps, count, 2)).astype(np.float32)


def filters_of(envs: NavigationVectorEnv) -> ParticleFilters:
    found = envs.simulation._filters
    assert found is not None
    return found


class OneByOne:
    """A `MonteCarloLocalizer` for each robot, started when the robot's own filter is."""

    def __init__(self, envs: NavigationVectorEnv, monkeypatch: pytest.MonkeyPatch) -> None:
        self.simulation, self.filters = envs.simulation, filters_of(envs)
        self.localizers: dict[int, MonteCarloLocalizer] = {}
        start = self.filters.start

        def watched(rows: Any, robots: Any, site: Any) -> None:
            for i in rows.tolist():
                self.begin(i)
            start(rows, robots, site)

        monkeypatch.setattr(self.filters, "start", watched)

    def begin(self, i: int) -> None:
        p, robot, site = (
            self.simulation.parameters,
            self.simulation.state[i],
            self.simulation.sites[i],
        )
        assert site is not None
        environment: Environment = site.building.environment
        rng = np.random.Generator(np.random.PCG64(robot["random"][PARTICLES]))
        localizer = MonteCarloLocalizer(environment, p.scanner, p.particles, rng=rng)
        localizer.start(robot["mean"], robot["covariance"])
        self.localizers[i] = localizer

    def check(self) -> int:
        """Take in what the robots did; how many filters took the scan in."""
        updates = 0
        for i, localizer in self.localizers.items():
            robot = self.simulation.state[i]
            updates += int(localizer.update(robot["odometry"], self.simulation.readings[i])[0])
            assert (localizer.mean[0] == robot["mean"]).all()
            assert (localizer.covariance[0] == robot["covariance"]).all()
            count = localizer.counts[0]
            assert self.filters.state.number[i] == count
            assert (
                localizer.state.particles[0, :count] == self.filters.state.particles[i, :count]
            ).all()
        return updates


@pytest.mark.slow(kept=("field", "product"))
@pytest.mark.parametrize(
    ("mcl", "scanner"), [({}, None), (PRODUCT, None), ({}, RING)], ids=["field", "product", "cones"]
)
def test_each_is_the_one_robot_localizer(
    mcl: dict[str, Any], scanner: RangeScanner | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bit for bit, over many episodes."""
    options = SUITE | {"mcl": FEW | mcl} | ({} if scanner is None else {"scanner": scanner})
    envs = NavigationVectorEnv(5, **options)
    others = OneByOne(envs, monkeypatch)
    envs.reset(seed=3)
    assert others.check() == 5
    updates = 0
    for action in actions(5, 60):
        envs.step(action)
        updates += others.check()
    assert 60 < updates < 300
    kind = envs.simulation.parameters.particles.laser_model_type
    assert kind == ("beam_prob" if scanner is RING else mcl.get("laser_model_type", kind))


@pytest.mark.slow
def test_neither_number_order_nor_threads_change_a_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("numba.get_num_threads", lambda: 2)
    threads._pools.clear()
    count = 2 * SHARED_FILTERS + 1
    order = np.random.default_rng(0).permutation(count)
    many, mixed = NavigationVectorEnv(count, **SUITE), NavigationVectorEnv(count, **SUITE)
    single = SyncVectorEnv([lambda: NavigationEnv(**SUITE)] * 2)
    seen = many.reset(seed=7)[0]
    equal({k: v[order] for k, v in seen.items()}, mixed.reset(seed=(7 + order).tolist())[0])
    equal({k: v[:2] for k, v in seen.items()}, single.reset(seed=7)[0])
    for action in actions(count, 40):
        seen, rewards = many.step(action)[:2]
        other, others = mixed.step(action[order])[:2]
        equal({k: v[order] for k, v in seen.items()}, other)
        assert (rewards[order] == others).all()
        equal({k: v[:2] for k, v in seen.items()}, single.step(action[:2])[0])
    assert 2 in threads._pools


def test_a_scan_is_taken_in_only_after_motion() -> None:
    """AMCL's rule, as told from the odometry: 0.25 m along an axis, or 0.2 rad."""
    envs = NavigationVectorEnv(3, map=room(), localizer="mcl", mcl=FEW, max_steps=10**6)
    envs.reset(seed=0)
    ticks, state = filters_of(envs).state.ticks, envs.simulation.state
    anchor, wanted = state["odometry"].copy(), np.ones(3, dtype=int)
    # One stands, one turns on the spot, one drives in circles.
    for _ in range(50):
        envs.step(np.array([[-1.0, 0.0], [-1.0, 0.3], [1.0, 0.3]]))
        off = state["odometry"] - anchor
        far = np.abs(off[:, :2]).max(axis=1) > 0.25
        far |= np.array([abs(wrapped(turn)) > 0.2 for turn in off[:, 2]])
        wanted += far
        anchor[far] = state["odometry"][far]
        assert (ticks[:, 1] == wanted).all()
    assert wanted[0] == 1 and wanted[1:].min() > 5


@pytest.mark.slow
def test_pickled_in_the_middle_and_without_the_map() -> None:
    envs = NavigationVectorEnv(4, **SUITE)
    envs.reset(seed=2)
    for action in actions(4, 10):
        envs.step(action)
    plain = pickle.dumps(envs)
    kalman = NavigationVectorEnv(4, **SUITE | {"localizer": "ekf"})
    kalman.reset(seed=2)
    state = sum(part.nbytes for part in filters_of(envs).state)
    assert len(plain) < len(pickle.dumps(kalman)) + state + 20_000
    other = pickle.loads(plain)
    for action in actions(4, 40, seed=1):
        equal(envs.step(action), other.step(action))


@pytest.mark.slow
def test_a_mask_leaves_the_filters_of_the_others_alone() -> None:
    envs = NavigationVectorEnv(4, **SUITE, autoreset_mode="Disabled")
    envs.reset(seed=0)
    for action in actions(4, 5):
        envs.step(action)
    before = [part.copy() for part in filters_of(envs).state]
    mask = np.array([False, True, False, False])
    envs.reset(seed=9, options={"reset_mask": mask})
    for was, now in zip(before, filters_of(envs).state, strict=True):
        assert np.array_equal(was[~mask], now[~mask])
    alone = NavigationEnv(**SUITE)
    alone.reset(seed=10)
    assert (alone.simulation.state["mean"][0] == envs.simulation.state["mean"][1]).all()
    # What is refused leaves the filters as they are too.
    with pytest.raises(InputError, match="building"):
        envs.reset(options={"building": 99, "reset_mask": ~mask})
    assert np.array_equal(before[0][~mask], filters_of(envs).state.particles[~mask])


def test_filters_that_do_not_fit_are_refused() -> None:
    envs = NavigationVectorEnv(3, map=room(), localizer="mcl", mcl=FEW)
    size = sum(part.nbytes for part in filters_of(envs).state)
    assert size / 3 == pytest.approx(filter_bytes(envs.simulation.parameters.particles), abs=600)
    with pytest.raises(InputError, match=r"^mcl: max_particles is 1000000000, which takes .* GB"):
        NavigationEnv(map=room(), localizer="mcl", mcl={"max_particles": 10**9})


@pytest.mark.slow
def test_all_buildings_are_of_one_type() -> None:
    envs = NavigationVectorEnv(8, **SUITE | {"suite": "office"})
    envs.reset(seed=0)
    other = NavigationVectorEnv(1, map=room(), localizer="mcl", mcl=FEW)
    other.reset(seed=0)
    sites = [*envs.simulation.sites, *other.simulation.sites]
    assert len({numba.typeof(site.particles) for site in sites if site is not None}) == 1


def test_gymnasium_finds_no_fault() -> None:
    check_env(NavigationEnv(map=room(), localizer="mcl", mcl=FEW), skip_render_check=True)
