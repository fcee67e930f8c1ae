"""Check that a policy's scanner and robot match those of its training."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from typing import Final

import numpy as np

from ambinav.drive.robot import Robot
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.runtime.provenance import digest_of
from ambinav.sensing.curves import Curve
from ambinav.sensing.intensity import Intensity
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.policy import Policy

Value = float | Curve | str | None

SAME: Final = 1e-9
"""Numbers that differ by less, relative to their size, are the same."""

_ROBOT: Final[Mapping[str, tuple[str, str]]] = {
    "radius": ("radius", " m"),
    "max_speed": ("speed", " m/s"),
    "max_turn_rate": ("turn rate", " rad/s"),
    "acceleration": ("acceleration", " m/s2"),
    "turn_acceleration": ("turn acceleration", " rad/s2"),
}
"""Name and unit of each field of the robot."""

_SENSOR: Final[Mapping[str, tuple[str, Callable[[RangeSensor], Value], str]]] = {
    "max_range": ("range", lambda s: s.max_range, " m"),
    "min_range": ("least range", lambda s: s.min_range, " m"),
    "aperture": ("cone", lambda s: math.degrees(s.aperture), " degrees"),
    "resolution": ("resolution", lambda s: s.resolution, " m"),
    "std": ("noise", lambda s: s.std, " m"),
    "bias": ("bias", lambda s: s.bias, " m"),
    "max_incidence": (
        "greatest incidence",
        lambda s: None if s.max_incidence is None else math.degrees(s.max_incidence),
        " degrees",
    ),
    "random_share": ("share of random readings", lambda s: s.random_share, ""),
    "lost_share": ("share of lost readings", lambda s: s.lost_share, ""),
    "intensity": ("intensity", lambda s: _intensity_text(s.intensity), ""),
}
"""Name, readable value and unit of each field of a sensor."""


def differences(policy: Policy, parameters: NavigationParameters) -> dict[str, tuple[str, ...]]:
    """Describe how scanner, robot and time step differ from those that a policy was trained with.

    Args:
        policy: The policy; its environment describes its training. Arguments that it leaves open
            fit.
        parameters: Parameters of the environment that it is to drive in.

    Returns:
        Under "scanner", "robot" and "time step", where they differ, one text for each difference.
        Names and descriptions of a scanner and its sensors do not matter.

    Raises:
        InputError: the policy's scanner, robot or time step is of no use.
    """
    arguments = {
        name: policy.environment[name]
        for name in ("scanner", "robot")
        if policy.environment.get(name) is not None
    }
    trained = NavigationParameters.of(arguments)
    by_kind: dict[str, tuple[str, ...]] = {}
    if "scanner" in arguments:
        by_kind["scanner"] = tuple(_scanner_differences(trained.scanner, parameters.scanner))
    if "robot" in arguments:
        by_kind["robot"] = tuple(_robot_differences(trained.robot, parameters.robot))
    dt = trained_dt(policy)
    if dt is not None and not _same(dt, parameters.dt):
        by_kind["time step"] = (f"{dt:.4g} s, here {parameters.dt:.4g} s",)
    return {name: texts for name, texts in by_kind.items() if texts}


def trained_dt(policy: Policy) -> float | None:
    """Return the time step of a policy's training, seconds; None: it has none of its own."""
    dt = policy.environment.get("dt")
    if dt is not None:
        return NavigationParameters.of({"dt": dt}).dt
    # What names its scanner was trained, and what it leaves out was as by default.
    is_trained = policy.environment.get("scanner") is not None
    return NavigationParameters().dt if is_trained else None


def difference_text(differing: Mapping[str, Sequence[str]]) -> str:
    """Format differences as one line: "another robot (radius 0.22 m, here 0.4 m)"."""
    return " and ".join(f"another {name} ({'; '.join(texts)})" for name, texts in differing.items())


def check_fit(
    policy: Policy, parameters: NavigationParameters, force: bool
) -> dict[str, tuple[str, ...]]:
    """Refuse a policy trained with another scanner, robot or time step; warn if it is forced.

    Args:
        policy: The policy.
        parameters: Parameters of the environment that it is to drive in.
        force: Let it drive all the same.

    Returns:
        See `differences`; none unless it is forced.

    Raises:
        InputError: there are differences, and it is not forced.

    Warns:
        InputWarning: there are differences, and it is forced; or other code trained the policy.
    """
    differing = differences(policy, parameters)
    reason = f"policy {policy.name!r} was trained with {difference_text(differing)}"
    if differing and not force:
        raise InputError(
            f"{reason}; give what it was trained with, train another policy, or add --force "
            "(force=True in Python) to let it drive all the same."
        )
    if differing:
        warnings.warn(f"{reason}; it drives all the same.", InputWarning, stacklevel=2)
    if policy.other_code is not None:
        warnings.warn(f"policy {policy.name!r} {policy.other_code}.", InputWarning, stacklevel=2)
    return differing


