"""Range scanner: any set of range sensors, mounted anywhere on the robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import as_array, as_count, as_number, check_generator, check_kind, read_text
from ambinav.runtime.array_types import Floats32
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import write_text
from ambinav.runtime.input_suggestions import kind_of_path, refuse
from ambinav.sensing.beams import Beams
from ambinav.sensing.casting import cast_beams, is_in_space
from ambinav.sensing.intensity import Intensity
from ambinav.sensing.layout import Mounts, Part, Planar, Ring, with_channel
from ambinav.sensing.mounting import CENTRE, TURN, Mount
from ambinav.sensing.presets import PRESETS, preset_names
from ambinav.sensing.scanner_file import parse_scanner, render_scanner
from ambinav.sensing.sensor import RangeSensor
from ambinav.sensing.space_layout import Layers
from ambinav.sensing.symmetry import TOLERANCE, own_centres
from ambinav.sensing.thinning import thinned_parts
from ambinav.sensing.tilting_layout import Tilting

if TYPE_CHECKING:
    from ambinav.geometry.environment import Environment

# One that does so about a centre of its own still does if that is no farther from the robot's,
# metres (docs/model.md, "Where the scanner sits").
OFF_CENTRE = 0.2


@dataclass(frozen=True)
class RangeScanner(Beams):
    """Set of beams, each of a range sensor and mounted somewhere on the robot.

    Build it with `planar`, `ring`, `mixed`, `from_mounts`, `from_preset` or `from_yaml`.

    Attributes:
        parts: The beams, grouped by sensor and layout, in order.
        name: Name in reports.
        description: Description in one line.
        source: Source of its figures.
        robot_radius: Radius of the disc that covers the robot, metres; None: not given.

    Raises:
        InputError: there is no part, one has no sensor, or the radius is not above zero.
    """

    parts: tuple[Part, ...]
    name: str = "scanner"
    description: str = ""
    source: str = ""
    robot_radius: float | None = None

    def __post_init__(self) -> None:
        """Check that there is at least one beam."""
        object.__setattr__(self, "parts", tuple(self.parts))
        if not self.parts:
            raise InputError(f"scanner {self.name!r} has no beams; give it at least one part.")
        for part in self.parts:
            check_kind(part.sensor, RangeSensor, f"scanner {self.name!r}: the sensor")
        radius = self.robot_radius
        if radius is not None and not (math.isfinite(radius) and radius > 0.0):
            raise InputError(
                f"scanner {self.name!r}: robot_radius is {radius:g}; give metres above zero, "
                "e.g. 0.2."
            )

    # -- making one --------------------------------------------------------------------------

    @classmethod
    def planar(
        cls,
        sensor: RangeSensor,
        beams: int,
        aperture: float,
        mount: Mount = CENTRE,
        *,
        z: float = 0.0,
        pitch: float = 0.0,
        roll: float = 0.0,
        name: str = "planar scanner",
    ) -> RangeScanner:
        """Make a planar scanner.

        Args:
            sensor: The sensor of every beam.
            beams: Number of beams.
            aperture: Radians from the first to the last beam; 2 pi is the full circle, where
                beam k looks to yaw - pi + 2 pi k / beams.
            mount: x, y (metres) and yaw (radians) in the robot frame.
            z: Metres above the floor.
            pitch: Radians about y, positive looks down (REP 103).
            roll: Radians about x, applied first.
            name: Name in reports.

        Raises:
            InputError: a number is out of its range.
        """
        return cls((Part(sensor, Planar(beams, aperture, mount, z, pitch, roll)),), name)

    @classmethod
    def layered(
        cls,
        sensor: RangeSensor,
        columns: int,
        elevation: Sequence[float],
        aperture: float = TURN,
        mount: Mount = CENTRE,
        *,
        z: float = 0.0,
        pitch: float = 0.0,
        roll: float = 0.0,
        name: str = "3D scanner",
    ) -> RangeScanner:
        """Make a 3D laser: at each elevation the beams of a planar scanner.

        Args:
            sensor: The sensor of every beam.
            columns: Number of beams of a layer.
            elevation: Elevation of each layer, radians above the horizon.
            aperture: As in `planar`.
            mount: x, y (metres) and yaw (radians) in the robot frame.
            z: Metres above the floor.
            pitch: Radians about y, positive looks down (REP 103).
            roll: Radians about x, applied first.
            name: Name in reports.

        Raises:
            InputError: a number is out of its range.
        """
        layout = Layers(columns, aperture, tuple(elevation), False, mount, z, pitch, roll)
        return cls((Part(sensor, layout),), name)

    @classmethod
    def ring(
        cls,
        sensor: RangeSensor,
        count: int,
        radius: float,
        start: float = 0.0,
        *,
        name: str = "ring",
    ) -> RangeScanner:
        """Make a ring of sensors around the robot's centre that face outward.

        Args:
            sensor: The sensor of every beam.
            count: Number of sensors.
            radius: Distance from the centre, metres.
            start: Direction of the first sensor, radians; the rest follow counter-clockwise.
            name: Name in reports.

        Raises:
            InputError: a number is out of its range.
        """
        return cls((Part(sensor, Ring(count, radius, start)),), name)

    @classmethod
    def mixed(cls, *scanners: RangeScanner, name: str = "mixed scanner") -> RangeScanner:
        """Combine several scanners on one robot; their beams keep the given order.

        Raises:
            InputError: there is none, or one is no scanner.
        """
        for scanner in scanners:
            check_kind(scanner, RangeScanner, "a scanner")
        sources = dict.fromkeys(s.source for s in scanners if s.source)
        parts = tuple(part for s in scanners for part in s.parts)
        # One robot carries them all: the largest disc covers it.
        radius = max((s.robot_radius for s in scanners if s.robot_radius is not None), default=None)
        return cls(parts, name, source="; ".join(sources), robot_radius=radius)

    @classmethod
    def from_mounts(
        cls,
        sensors: RangeSensor | Sequence[RangeSensor],
        mounts: ArrayLike,
        sensor_of_beam: ArrayLike | None = None,
        *,
        upright: ArrayLike | None = None,
        name: str = "scanner",
    ) -> RangeScanner:
        """Make a scanner beam by beam.

        Args:
            sensors: The sensor, or several.
            mounts: x, y (metres) and yaw (radians) of each beam, shape (B, 3).
            sensor_of_beam: Index into `sensors` of each beam, shape (B,); None: all the first.
            upright: z (metres) and elevation (radians) of each beam, shape (B, 2); None: all 0.
            name: Name in reports.

        Returns:
            A scanner with the beams in this order. Its `sensors` are the distinct ones, in the
            order of their first beam.

        Raises:
            InputError: the shapes do not fit, or an index names no sensor.
        """
        models = (sensors,) if isinstance(sensors, RangeSensor) else tuple(sensors)
        table = as_array(mounts, "mounts", "(beams, 3): x, y, yaw")
        if table.ndim != 2 or table.shape[1] != 3:
            raise InputError(f"mounts have the shape {table.shape}; give (beams, 3): x, y, yaw.")
        index = np.zeros(len(table), dtype=np.intp)
        if sensor_of_beam is not None:
            index = np.asarray(sensor_of_beam, dtype=np.intp)
        if index.shape != (len(table),) or not np.isin(index, np.arange(len(models))).all():
            raise InputError(
                f"sensor_of_beam has the shape {index.shape}; give one index from 0 to "
                f"{len(models) - 1} for each of the {len(table)} mounts."
            )
        up = np.zeros((len(table), 2)) if upright is None else np.asarray(upright, np.float64)
        if up.shape != (len(table), 2):
            raise InputError(
                f"upright has the shape {up.shape}; give z and elevation of each of the "
                f"{len(table)} mounts."
            )
        runs = (list(run) for _, run in groupby(range(len(table)), key=index.__getitem__))
        parts = tuple(Part(models[index[run[0]]], Mounts.of(table[run], up[run])) for run in runs)
        return cls(parts, name)

    @classmethod
    def from_preset(cls, name: str) -> RangeScanner:
        """Load a preset of ambinav or of a plug-in (see `preset_names`).

        Raises:
            InputError: there is no such preset, and the nearest names are offered; or that of a
                plug-in cannot be used.
        """
        preset = PRESETS.get(name)
        file = preset.origin or PRESETS.calling(name).whose
        return cls.from_yaml_text(preset.yaml, file=file, default_name=name)

    @classmethod
    def from_yaml(cls, path: str | Path) -> RangeScanner:
        """Read a scanner file (the format is in `scanner_file`).

        Raises:
            InputError: the file or a field cannot be used.
        """
        path = Path(path)
        return cls.from_yaml_text(read_text(path), file=str(path), default_name=path.stem)

    @classmethod
    def from_yaml_text(
        cls, text: str, *, file: str = "scanner YAML", default_name: str = "scanner"
    ) -> RangeScanner:
        """Read a scanner from YAML text, as `to_yaml` gives it; `file` names it in messages."""
        parsed = parse_scanner(text, file, default_name)
        return cls(
            parsed.parts, parsed.name, parsed.description, parsed.source, parsed.robot_radius
        )

    @classmethod
    def load(cls, preset_or_path: str | Path) -> RangeScanner:
        """Load a preset by its name, or else a scanner file.

        Raises:
            InputError: it is neither, or the file cannot be used.
        """
        text, path = str(preset_or_path), Path(preset_or_path)
        if text in preset_names():
            return cls.from_preset(text)
        refuse(text, kind_of_path(path), "a scanner")
        if path.exists() or path.suffix.lower() in (".yaml", ".yml") or len(path.parts) > 1:
            return cls.from_yaml(path)
        return cls.from_preset(text)

    def to_yaml(self, path: str | Path | None = None) -> str:
        """Return the scanner as YAML text, and write it to `path` if one is given.

        Reading it back gives an equal scanner; an angle that no number of degrees stands for
        exactly comes back within 1e-15 of itself.
        """
        text = render_scanner(
            self.name, self.description, self.source, self.parts, self.robot_radius
        )
        if path is not None:
            write_text(Path(path), text)
        return text

    # -- its beams ---------------------------------------------------------------------------

    def raised(self, height: float) -> RangeScanner:
        """Return the same scanner, raised by a height, metres.

        Raises:
            InputError: the height is not a finite number.
        """
        height = as_number(height, "height")
        parts = tuple(Part(part.sensor, part.layout.moved(0.0, 0.0, height)) for part in self.parts)
        return replace(self, parts=parts)

    def with_intensity(self, intensity: Intensity | None) -> RangeScanner:
        """Return the scanner with this channel, or none, on its lasers.

        Raises:
            InputError: it has no laser.
        """
        return replace(self, parts=with_channel(self.parts, intensity, self.name))

    @property
    def aperture(self) -> float:
        """Angle of the beams' axes in radians: a turn less the widest gap between them.

        A cone sensor sees farther to both sides: `ambinav.sensing.preset_summary.field_of_view`.

        Where the scanner looks all around, or a part of it spans the circle, it is 2 pi.
        """
        fans = (
            part.layout for part in self.parts if isinstance(part.layout, Planar | Layers | Tilting)
        )
        if self.looks_all_around or any(fan.full_circle and len(fan.mounts()) > 1 for fan in fans):
            return TURN
        yaw = np.sort(self.mounts[:, 2] % TURN)
        return TURN - float(np.diff(yaw, append=yaw[0] + TURN).max())

    @cached_property
    def centred(self) -> RangeScanner:
        """Scanner that a map without headings is made for.

        Where the beams of each sensor sit about a centre of their own, at most `OFF_CENTRE` from
        the robot's, and look all around once these centres are moved to the robot's, that moved
        scanner; else this one. Its map gives the ambiguity at the position of the scanner:
        what it says of a pose of the robot holds no farther from there than the scanner sits off.
        """
        off = own_centres(self.mounts, self.sensor_of_beam)
        apart = float(np.hypot(*off.T).max())
        if apart < TOLERANCE or apart > OFF_CENTRE + TOLERANCE:
            return self
        off[np.hypot(*off.T) < TOLERANCE] = 0.0
        parts = tuple(
            Part(part.sensor, part.layout.moved(*(-off[self.sensors.index(part.sensor)]).tolist()))
            for part in self.parts
        )
        moved = replace(self, parts=parts)
        return moved if moved.turns_in_place else self

    @property
    def looks_all_around(self) -> bool:
        """True if a turn by some angle of at most 30 degrees gives the same beams again.

        Then ambiguity does not depend on the heading beyond the spacing of the beams. The turn is
        about the scanner's own centre, where that is within `OFF_CENTRE` of the robot's
        (`centred`): `turns_in_place` tells whether it is the robot's very own.
        """
        return self.centred.turns_in_place

    def thinned(self, max_beams: int) -> RangeScanner:
        """Return a scanner with an evenly chosen subset of at most `max_beams` beams.

        Each part gets an equal share, and what a small part leaves over goes to the others, so a
        few sonars stay beside a thinned laser. A full circle stays evenly spaced, a partial fan
        symmetric (see `Planar.thinned`).

        Raises:
            InputError: `max_beams` is below the number of parts.
        """
        max_beams = as_count(max_beams, "max_beams")
        if self.beams <= max_beams:
            return self
        if max_beams < len(self.parts):
            raise InputError(
                f"max_beams is {max_beams}; scanner {self.name!r} has {len(self.parts)} parts and "
                "each keeps at least one beam."
            )
        thinned = replace(self, parts=thinned_parts(self.parts, max_beams))
        return replace(thinned, name=f"{self.name} ({thinned.beams} of {self.beams} beams)")

    # -- using it ----------------------------------------------------------------------------

    def scan(self, env: Environment, x: ArrayLike, y: ArrayLike, theta: ArrayLike) -> Floats32:
        """Return the true range of each beam at each pose.

        Args:
            env: The building, in the plane or in space (`Environment.space`). The frontier
                to unknown space stops a beam as a wall does.
            x: Metres in the map frame; x, y and theta broadcast.
            y: Metres in the map frame.
            theta: Heading in radians.

        Returns:
            float32, shape (broadcast shape, B), metres from the sensor; inf where nothing
            returns an echo within the sensor's maximum range, nan where the sensor is outside
            the free space. A cone's range is the smallest over its rays that return one.

        Raises:
            InputError: a pose is not finite, or the building and the scanner do not go together
                (`casting.scans.check_rays`).
        """
        return cast_beams(env, self.rays(is_in_space(env)), self.max_range, x, y, theta)

    def read(
        self,
        env: Environment,
        x: ArrayLike,
        y: ArrayLike,
        theta: ArrayLike,
        rng: np.random.Generator,
    ) -> Floats32:
        """Return simulated readings at each pose: `scan`, then calibration, noise, resolution.

        Same arguments and shape as `scan`; too near is -inf, no echo inf (REP 117).

        Raises:
            InputError: a pose is not finite, or puts a sensor outside the free space.
        """
        ranges = self.scan(env, x, y, theta)
        outside = np.isnan(ranges).any(axis=-1)
        if outside.any():
            px, py = (np.broadcast_to(v, outside.shape)[outside].flat[0] for v in (x, y))
            raise InputError(
                f"pose: at x = {px:g}, y = {py:g} a sensor of scanner {self.name!r} is outside the "
                "free space; keep the robot clear of walls."
            )
        return self.capture(ranges, rng)

    def capture(self, true_ranges: ArrayLike, rng: np.random.Generator) -> Floats32:
        """Return one simulated reading of each true range, shape (..., B) as `scan` gives them.

        Raises:
            InputError: the last axis is not B long, a true range is NaN or negative, or `rng` is
                no Generator.
        """
        check_generator(rng)
        ranges = np.asarray(true_ranges)
        if ranges.shape[-1:] != (self.beams,):
            raise InputError(
                f"true ranges have the shape {ranges.shape}; the last axis must be the "
                f"{self.beams} beams of scanner {self.name!r}."
            )
        readings = np.empty(ranges.shape, dtype=np.float32)
        for i, sensor in enumerate(self.sensors):
            beams = self.sensor_of_beam == i
            readings[..., beams] = sensor.read(ranges[..., beams], rng)
        return readings
