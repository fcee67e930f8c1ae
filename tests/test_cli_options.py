"""Options of the command line that docstrings describe, some of them fields of dataclasses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import pytest
import typer
from typer.testing import CliRunner

from ambinav.cli import app, robot_options
from ambinav.cli.checks import naming_options
from ambinav.cli.limits import Count, Natural, above_zero, not_negative
from ambinav.cli.options import documented
from ambinav.runtime.errors import InputError
from ambinav_planners.planning import NotFoundError
from ambinav_planners.registry import SPACES


@dataclass(frozen=True, kw_only=True)
class Size:
    """Options on the size.

    Attributes:
        edge_length (M): How long
            an edge is. [default: of the map]
    """

    PANEL: ClassVar[str] = "Size"

    edge_length: float | None = None


@dataclass(frozen=True, kw_only=True)
class Box(Size):
    """Options on a box.

    Attributes:
        open: Leave out the lid.
        label (A|B): What it says (in capitals).
    """

    PANEL: ClassVar[str] = "Box"

    open: bool = False
    label: str = "A"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("--edge", "0,5"), "'0,5' is not a number; leave units and % out"),
        (("--edge", "5%"), "'5%' is not a number"),
        (("--count", "1.5"), "'1.5' is not a whole number; give one, such as 12."),
        (("--at", "1", "2m"), "'2m' is not a number"),
        (("--edge", "1e-3", "--count", "1e3", "--at", "-1", "2"), "0.001 1000 (-1.0, 2.0)"),
    ],
)
def test_numbers(given: tuple[str, ...], said: str) -> None:
    small = typer.Typer()

    @small.command()
    @documented
    def show(edge: float = 1.0, count: int | None = None, at: tuple[float, float] = (0, 0)) -> None:
        """Show numbers."""
        typer.echo(f"{edge} {count} {at}")

    result = CliRunner().invoke(small, given, env={"COLUMNS": "200"})
    assert said in result.output


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("-e", "0"), "--edge: 0 is not above zero; give metres, e.g. 0.1."),
        (("-e", "nan"), "--edge: nan is not above zero; give metres, e.g. 0.1."),
        (("-e", "inf"), "--edge: inf is not finite; give metres, e.g. 0.1."),
        (("-e", "2e9"), "--edge: 2e+09 is too large; give metres, e.g. 0.1."),
        (("--share-of", "-1"), "--share-of: -1 is not zero or above; give a number, e.g. 2."),
        (("--count", "0"), "--count: 0 is too few; give 1 or more."),
        (("--left", "-1"), "--left: -1 is negative; give 0 or more."),
        (("-e", "1e9", "--share-of", "0", "--count", str(10**12)), ""),
    ],
)
def test_limits(given: tuple[str, ...], said: str) -> None:
    small = typer.Typer()

    @small.command()
    @documented
    def show(
        edge: Annotated[float, above_zero("0.1"), typer.Option("--edge", "-e")] = 1.0,
        share_of: Annotated[float | None, not_negative("2", "a number")] = None,
        count: Count = 1,
        left: Natural = 0,
    ) -> None:
        """Show numbers."""

    result = CliRunner().invoke(small, given)
    assert result.exit_code == (2 if said else 0)
    assert result.stderr == (f"ambinav: error: {said}\n" if said else "")


def test_fields_are_options_that_the_docstrings_describe() -> None:
    small = typer.Typer()

    @small.command()
    @documented
    def show(box: Box) -> None:
        """Show a box."""
        typer.echo(box)

    command = typer.main.get_command(small)
    options = {option.name: option for option in command.params if option.name in vars(Box())}
    edge, lid, label = (options[name] for name in ("edge_length", "open", "label"))
    assert (edge.opts, edge.metavar) == (["--edge-length"], "M")
    assert (edge.help, edge.show_default) == ("How long an edge is.", "of the map")
    assert (lid.opts, lid.secondary_opts, lid.help) == (["--open"], [], "Leave out the lid.")
    assert (label.metavar, label.default) == ("A|B", "A")
    assert label.help == "What it says (in capitals)."
    assert {option.rich_help_panel for option in options.values()} == {"Box"}
    result = CliRunner().invoke(small, ["--edge-length", "2", "--open"])
    assert result.stdout.strip() == repr(Box(edge_length=2.0, open=True)).strip()


def test_parameters_are_options_and_arguments_that_the_docstring_describes() -> None:
    small = typer.Typer()

    @small.command()
    @documented
    def show(
        plan: Annotated[str, typer.Argument()],
        count: Annotated[int, typer.Option("--number", "-n", show_default="few")] = 1,
        loud: bool = False,
        said: Annotated[str, typer.Option(help="As it is.")] = "",
    ) -> None:
        """Show plans.

        Example: `show plan`

        Parameters:
            plan (PLAN...): What to show.
            count (N): How
                many.
            loud: Shout. [default: whisper]
        """
        typer.echo(f"{plan} {count} {loud}{said}")

    command = typer.main.get_command(small)
    plan, count, loud, said = command.params[:4]
    assert command.help == "Show plans.\n\nExample: `show plan`"
    assert (plan.metavar, plan.help, plan.required) == ("PLAN...", "What to show.", True)
    assert (count.opts, count.metavar) == (["--number", "-n"], "N")
    assert (count.help, count.show_default) == ("How many.", "few")
    assert (loud.opts, loud.secondary_opts, loud.show_default) == (["--loud"], [], "whisper")
    assert said.help == "As it is."
    assert CliRunner().invoke(small, ["a", "-n", "3", "--loud"]).stdout.strip() == "a 3 True"


def commands(command: Any, name: str) -> Iterator[Any]:
    """All commands below one, with their names as ids."""
    below = getattr(command, "commands", None)
    if below is None:
        yield pytest.param(command, id=name)
        return
    for part, inner in below.items():
        yield from commands(inner, f"{name} {part}".strip())


def test_an_interrupt_before_a_command_reports_by_itself_is_said() -> None:
    def stopped() -> None:
        """Do nothing."""
        raise KeyboardInterrupt

    command = typer.Typer()
    command.command()(documented(stopped))
    result = CliRunner().invoke(command, [])
    assert (result.exit_code, result.stderr) == (130, "ambinav: interrupted.\n")


@pytest.mark.parametrize("command", [*commands(typer.main.get_command(app), "")])
def test_every_option_says_what_it_is_for(command: Any) -> None:
    assert [param.name for param in command.params if not param.help] == []


@pytest.mark.parametrize(
    ("message", "said"),
    [
        ("floor is nan; give a finite number.", "--floor is nan; give a finite number."),
        ("floor: 3 is too high.", "--floor: 3 is too high."),
        ("robot_radius is 0.", "--robot-radius is 0."),
        ("floor.yaml: it has no image.", "floor.yaml: it has no image."),
        ("floor/map.yaml: it has no image.", "floor/map.yaml: it has no image."),
        ("up-and-down.yaml: it has no image.", "up-and-down.yaml: it has no image."),
        ("from (3, 4): in a wall.", "--start: from (3, 4): in a wall."),
        ("via[0] (3, 4) is in a wall.", "--via: stop 1 (3, 4) is in a wall."),
        ("via has 31 stops.", "--via has 31 stops."),
        ("floor[0] is 3.", "floor[0] is 3."),
    ],
)
def test_only_parameters_become_options(message: str, said: str) -> None:
    with (
        pytest.raises(InputError) as caught,
        naming_options(
            "floor",
            "up",
            "robot_radius",
            via=lambda k: f"--via: stop {k + 1}",
            **{"from": "--start: from"},
        ),  # fmt: skip
    ):
        raise InputError(message)
    assert str(caught.value) == said


def test_errors_with_more_than_a_message_keep_it() -> None:
    with pytest.raises(NotFoundError) as caught, naming_options("planner"):
        raise NotFoundError("planner 'fmt' found no path.", 3.0)
    assert (str(caught.value), caught.value.bound) == ("planner 'fmt' found no path.", 3.0)


def test_the_spaces_of_routes() -> None:
    assert (*SPACES, robot_options.FLIGHT) == robot_options.SPACES
