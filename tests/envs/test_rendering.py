"""Pictures of episodes: where things are drawn, and that they change nothing."""

from __future__ import annotations

import builtins
import pickle
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pygame
import pytest
import shapely
from gymnasium.error import DependencyNotInstalled, ResetNeeded

import ambinav as an
import ambinav_envs
from ambinav.runtime.errors import InputError
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.rendering.camera import Camera
from ambinav_envs.rendering.floor import ZONE_COLOURS
from ambinav_envs.rendering.marks import SIGMAS, rim_of
from ambinav_envs.rendering.renderer import FINE, PANEL, SIZE
from ambinav_envs.vector import NavigationVectorEnv
from tests.envs.cases import equal, room

gym.register_envs(ambinav_envs)
PLACE: dict[str, Any] = {"start": (2.0, 6.0, 0.0), "goal": (12.0, 6.0)}
GREY, DARK = (133, 133, 133), (17, 17, 17)


@pytest.fixture(autouse=True)
def no_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


def drawn(env: NavigationEnv) -> Any:
    picture = env.render()
    assert picture is not None
    return picture


def at(env: NavigationEnv, picture: Any, place: Any, reach: int = 0) -> Any:
    """Colour of the picture at a place of the map; or all colours within so many pixels."""
    size = FINE * (SIZE[0] - PANEL), FINE * SIZE[1]
    site = env.simulation.sites[0]
    assert site is not None
    view = env._renderer._view  # type: ignore[union-attr]
    camera = Camera.on(site.building.environment, view, env.simulation.state["truth"][0], size)
    x, y = (camera.pixels(place) / FINE).astype(int)
    around = picture[y - reach : y + reach + 1, x - reach : x + reach + 1].reshape(-1, 3)
    colours = [tuple(colour) for colour in around.tolist()]
    return colours if reach else colours[0]


def test_things_are_where_they_are() -> None:
    env = NavigationEnv(map=room(), render_mode="rgb_array", people=1, obstacles=2)
    env.reset(seed=0, options=PLACE)
    picture = drawn(env)
    assert picture.shape == (640, 960, 3) and picture.dtype == np.uint8
    assert at(env, picture, (5.5, 6.0)) == GREY  # in the pillar
    assert at(env, picture, (5.0, 4.0))[0] < 60  # its wall
    assert DARK in at(env, picture, (1.9, 6.0), 4)  # the robot, behind its middle
    person = env.simulation.people[0, 0]
    assert at(env, picture, person)[0] < 60  # a head, and round it
    assert at(env, picture, person[:2] + np.array([0.16, 0.0])) == (240, 228, 66)
    # Floor in the zone's colour, away from everything.
    amap = env.simulation.sites[0].building.amap  # type: ignore[union-attr]
    zone = ("localizable", "transition", "corridor", "open")[int(amap.sample("zone", 7.5, 11.0))]
    assert at(env, picture, (7.5, 11.0)) == ZONE_COLOURS[zone]


@pytest.mark.slow
def test_a_room_in_a_hole_of_another_is_shown() -> None:
    ring = shapely.box(0, 0, 12, 12).difference(shapely.box(4, 4, 8, 8))
    both = an.environment_from_shapes([ring, shapely.box(5, 5, 7, 7)])
    env = NavigationEnv(map=both, render_mode="rgb_array")
    env.reset(seed=0, options={"start": (2.0, 2.0, 0.0), "goal": (10.0, 2.0)})
    picture = drawn(env)
    assert at(env, picture, (4.5, 6.0)) == GREY
    assert at(env, picture, (6.0, 6.0)) != GREY


@pytest.mark.slow
def test_pictures_change_no_episode() -> None:
    seen, plain = NavigationEnv(map=room(), render_mode="rgb_array"), NavigationEnv(map=room())
    equal(seen.reset(seed=5), plain.reset(seed=5))
    frames = []
    for action in np.random.default_rng(0).uniform(-1.0, 1.0, (8, 2)):
        frames.append(drawn(seen))
        equal(seen.step(action), plain.step(action))
    assert not np.array_equal(frames[0], frames[-1])
    assert np.array_equal(drawn(seen), drawn(seen))
    # The trail goes with it, the pictures of floors do not.
    assert np.array_equal(drawn(pickle.loads(pickle.dumps(seen))), drawn(seen))
    # Another episode begins another trail.
    seen.reset(seed=5)
    assert np.array_equal(drawn(seen), frames[0])


@pytest.mark.slow
@pytest.mark.parametrize("localizer", ["perfect", "odometry", "ekf"])
def test_views_and_localizers(localizer: str) -> None:
    for view in ("whole", "follow"):
        env = NavigationEnv(
            map=room(), render_mode="rgb_array", localizer=localizer, render_view=view,
            start_std=(0.001, 0.001, 0.001),
        )  # fmt: skip
        env.reset(seed=0, options=PLACE)
        assert DARK in at(env, drawn(env), (1.9, 6.0), 4)


