"""Parts common to all commands: exit status, notes, progress, JSON."""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import typer

from ambinav.runtime.errors import InputError, InputWarning
from ambinav.runtime.progress import Progress, Stages

if TYPE_CHECKING:
    from ambinav.studies.study import Study

BAD_INPUT = 2
OUR_FAULT = 1
INTERRUPTED = 130


LINE_SECONDS = 20.0
"""Seconds between two lines of progress where there is no terminal."""
ESTIMATED_FROM = 0.3
"""Fraction from which the remaining time is estimated: at first kernels may have to be compiled."""


@contextlib.contextmanager
def reporting() -> Iterator[None]:
    """Convert an exception of a command into a sentence on stderr and an exit status.

    `InputError` gives 2, Ctrl-C 130, anything unforeseen 1 with its traceback. An `InputWarning`
    becomes a note on stderr, each only once.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", InputWarning)
        warnings.showwarning = _Notes()
        try:
            _check_threads()
            yield
        except InputError as error:
            say(f"ambinav: error: {error}")
            raise typer.Exit(BAD_INPUT) from None
        except KeyboardInterrupt:
            say("ambinav: interrupted, nothing was written.")
            raise typer.Exit(INTERRUPTED) from None
        except (typer.Exit, typer.Abort):
            raise
        except BrokenPipeError:
            # The reader of our output has closed it.
            raise typer.Exit(OUR_FAULT) from None
        except Exception as error:
            traceback.print_exc()
            say(f"ambinav: internal error, please report it: {type(error).__name__}: {error}")
            raise typer.Exit(OUR_FAULT) from None


def _check_threads() -> None:
    """Check the number of threads in the environment; numba's own error would be unclear."""
    threads = os.environ.get("NUMBA_NUM_THREADS")
    if threads is not None and not (threads.isdecimal() and int(threads) > 0):
        raise InputError(
            f"NUMBA_NUM_THREADS is {threads!r} in the environment; give a whole number above zero, "
            "or unset it."
        )


@contextlib.contextmanager
def resumable(work: Path | str, kept_text: str) -> Iterator[None]:
    """Print on interruption that the command can resume, and from which file or folder."""
    try:
        yield
    except KeyboardInterrupt:
        say(
            f"ambinav: interrupted; {kept_text} in {work}, and the same command resumes from there."
        )
        raise typer.Exit(INTERRUPTED) from None


