"""The arrays that stay the same from step to step, handed to the kernels as one record."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ambinav.localization.information import TABLE
from ambinav.provenance import code_digest
from ambinav_envs.simulation.eyes import Eyes
from ambinav_envs.simulation.layout import SETTINGS, STATE, WHERE, Memory, record
from ambinav_envs.simulation.pointers import address, array_at


def record_for(code: str) -> np.dtype[np.void]:
    """The type of the record for a checksum of the code, which is part of it.

    numba keeps machine code by the file of the function and by the types of its arguments. It would
    load that of other layouts, or of other functions that are called, where the file is the same.
    """
    whole = np.int64
    return record(
        **{f"code_{code}": whole},
        # How many robots, people and boxes around each.
        robots=whole, persons=whole, most_boxes=whole,
        # Of `Memory`.
        state=whole, where=whole, people=whole, boxes=whole, readings=whole, settings=whole,
        # Sizes of the arrays of `Eyes`.
        groups=whole, rays=whole, beams=whole, sensors=whole, edges=whole,
        # And these.
        origin=whole, first=whole, cosine=whole, sine=whole, beam=whole, limit=whole,
        incidence=whole, start=whole, reach=whole, plain=whole, anchor=whole, near=whole,
        far=whole, sensor=whole, shift=whole, std=whole, run=whole, reading=whole,
    )  # fmt: skip


FIXED = record_for(code_digest()[:16])
"""What stays the same from step to step, as addresses like those of `layout.GROUND`.

To hand numba some thirty arrays takes longer than to step a robot.
"""

_KINDS: dict[str, Any] = {
    "state": STATE, "where": WHERE, "settings": SETTINGS, "first": np.int64, "beam": np.int64,
    "plain": np.bool_, "anchor": np.bool_, "sensor": np.int64, "run": np.int64,
}  # fmt: skip
"""Types of the arrays that are not float64."""


def fixed_of(memory: Memory, eyes: Eyes) -> NDArray[np.void]:
    """`FIXED`, shape (1,); it is valid as long as the arrays live."""
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
        fixed[name] = address(array, _KINDS.get(name, np.float64))
    return fixed


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def memory_at(fixed):
    """`Memory`."""
    robots = fixed.robots
    return Memory(
        array_at(fixed.state, (robots,), STATE),
        array_at(fixed.where, (robots,), WHERE),
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
        array_at(fixed.reach, (fixed.groups,), np.float64),
        array_at(fixed.plain, (1,), np.bool_),
        array_at(fixed.anchor, (rays,), np.bool_),
        array_at(fixed.near, (beams,), np.float64),
        array_at(fixed.far, (beams,), np.float64),
        array_at(fixed.sensor, (beams,), np.int64),
        array_at(fixed.shift, (sensors, TABLE), np.float64),
        array_at(fixed.std, (sensors, TABLE), np.float64),
        array_at(fixed.run, (fixed.edges,), np.int64),
        array_at(fixed.reading, (sensors, 7), np.float64),
    )
