"""What all commands share: progress without a terminal, completion for shells, option groups."""

from __future__ import annotations

import pytest
import typer
from typer.testing import CliRunner

from ambinav.cli import app, running


def test_progress_without_a_terminal_is_a_line_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = 100.0
    monkeypatch.setattr(running.time, "monotonic", lambda: now)
    with running.progress_bars(quiet=False) as bars:
        report = bars("ambiguity")
        for step in range(1, 51):
            now = 100.0 + step
            report(step / 50)
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        "ambinav: ambiguity: 40 % in 20 s, about 30 s left",
        "ambinav: ambiguity: 80 % in 40 s, about 10 s left",
    ]
    with running.progress_bars(quiet=True) as bars:
        report = bars("ambiguity")
        now = 1000.0
        report(0.5)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("threads", ["0", "-2", "x"])
def test_a_number_of_threads_that_numba_refuses(
    threads: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
    result = CliRunner().invoke(app, ["plugins"])
    assert result.exit_code == 2
    assert f"NUMBA_NUM_THREADS is {threads!r} in the environment" in result.stderr


@pytest.mark.parametrize(
    ("begun", "offered"),
    [
        ("ambinav pl", "plan"),
        ("ambinav audit --scanner hokuyo-urg", "hokuyo-urg-04lx"),
        ("ambinav plan --planner bel", "belief-roadmap"),
        ("ambinav plan --start-", "--start-heading"),
        ("ambinav plan --localizer am", "amcl"),
        ("ambinav plan --odometry po", "poor"),
        ("ambinav export --to nav2-k", "nav2-keepout"),
    ],
)
def test_shells_complete(begun: str, offered: str) -> None:
    words = {"COMP_WORDS": begun, "COMP_CWORD": str(begun.count(" "))}
    result = CliRunner().invoke(
        app, [], env={"_AMBINAV_COMPLETE": "complete_bash", **words}, prog_name="ambinav"
    )
    assert offered in result.stdout.split()


def test_help_says_how_to_set_completion_up() -> None:
    text = CliRunner().invoke(app, ["--help"]).stdout
    assert "--install-completion" in text and "--show-completion" in text


# Which name a file by its ending, and a planner with its weight; places, of `plan` in space too.
BESIDES = ("--output", "--planner", "--start", "--goal")


def test_an_option_has_one_meaning_in_all_commands() -> None:
    meanings: dict[str, set[tuple[str | None, int]]] = {}
    for command in typer.main.get_command(app).commands.values():  # type: ignore[attr-defined]
        for option in command.params:
            if option.param_type_name == "option" and option.opts[0] not in BESIDES:
                meanings.setdefault(option.opts[0], set()).add((option.metavar, option.nargs))
    assert {"--robot-radius", "--start-heading", "--headings"} < set(meanings)
    assert {name: each for name, each in meanings.items() if len(each) > 1} == {}
