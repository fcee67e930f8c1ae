"""Types of arrays and of places, for annotations."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Floats32 = NDArray[np.float32]
Ints = NDArray[np.int64]
Ints32 = NDArray[np.int32]
Bytes = NDArray[np.uint8]
Indices = NDArray[np.intp]
UInts = NDArray[np.uint64]

Bounds = tuple[float, float, float, float]
"""A rectangle: xmin, ymin, xmax, ymax, metres."""
Pose = tuple[float, float, float]
"""x, y and heading, metres and radians."""
