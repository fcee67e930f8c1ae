"""The record that stands for thirty arrays: the kernels find the same arrays at its addresses."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numba import njit

from ambinav_envs.simulation.fixed import eyes_at, fixed_of, memory_at
from ambinav_envs.simulation.layout import Memory
from ambinav_envs.simulation.scanner_kernel import Eyes
from tests.envs.cases import room


@njit
def arrays_of(fixed: Any) -> Any:
    return memory_at(fixed[0]), eyes_at(fixed[0])


def test_kernels_see_the_very_arrays() -> None:
    env = gym.make("ambinav/Navigation-v0", map=room(), people=1, obstacles=2)
    env.reset(seed=3)
    simulation = env.unwrapped.simulation  # type: ignore[attr-defined]
    memory, eyes = arrays_of(fixed_of(simulation._memory, simulation._eyes))
    for mine, theirs in ((simulation._memory, Memory(*memory)), (simulation._eyes, Eyes(*eyes))):
        for name, array in mine._asdict().items():
            other = getattr(theirs, name)
            assert other.dtype == array.dtype and other.shape == array.shape, name
            assert other.ctypes.data == array.ctypes.data, name


def test_arrays_of_another_type_are_refused() -> None:
    env = gym.make("ambinav/Navigation-v0", map=room())
    env.reset(seed=3)
    simulation = env.unwrapped.simulation  # type: ignore[attr-defined]
    short = simulation._eyes._replace(beam=simulation._eyes.beam.astype(np.int32))
    with pytest.raises(TypeError, match="int32"):
        fixed_of(simulation._memory, short)
