"""The arrays that stay the same from step to step, handed to the kernels as one record."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambinav.kernels import kernel
from ambinav.localization.information import TABLE
from ambinav_envs.simulation.layout import SETTINGS, STATE, WHERE, Memory, record
from ambinav_envs.simulation.pointers import address, array_at
from ambinav_envs.simulation.scanner_kernel import Eyes

_WHOLE = np.int64
FIXED = record(
    # How many robots, people and boxes around each.
    robots=_WHOLE, persons=_WHOLE, most_boxes=_WHOLE,
    # Of `Memory`.
    state=_WHOLE, where=_WHOLE, people=_WHOLE, boxes=_WHOLE, readings=_WHOLE, settings=_WHOLE,
    # Sizes of the arrays of `Eyes`.
    groups=_WHOLE, rays=_WHOLE, beams=_WHOLE, sensors=_WHOLE, edges=_WHOLE,
    # And these.
    origin=_WHOLE, first=_WHOLE, cosine=_WHOLE, sine=_WHOLE, beam=_WHOLE, limit=_WHOLE,
    incidence=_WHOLE, start=_WHOLE, reach=_WHOLE, plain=_WHOLE, anchor=_WHOLE, inner=_WHOLE,
    near=_WHOLE, far=_WHOLE, sensor=_WHOLE, shift=_WHOLE, std=_WHOLE, run=_WHOLE, reading=_WHOLE,
)  # fmt: skip
"""What stays the same from step to step, as addresses like those of `layout.GROUND`.

To hand numba some thirty arrays takes longer than to step a robot.
"""

_KINDS: dict[str, Any] = {
    "state": STATE, "where": WHERE, "settings": SETTINGS, "first": np.int64, "beam": np.int64,
    "plain": np.bool_, "anchor": np.bool_, "inner": np.bool_, "sensor": np.int64,
    "run": np.int64,
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


@kernel(forceinline=True)
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


@kernel(forceinline=True)
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
        array_at(fixed.inner, (rays,), np.bool_),
        array_at(fixed.near, (beams,), np.float64),
        array_at(fixed.far, (beams,), np.float64),
        array_at(fixed.sensor, (beams,), np.int64),
        array_at(fixed.shift, (sensors, TABLE), np.float64),
        array_at(fixed.std, (sensors, TABLE), np.float64),
        array_at(fixed.run, (fixed.edges,), np.int64),
        array_at(fixed.reading, (sensors, 7), np.float64),
    )
