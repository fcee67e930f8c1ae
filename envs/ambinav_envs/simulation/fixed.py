"""The arrays that stay the same from step to step, handed to the kernels as one record."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ambinav.localization.information import TABLE
from ambinav_envs.simulation.eyes import Eyes
from ambinav_envs.simulation.layout import FIXED, GROUND, SETTINGS, STATE, Memory
from ambinav_envs.simulation.pointers import address, array_at


def fixed_of(memory: Memory, eyes: Eyes) -> NDArray[np.void]:
    """`layout.FIXED`, shape (1,); it is valid as long as the arrays live."""
    sizes = {
        "robots": memory.state.size, "persons": memory.people.shape[1],
        "most_boxes": memory.boxes.shape[1], "groups": len(eyes.origin), "rays": len(eyes.cosine),
        "beams": len(eyes.near), "sensors": len(eyes.shift), "edges": len(eyes.run),
    }  # fmt: skip
    fixed = np.zeros(1, dtype=FIXED)
    for name, size in sizes.items():
        fixed[name] = size
    arrays: dict[str, NDArray[Any]] = memory._asdict() | eyes._asdict()
    for name, array in arrays.items():
        fixed[name] = address(array, array.dtype)
    return fixed


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def memory_at(fixed):
    """`Memory`."""
    robots = fixed.robots
    return Memory(
        array_at(fixed.state, (robots,), STATE),
        array_at(fixed.ground, (robots,), GROUND),
        array_at(fixed.people, (robots, fixed.persons, 3), np.float64),
        array_at(fixed.boxes, (robots, fixed.most_boxes, 6), np.float64),
        array_at(fixed.readings, (robots, fixed.beams), np.float64),
        array_at(fixed.settings, (1,), SETTINGS),
    )


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def eyes_at(fixed):
    """`Eyes`."""
    rays, beams, sensors = fixed.rays, fixed.beams, fixed.sensors
    return Eyes(
        array_at(fixed.origin, (fixed.groups, 2), np.float64),
        array_at(fixed.first, (fixed.groups + 1,), np.int64),
        array_at(fixed.cosine, (rays,), np.float64),
        array_at(fixed.sine, (rays,), np.float64),
        array_at(fixed.beam, (rays,), np.int64),
        array_at(fixed.limit, (rays,), np.float64),
        array_at(fixed.incidence, (rays,), np.float64),
        array_at(fixed.start, (rays, 2), np.float64),
        array_at(fixed.near, (beams,), np.float64),
        array_at(fixed.far, (beams,), np.float64),
        array_at(fixed.sensor, (beams,), np.int64),
        array_at(fixed.shift, (sensors, TABLE), np.float64),
        array_at(fixed.std, (sensors, TABLE), np.float64),
        array_at(fixed.run, (fixed.edges,), np.int64),
        array_at(fixed.reading, (sensors, 7), np.float64),
    )