def test_a_large_building_is_followed() -> None:
    large = an.environment_from_shapes([shapely.box(0, 0, 80, 6)])
    size = 100, 50
    assert Camera.on(large, "auto", (60.0, 3.0, 0.0), size).x == pytest.approx(60.0, abs=1.5)
    whole = Camera.on(large, "whole", (60.0, 3.0, 0.0), size)
    assert whole.x == 40.0 and whole.bounds[0] < 0.0 < 80.0 < whole.bounds[2]
    assert np.allclose(whole.pixels((40.0, 3.0)), (50.0, 25.0))
    assert whole.pixels((40.0, 5.0))[1] < 25.0  # north is up


def test_the_ellipse_is_that_of_the_covariance() -> None:
    covariance = np.array([[0.5, 0.2], [0.2, 0.3]])
    apart = rim_of(np.array([1.0, 2.0]), covariance) - (1.0, 2.0)
    squared = np.einsum("ni,ij,nj->n", apart, np.linalg.inv(covariance), apart)
    assert np.allclose(squared, SIGMAS**2)


def test_human_shows_every_step(monkeypatch: pytest.MonkeyPatch) -> None:
    env = NavigationEnv(map=room(), render_mode="human", dt=0.01)
    assert env.metadata["render_fps"] == 100
    shown = []
    env.reset(seed=0)
    monkeypatch.setattr(env._renderer, "show", lambda *_: shown.append(1))
    env.step(np.zeros(2))
    assert env.render() is None and len(shown) == 2
    monkeypatch.undo()
    env.close()
    env.close()


@pytest.mark.slow
def test_one_window_closed_leaves_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    first, second = (NavigationEnv(map=room(), render_mode="human", dt=0.01) for _ in range(2))
    first.reset(seed=0)
    second.reset(seed=1)
    first.close()
    second.step(np.zeros(2))
    assert pygame.display.get_surface() is not None
    second.close()
    assert pygame.display.get_surface() is None


@pytest.mark.slow
def test_pictures_outlive_pygame(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other environments end pygame when they are closed; Gymnasium's own do."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    still = NavigationEnv(map=room(), render_mode="rgb_array")
    shown = NavigationEnv(map=room(), render_mode="human", dt=0.01)
    still.reset(seed=0)
    shown.reset(seed=0)
    before = still.render()
    other = NavigationEnv(map=room(), render_mode="human", dt=0.01)
    other.reset(seed=1)
    pygame.quit()
    np.testing.assert_array_equal(still.render(), before)
    for env in (shown, other, shown):
        env.step(np.zeros(2))
    shown.close()
    other.close()


@pytest.mark.slow
def test_a_vector_shows_each_robot() -> None:
    envs = NavigationVectorEnv(2, map=room(), render_mode="rgb_array")
    envs.reset(seed=4)
    alone = NavigationEnv(map=room(), render_mode="rgb_array")
    alone.reset(seed=5)
    frames = envs.render()
    assert frames is not None and len(frames) == 2
    assert np.array_equal(frames[1], drawn(alone))
    envs.close()


def test_what_cannot_be_shown() -> None:
    with pytest.raises(InputError, match="rgb_array"):
        NavigationEnv(map=room(), render_mode="rgb_aray")
    with pytest.raises(InputError, match="did you mean"):
        NavigationEnv(map=room(), render_view="hole")
    with pytest.raises(ResetNeeded, match="reset"):
        NavigationEnv(map=room(), render_mode="rgb_array").render()
    for env in (NavigationEnv(map=room()), NavigationVectorEnv(1, map=room())):
        with pytest.warns(UserWarning, match="render mode"):
            assert env.render() is None


def test_pygame_is_asked_for_only_where_it_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *args: Any) -> Any:
        if name == "pygame" or name.startswith("ambinav_envs.rendering.renderer"):
            raise ModuleNotFoundError("No module named 'pygame'", name="pygame")
        return real(name, *args)

    monkeypatch.delitem(sys.modules, "ambinav_envs.rendering.renderer", raising=False)
    monkeypatch.setattr(builtins, "__import__", without)
    NavigationEnv(map=room())
    with pytest.raises(DependencyNotInstalled, match=r"ambinav\[envs\]"):
        NavigationEnv(map=room(), render_mode="rgb_array")


@pytest.mark.slow
def test_a_film_is_recorded(tmp_path: Path) -> None:
    pytest.importorskip("moviepy")
    env = gym.make("ambinav/Navigation-v1", map=room(), render_mode="rgb_array", max_steps=5)
    film = gym.wrappers.RecordVideo(env, str(tmp_path / "films"), episode_trigger=lambda _: True)
    film.reset(seed=0)
    for _ in range(5):
        film.step(np.zeros(2, dtype=np.float32))
    film.close()
    assert list(tmp_path.glob("films/*.mp4"))
