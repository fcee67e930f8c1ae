"""The normalisation of observations that a policy was trained with."""

from __future__ import annotations

import io
import zipfile
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambinav.errors import InputError

ROW = "observation"
"""Name of the only part where an observation is one row."""

Floats = NDArray[np.float64]
Observation = dict[str, NDArray[np.float32]]


@dataclass(frozen=True, eq=False)
class Normalization:
    """Brings parts of observations to mean 0 and variance 1, as Stable-Baselines3's VecNormalize.

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
        """What a `VecNormalize` does to observations now; None if it leaves them alone."""
        if not normalize.norm_obs:
            return None
        moments = normalize.obs_rms
        if not isinstance(moments, dict):
            moments = {ROW: moments}
        return cls(
            {name: np.array(one.mean, dtype=np.float64) for name, one in moments.items()},
            {name: np.array(one.var, dtype=np.float64) for name, one in moments.items()},
            float(normalize.clip_obs),
            float(normalize.epsilon),
        )

    def __call__(self, observation: Observation) -> Observation:
        """The observation normalised."""
        return {name: self._part(name, part) for name, part in observation.items()}

    def _part(self, name: str, part: NDArray[np.float32]) -> NDArray[np.float32]:
        if name not in self.mean:
            return part
        scaled = (part - self.mean[name]) / np.sqrt(self.var[name] + self.epsilon)
        return np.clip(scaled, -self.clip, self.clip).astype(np.float32)

    def to_bytes(self) -> bytes:
        """As an .npz file: mean_NAME, var_NAME, clip, epsilon."""
        out = io.BytesIO()
        arrays = {f"mean_{name}": value for name, value in self.mean.items()}
        arrays |= {f"var_{name}": value for name, value in self.var.items()}
        np.savez(out, **arrays, clip=np.array(self.clip), epsilon=np.array(self.epsilon))  # type: ignore[arg-type]
        return out.getvalue()

    @classmethod
    def from_bytes(cls, content: bytes) -> Normalization:
        """Read what `to_bytes` made.

        Raises:
            InputError: it is something else.
        """
        try:
            with np.load(io.BytesIO(content)) as stored:
                arrays = {name: stored[name] for name in stored.files}
            clip, epsilon = float(arrays.pop("clip")), float(arrays.pop("epsilon"))
        except (OSError, ValueError, KeyError, EOFError, zlib.error, zipfile.BadZipFile) as error:
            raise InputError(
                f"the normalisation cannot be read ({error}); save it anew."
            ) from error
        mean, var = (
            {
                name.removeprefix(kind): value
                for name, value in arrays.items()
                if name.startswith(kind)
            }
            for kind in ("mean_", "var_")
        )
        if {name: value.shape for name, value in mean.items()} != {
            name: value.shape for name, value in var.items()
        }:
            raise InputError("the normalisation's means and variances do not match; save it anew.")
        return cls(mean, var, clip, epsilon)
