"""The normalisation of observations that a policy was trained with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambinav.runtime.array_types import Floats, Floats32
from ambinav.runtime.errors import InputError

ROW = "observation"
"""Name of the only part where an observation is one row."""

Observation = dict[str, Floats32]


@dataclass(frozen=True, eq=False)
class Normalization:
    """Scales parts of observations to mean 0 and variance 1, as Stable-Baselines3's VecNormalize.

    Attributes:
        mean: By part; parts that are not there stay as they are.
        var: Variances of the same parts, of the same shapes.
        clip: Normalised numbers are cut off beyond this.
        epsilon: Added to variances.
    """

    mean: dict[str, Floats]
    var: dict[str, Floats]
    clip: float = 10.0
    epsilon: float = 1e-8

    @classmethod
    def of(cls, normalize: Any) -> Normalization | None:
        """Copy the observation statistics of a `VecNormalize`; None if it does not use them."""
        if not normalize.norm_obs:
            return None
        moments = normalize.obs_rms
        if not isinstance(moments, dict):
            moments = {ROW: moments}
        return cls(
            {name: np.array(moment.mean, dtype=np.float64) for name, moment in moments.items()},
            {name: np.array(moment.var, dtype=np.float64) for name, moment in moments.items()},
            float(normalize.clip_obs),
            float(normalize.epsilon),
        )

    def __call__(self, observation: Observation) -> Observation:
        """Return the normalised observation."""
        return {name: self._part(name, part) for name, part in observation.items()}

    def _part(self, name: str, part: Floats32) -> Floats32:
        if name not in self.mean:
            return part
        scaled = (part - self.mean[name]) / np.sqrt(self.var[name] + self.epsilon)
        return np.clip(scaled, -self.clip, self.clip).astype(np.float32)

    def tensors(self) -> dict[str, Floats]:
        """Return the statistics as tensors by name: mean.PART and var.PART."""
        means = {f"mean.{name}": value for name, value in self.mean.items()}
        return means | {f"var.{name}": value for name, value in self.var.items()}

    @classmethod
    def of_tensors(
        cls,
        tensors: Mapping[str, NDArray[Any]],
        sizes: Mapping[str, int],
        clip: float,
        epsilon: float,
    ) -> Normalization:
        """Create a normalisation from the output of `tensors`, and check it.

        Args:
            tensors: By name.
            sizes: Sizes of the parts of an observation; `ROW` where it is one row.
            clip: See above.
            epsilon: See above.

        Raises:
            InputError: a name, type, size or number is of no use.
        """
        moments: dict[str, dict[str, Floats]] = {"mean": {}, "var": {}}
        for name, values in tensors.items():
            kind, _, part = name.partition(".")
            if kind not in moments or part not in sizes:
                raise InputError(f"the normalisation has no place for {name[:80]!r}; save it anew.")
            if values.dtype != np.float64 or values.shape != (sizes[part],):
                raise InputError(
                    f"the normalisation's {name!r} is {values.dtype} of the shape {values.shape}, "
                    f"not float64 of ({sizes[part]},); save it anew."
                )
            if not np.isfinite(values).all() or (kind == "var" and values.min(initial=0.0) < 0.0):
                raise InputError(
                    f"the normalisation's {name!r} has numbers that are none; save it anew."
                )
            moments[kind][part] = values
        if moments["mean"].keys() != moments["var"].keys():
            raise InputError("the normalisation's means and variances do not match; save it anew.")
        return cls(moments["mean"], moments["var"], float(clip), float(epsilon))


def sizes_of(observation: Mapping[str, Any]) -> dict[str, int]:
    """Return the sizes of an observation's parts, see `Normalization.of_tensors`."""
    parts = observation.get("parts", {ROW: observation})
    return {name: int(part["size"]) for name, part in parts.items()}