def _robot_differences(trained: Robot, current: Robot) -> list[str]:
    texts = []
    for field in fields(Robot):
        name, unit = _ROBOT[field.name]
        was, now = getattr(trained, field.name), getattr(current, field.name)
        if not _same(was, now):
            texts.append(f"{name} {was:.4g}{unit}, here {now:.4g}{unit}")
    return texts


def _scanner_differences(trained: RangeScanner, current: RangeScanner) -> list[str]:
    """List the differences, coarse ones first; the list is empty only if every beam is equal."""
    texts = []
    if trained.beams != current.beams:
        texts.append(f"beams {trained.beams}, here {current.beams}")
    was, now = math.degrees(trained.aperture), math.degrees(current.aperture)
    if not _same(was, now):
        texts.append(f"aperture {was:.4g} degrees, here {now:.4g} degrees")
    for name, value_of, unit in _SENSOR.values():
        texts += _sensor_difference(trained, current, name, value_of, unit)
    # A scanner with a full field of view has no mean direction.
    yaw = not (trained.looks_all_around or current.looks_all_around)
    was_at, now_at = _mount_text(trained, yaw), _mount_text(current, yaw)
    if was_at != now_at:
        texts.append(f"mount {was_at}, here {now_at}")
    elif trained.beams == current.beams and not texts:
        turned = np.abs(np.angle(np.exp(1j * (trained.mounts[:, 2] - current.mounts[:, 2]))))
        moved = np.abs(trained.mounts[:, :2] - current.mounts[:, :2])
        if max(turned.max(), moved.max()) > SAME:
            texts.append("beams that stand or look otherwise")
    return texts


def _sensor_difference(
    trained: RangeScanner,
    current: RangeScanner,
    name: str,
    value_of: Callable[[RangeSensor], Value],
    unit: str,
) -> list[str]:
    """Compare one field of the sensors, beam by beam if both have as many beams."""
    rows = [[value_of(sensor) for sensor in scanner.sensors] for scanner in (trained, current)]
    if trained.beams == current.beams:
        sensor_pairs = zip(trained.sensor_of_beam, current.sensor_of_beam, strict=True)
        same = all(
            _same(rows[0][i], rows[1][j]) for i, j in {(int(i), int(j)) for i, j in sensor_pairs}
        )
    else:
        same = all(any(_same(a, b) for b in rows[1]) for a in rows[0]) and all(
            any(_same(a, b) for a in rows[0]) for b in rows[1]
        )
    if same:
        return []
    was, now = (" and ".join(dict.fromkeys(_value_text(v, unit) for v in row)) for row in rows)
    return [f"{name} {was}, here {now}" if was != now else f"{name} {was}, here of other beams"]


def _value_text(value: Value, unit: str) -> str:
    if value is None:
        return "any"
    if isinstance(value, str):
        return value
    if isinstance(value, int | float):
        return f"{value:.4g}{unit}"
    # A polynomial or a table over the true range: enough of it to distinguish it from another.
    return f"curve {digest_of(value)[:6]}"


def _intensity_text(channel: Intensity | None) -> str:
    """Describe an intensity channel completely."""
    if channel is None:
        return "none"
    return ", ".join(f"{name} {value!r}" for name, value in channel.to_plain().items())


def _mount_text(scanner: RangeScanner, with_yaw: bool) -> str:
    """Format the beams' mean mount: x, y in metres, and if requested yaw in degrees."""
    x, y = scanner.mounts[:, :2].mean(axis=0)
    text = f"({_rounded(x)}, {_rounded(y)}) m"
    if not with_yaw:
        return text
    yaw = np.angle(np.exp(1j * scanner.mounts[:, 2]).mean(), deg=True)
    return f"{text} at {_rounded(yaw)} degrees"


def _rounded(value: float) -> str:
    return f"{round(float(value), 4) + 0.0:g}"


def _same(first: Value, second: Value) -> bool:
    """Return whether two values are equal up to rounding."""
    if isinstance(first, int | float) and isinstance(second, int | float):
        return math.isclose(first, second, rel_tol=SAME, abs_tol=SAME)
    return bool(first == second)
