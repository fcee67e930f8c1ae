"""Optimum orientation and aperture of each place, on floors where they are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.layers.best_yaw import axis
from ambinav.layers.build import with_layers
from ambinav.layers.registry import chosen_layers
from ambinav.runtime.errors import InputError
from tests.geometry import scenes

LASER = an.RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
SONAR = an.RangeSensor(max_range=2.0, std=0.03, resolution=0.01, aperture=0.5)


def fan(
    aperture: float, beams: int, mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> an.RangeScanner:
    return an.RangeScanner.planar(LASER, beams, math.radians(aperture), mount)


@pytest.mark.slow
def test_it_is_the_best_heading_of_the_map() -> None:
    env = scenes.scene(3, size=4.0, blocks=4, thin=2)
    for scanner in (fan(90, 16), fan(90, 16, (0.1, 0.05, 0.3))):
        amap = an.build_map(env, scanner, headings=8, store=False)
        found = with_layers(amap, ["best_yaw"], best_yaw={"yaws": 8}).dataset
        np.testing.assert_allclose(found["best_yaw"], found["level_best"], atol=1e-6)
        gain = found["level_mean"] - found["level_best"]
        np.testing.assert_allclose(found["best_yaw_gain"], gain, atol=1e-5)
        turned = (
            found["best_yaw_angle"]
            - found["best_heading"]
            - scanner.parts[0].layout.mounts()[:, 2].mean()
        )
        apart = np.abs(np.angle(np.exp(1j * turned.values)))
        # Where two headings are as good, either may be told.
        told = (np.sort(found["level"], axis=2)[..., 1] - found["level_best"]) > 1e-5
        assert apart[np.asarray(told)].max() < 1e-5


def test_angles_are_less_than_a_turn() -> None:
    """Where the best direction is the fan's own, rounding is on either side of 0."""
    env = an.environment_from_shapes([shapely.box(0.013, 0.017, 12.013, 1.617)])
    amap = an.build_map(env, fan(90, 15), 0.4, layers=["best_yaw"], store=False)
    angle = amap.dataset["best_yaw_angle"].values
    assert np.nanmin(angle) == 0.0 and np.nanmax(angle) < 2.0 * math.pi


@pytest.mark.slow
def test_at_the_end_of_a_corridor_it_looks_at_the_end() -> None:
    env = scenes.room(12.0, 1.5)
    amap = an.build_map(env, fan(60, 11), 0.1, headings=1, store=False)
    found = with_layers(amap, ["best_yaw"])
    east = found.sample("best_yaw_angle", 10.0, 0.75)
    west = found.sample("best_yaw_angle", 2.0, 0.75)
    assert math.cos(float(east)) > 0.8
    assert math.cos(float(west)) < -0.8
    # An angle is read from the cell: halfway between two it is neither's mean.
    both = found.dataset["best_yaw_angle"].values
    assert np.isin(np.float32(found.sample("best_yaw_angle", 6.003, 0.7)), both)


@pytest.mark.slow
def test_in_a_room_a_little_is_enough_and_in_the_open_all_is() -> None:
    room = an.build_map(scenes.room(2.0, 1.6), fan(240, 41), headings=1, store=False)
    found = with_layers(room, ["best_aperture"])
    aperture = found.dataset["best_aperture"].values
    assert np.nanmax(aperture) <= 180.0
    around = an.build_map(scenes.room(2.0, 1.6), fan(360, 60), store=False)
    np.testing.assert_allclose(
        found.dataset["best_aperture_around"], around.dataset["level"], atol=1e-5
    )
    # With nothing in range nothing is better than the smallest.
    hall = an.build_map(scenes.room(12.0, 12.0), fan(240, 41), 0.4, 0.8, headings=1, store=False)
    found = with_layers(hall, ["best_aperture"])
    assert float(found.sample("best_aperture", 6.0, 6.0)) == pytest.approx(30.0)


@pytest.mark.slow
def test_a_larger_loss_needs_less() -> None:
    amap = an.build_map(scenes.scene(3, size=4.0, blocks=4, thin=2), fan(240, 41), 0.2, store=False)
    apertures = [
        with_layers(
            amap, ["best_aperture"], best_aperture={"loss": loss, "yaws": 4, "step": math.pi / 3}
        ).dataset["best_aperture"].values
        for loss in (0.0, 0.05, 1.0)
    ]  # fmt: skip
    free = np.isfinite(apertures[0])
    assert (apertures[0][free] >= apertures[1][free]).all()
    assert (apertures[2][free] == np.float32(60.0)).all()


def test_what_a_scanner_cannot_have_is_refused() -> None:
    with pytest.raises(InputError, match="cannot have best_yaw: it looks all around"):
        chosen_layers(["best_yaw"], fan(360, 60))
    for scanner in (an.RangeScanner.ring(SONAR, 8, 0.2), an.RangeScanner.planar(LASER, 1, 0.0)):
        with pytest.raises(InputError, match="cannot have best_aperture: only a single planar fan"):
            chosen_layers(["best_aperture"], scanner)
    assert len(chosen_layers(["best_aperture"], fan(360, 60))) == 1


@pytest.mark.parametrize(
    ("layer", "options", "what"),
    [
        ("best_yaw", {"yaws": 0}, "yaws"),
        ("best_aperture", {"loss": -1.0}, "loss is -1"),
        ("best_aperture", {"step": 0.0}, "step is 0"),
        ("best_aperture", {"step": math.nan}, "step is nan"),
    ],
)
def test_options_are_checked(layer: str, options: dict[str, float], what: str) -> None:
    amap = an.build_map(scenes.room(1.0, 1.0), fan(90, 4), 0.5, store=False)
    with pytest.raises(InputError, match=what):
        with_layers(amap, [layer], **{layer: options})  # type: ignore[arg-type]


def test_the_axis_is_where_the_beams_look() -> None:
    assert axis(fan(90, 16, (0.1, 0.0, 0.3))) == pytest.approx(0.3)
    assert axis(an.RangeScanner.from_mounts(LASER, [[0, 0, 1.0], [0, 0, 1.0 + math.pi]])) == 0.0
