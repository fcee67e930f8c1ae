"""Localizer that is another program, in whatever language: it is sent scans and answers poses.

    localizer: {type: program, command: [python3, my_filter.py]}

Each message is one line of JSON on the program's standard input, and each is answered by one on its
standard output; metres and radians, map frame. The first tells what there is to know:

    {"map": "/tmp/.../map.yaml", "runs": 16, "seed": 7, "beams": [[x, y, yaw], ...],
     "range_min": [...], "range_max": [...], "range_std": [...], "odometry": {"alpha1": ...}}

`map` is a file of map_server (YAML, with a PGM beside it), `beams` are in the robot frame, and
`odometry` are AMCL's alphas for updates every 0.25 m or 0.2 rad (`OdometryNoise`). R robots are
localized side by side; `start` begins with them, and may come again, `odometry` is a scan of each,
with the odometry's poses in their own frame:

    {"start": [[x, y, theta], ...], "covariance": [[...], [...], [...]]}
    {"odometry": [[x, y, theta], ...], "ranges": [[...], ...]}

Of ranges null is no reading, a number above `range_max` no echo, and one below `range_min` too
near. The answer to `odometry` has estimates of that moment, and may say whose scan was taken in:

    {"pose": [[x, y, theta], ...], "covariance": [[[...], [...], [...]], ...], "used": [true, ...]}

Answers to the other two may be empty, `{}`. At the end its standard input is closed.
"""

from __future__ import annotations

import json
import os
import select
import shlex
import subprocess
import tempfile
import time
import weakref
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Annotated, Any, Final

import numpy as np
from pydantic import BeforeValidator

from ambinav.config import Positive, check_fields, fault
from ambinav.drive.localizer_spec import LocalizerContext, LocalizerSpec
from ambinav.drive.own_localizers import alphas
from ambinav.export.occupancy import TRINARY, occupancy, raster_of, save_map_server
from ambinav.runtime.array_types import Bools, Floats, Floats32
from ambinav.runtime.errors import InputError

CELL: Final = 0.05
"""Edge of a cell of the map of a building that has none of its own, metres."""
GRACE: Final = 2.0
"""Seconds that a program has to end by itself."""
BESIDE: Final = 1.0
"""Metres by which a number for no echo is above the largest range, and one for too near below 0."""
SYMMETRIC: Final = 1e-6
"""Elements of a covariance may be off by this share of the largest one."""


def _words(value: Any) -> tuple[str, ...]:
    if (
        not isinstance(value, list | tuple)
        or not value
        or not all(isinstance(w, str) for w in value)
    ):
        raise fault(value, "give a list of words, such as [python3, my_filter.py]")
    return tuple(value)


@dataclass(frozen=True, kw_only=True)
class ProgramParameters:
    """Parameters of a localizer that is another program.

    Attributes:
        command: The program and its arguments; paths are relative to the working directory.
        seconds: How long it may take to answer.

    Raises:
        InputError: a value makes no sense.
    """

    command: Annotated[tuple[str, ...], BeforeValidator(_words)]
    seconds: Positive = 60.0

    def __post_init__(self) -> None:
        """Check the values."""
        check_fields(self)

    @property
    def files(self) -> tuple[Path, ...]:
        """Words of the command that are files: the program's own."""
        return tuple(path for path in map(Path, self.command) if path.is_file())