class _Notes:
    """Printer of input warnings; each is printed once."""

    def __init__(self) -> None:
        self.printed: set[str] = set()

    def __call__(
        self,
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        if str(message) not in self.printed:
            self.printed.add(str(message))
            say(f"ambinav: note: {message}")


@contextlib.contextmanager
def progress_bars(quiet: bool) -> Iterator[Stages]:
    """Yield a function that starts a progress bar: text in, callback for the share done out.

    Bars are drawn on stderr; where that is no terminal, a line is printed there now and then.
    """
    if quiet:
        yield lambda text: lambda fraction: None
        return
    if not sys.stderr.isatty():
        yield _ProgressLines
        return
    from rich import progress
    from rich.console import Console

    from ambinav.runtime.compiling import announce

    announce()
    columns = (
        progress.TextColumn("{task.description}"),
        progress.BarColumn(),
        progress.TaskProgressColumn(),
        progress.TimeElapsedColumn(),
        progress.TextColumn("left"),
        progress.TimeRemainingColumn(),
    )
    with progress.Progress(*columns, console=Console(stderr=True)) as bars:

        def start(text: str) -> Progress:
            task = bars.add_task(text, total=1.0)
            return lambda fraction: bars.update(task, completed=fraction)

        yield start


@contextlib.contextmanager
def one_bar(quiet: bool, stages: Mapping[str, float]) -> Iterator[Stages]:
    """Yield a function that starts a stage of one progress bar.

    Given the stage's name, it returns a callback that takes its completed fraction; stages may
    overlap.

    Args:
        quiet: Print nothing.
        stages: Approximate duration of each, seconds, in order.
    """
    total = max(sum(stages.values()), 1e-9)
    stage_done = dict.fromkeys(stages, 0.0)
    with progress_bars(quiet) as bars:
        full_bar = bars(" and ".join([", ".join(list(stages)[:-1]), list(stages)[-1]]))

        def start(name: str) -> Progress:
            def report(fraction: float) -> None:
                stage_done[name] = fraction * stages[name]
                full_bar(sum(stage_done.values()) / total)

            return report

        yield start
        full_bar(1.0)


class _ProgressLines:
    """Printer of progress, at most one line in `LINE_SECONDS`."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._started = self._last = time.monotonic()

    def __call__(self, fraction: float) -> None:
        now = time.monotonic()
        if now - self._last >= LINE_SECONDS:
            self._last = now
            elapsed = now - self._started
            estimate = f", about {elapsed * (1.0 / fraction - 1.0):.0f} s left"
            estimate = estimate if fraction >= ESTIMATED_FROM else ""
            say(f"ambinav: {self._text}: {100 * fraction:.0f} % in {elapsed:.0f} s{estimate}")


def check_writable(output: Path) -> None:
    """Check, before the long work, that `output` can be made; leave nothing behind.

    Raises:
        InputError: the nearest folder that exists is not a folder, or nothing can be made in it; or
            the output lies in a map, which is replaced as a whole.
    """
    for folder in output.absolute().parents:
        if folder.suffix == ".zarr" and folder.is_dir():
            raise InputError(f"{output}: this is inside of the map {folder}; give another folder.")
    place = output.absolute().parent
    while not place.exists():
        place = place.parent
    if not place.is_dir():
        raise InputError(f"{output}: {place} is a file, not a folder; choose another output.")
    try:
        # Only an attempt tells: for root every folder reports that it is writable.
        Path(tempfile.mkdtemp(prefix=".ambinav-", dir=place)).rmdir()
    except OSError as error:
        raise InputError(
            f"{output}: nothing can be written in the folder {place} ({error.strerror}); "
            "choose another output."
        ) from error


def check_map_output(place: str) -> None:
    """Check, before the long work, that a map can be written to a folder or a URL.

    Raises:
        InputError: see `check_writable` and `ambinav.maps.store.check_target`.
    """
    from ambinav.maps.address import Address
    from ambinav.maps.store import check_target

    address = Address.of(place)
    if address.folder is not None:
        check_writable(address.folder)
    check_target(address)


def check_file(output: Path) -> None:
    """Check, before the long work, that `output` can be written as a file.

    Raises:
        InputError: it is a folder, or see `check_writable`.
    """
    if output.is_dir():
        raise InputError(f"{output}: this is a folder; name a file to write.")
    check_writable(output)


def check_apart(output: Path, *inputs: str | Path | None) -> None:
    """Check that a command does not overwrite its own input.

    Raises:
        InputError: an input is the same file.
    """
    for read in inputs:
        if read is not None and Path(read).exists() and output.resolve() == Path(read).resolve():
            raise InputError(f"--output: {output} is also the input; name another file.")


def check_report(study: Study, output: Path | None, image_format: str) -> None:
    """Check, before the long work, that a report can be written.

    Args:
        study: What is to be written.
        output: The report's folder; None: it is only printed.
        image_format: The value of --pictures.

    Raises:
        InputError: there is no such format, or see `check_writable` and `RunFolder.check`.
    """
    from ambinav.plotting.style import FORMATS

    if image_format not in FORMATS:
        raise InputError(
            f"--pictures: {image_format!r} is not a picture format; give {' or '.join(FORMATS)}."
        )
    if output is not None:
        check_writable(output)
        study.folder.check(output)


def note(text: str) -> None:
    """Print a note on stderr, as `reporting` does with warnings."""
    say(f"ambinav: note: {text}")


def say(text: str) -> None:
    """Print a line on stderr."""
    print(text, file=sys.stderr, flush=True)