class ProgramLocalizer:
    """Estimates of R runs by another program; see the module.

    Raises:
        InputError: the program cannot be started, ends, is too slow, or answers what is none, or
            the building is in space.
    """

    def __init__(self, parameters: ProgramParameters, context: LocalizerContext) -> None:
        if context.environment.space is not None:
            raise InputError(
                "localizers of the type program read flat maps, and the building is in space; "
                "use another localizer."
            )
        self._parameters = parameters
        self._mean = np.zeros((context.runs, 3))
        self._covariance = np.zeros((context.runs, 3, 3))
        self._pending = b""
        sensors = [context.scanner.sensors[k] for k in context.scanner.sensor_of_beam.tolist()]
        self._longest = np.array([sensor.max_range for sensor in sensors]) + BESIDE
        folder = tempfile.TemporaryDirectory(prefix="ambinav-localizer-")
        path = Path(folder.name) / "map.yaml"
        raster = raster_of(context.environment, None, CELL)
        grey = occupancy(context.environment, raster, for_rays=True)
        save_map_server(path, grey, raster, "trinary", **TRINARY)
        self._errors: IO[bytes] = (Path(folder.name) / "stderr").open("w+b")
        try:
            self._process = subprocess.Popen(
                parameters.command, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                stderr=self._errors, bufsize=0,
            )  # fmt: skip
        except OSError as error:
            self._errors.close()
            folder.cleanup()
            raise self._failure(f"cannot be started ({error.strerror})") from error
        weakref.finalize(self, _end, self._process, self._errors, folder)
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._into, self._from = self._process.stdin.fileno(), self._process.stdout.fileno()
        # So that a program that does not read cannot block us.
        os.set_blocking(self._into, False)
        self._ask(
            {
                "map": str(path),
                "runs": context.runs,
                "seed": int(context.rng.integers(2**31)),
                "beams": context.scanner.mounts.tolist(),
                "range_min": [sensor.min_range for sensor in sensors],
                "range_max": [sensor.max_range for sensor in sensors],
                "range_std": [float(sensor.std_at(0.5 * sensor.max_range)) for sensor in sensors],
                "odometry": alphas(context.noise.modelled),
            }
        )

    @property
    def mean(self) -> Floats:
        """Estimated poses of the robots, shape (R, 3)."""
        return self._mean

    @property
    def covariance(self) -> Floats:
        """Covariance of the estimated poses, shape (R, 3, 3)."""
        return self._covariance

    def start(self, poses: Floats, covariance: Floats) -> None:
        """Start at poses, shape (R, 3), with a covariance, shape (3, 3)."""
        self._mean = np.array(poses)
        self._covariance = np.tile(covariance, (len(poses), 1, 1))
        self._ask({"start": poses.tolist(), "covariance": covariance.tolist()})

    def update(self, odometry: Floats, ranges: Floats32) -> Bools:
        """Update with odometry poses, (R, 3), and readings, (R, B); return who took them in."""
        sent = np.where(ranges == np.inf, self._longest, np.maximum(ranges, -BESIDE)).astype(object)
        sent[np.isnan(ranges)] = None
        answer = self._ask({"odometry": odometry.tolist(), "ranges": sent.tolist()})
        self._mean = self._array(answer, "pose", self._mean.shape)
        covariance = self._array(answer, "covariance", self._covariance.shape)
        turned = covariance.transpose(0, 2, 1)
        least = SYMMETRIC * np.abs(covariance).max(axis=(1, 2), initial=0.0)
        if (np.abs(covariance - turned).max(axis=(1, 2), initial=0.0) > least).any() or (
            np.linalg.eigvalsh(covariance)[:, 0] < -least
        ).any():
            raise self._failure(
                "answered a covariance that is not symmetric or has a variance below zero; let it "
                "give that of x, y and theta, in m and rad"
            )
        self._covariance = covariance
        if "used" not in answer:
            return np.ones(len(odometry), dtype=np.bool_)
        return self._array(answer, "used", (len(odometry),)).astype(np.bool_)

    def _ask(self, message: Mapping[str, Any]) -> dict[str, Any]:
        """Send a message; return the answer."""
        line = self._exchange(f"{json.dumps(message, allow_nan=False)}\n".encode())
        try:
            answer = json.loads(line)
        except ValueError:
            answer = None
        if not isinstance(answer, dict):
            raise self._failure(f"answered {_short(line)}; let it print one JSON object a message")
        return answer

    def _exchange(self, message: bytes) -> bytes:
        """Write a message; return the next line of the program's standard output."""
        until = time.monotonic() + self._parameters.seconds
        while message or b"\n" not in self._pending:
            writing = [self._into] if message else []
            seconds_left = max(0.0, until - time.monotonic())
            readable, writable, _ = select.select([self._from], writing, [], seconds_left)
            if not readable and not writable:
                raise self._failure(
                    f"did not answer in {self._parameters.seconds:g} s; give it more (seconds), "
                    "or let it flush its output"
                )
            if writable:
                try:
                    message = message[os.write(self._into, message) :]
                except BrokenPipeError:
                    raise self._ended() from None
            if readable:
                part = os.read(self._from, 1 << 20)
                if not part:
                    raise self._ended()
                self._pending += part
        line, _, self._pending = self._pending.partition(b"\n")
        return line

    def _array(self, answer: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> Floats:
        """Return an array of an answer."""
        try:
            array = np.array(answer[name], dtype=np.float64)
        except (KeyError, TypeError, ValueError):
            array = np.empty(0)
        if array.shape != shape or not np.isfinite(array).all():
            size_text = " x ".join(map(str, shape))
            raise self._failure(f"answered no {name} of {size_text} finite numbers; correct it")
        return array

    def _ended(self) -> InputError:
        """Return the error of a program that has ended, with its last words."""
        try:
            status = self._process.wait(GRACE)
        except subprocess.TimeoutExpired:
            return self._failure("closed its output; let it answer each message")
        self._errors.seek(0)
        lines = self._errors.read().strip().splitlines()
        words = f": {_short(lines[-1])}" if lines else ""
        return self._failure(f"ended with status {status}{words}")

    def _failure(self, problem: str) -> InputError:
        return InputError(f"localizer `{shlex.join(self._parameters.command)}` {problem}.")


def _end(
    process: subprocess.Popen[bytes], errors: IO[bytes], folder: tempfile.TemporaryDirectory[str]
) -> None:
    """End the program, by force if it does not by itself."""
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            pipe.close()
    try:
        process.wait(GRACE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    errors.close()
    folder.cleanup()


def _short(line: bytes) -> str:
    """Return a line as text of bounded length."""
    text = line.decode(errors="replace").strip()
    return text if len(text) <= 120 else f"{text[:117]}..."


PROGRAM = LocalizerSpec(
    name="program",
    title="another program",
    make=ProgramLocalizer,
    parameters=ProgramParameters,
    detail=lambda parameters: shlex.join(parameters.command),
    files=lambda parameters: parameters.files,
    runs_command=True,
)
