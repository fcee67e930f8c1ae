"""A page for each id of `ambinav_envs.registration.IDS`, from the registry and the docstring."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import gymnasium as gym
from PIL import Image
from site_links import GENERATED, write

from ambinav_envs.buildings.suites import suite
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.registration import IDS
from ambinav_envs.tasks import HARD_TASKS, TWIN_ROOMS

PAGES = GENERATED / "environments"
ANY_MAP = "any map, or any suite of drawn buildings"
ABOUT = {spec.name: spec.about for spec in (*HARD_TASKS, *TWIN_ROOMS)}
DIFFERS = {
    "TruePose": "without localization error",
    "NoMap": "without the ambiguity map in view",
    "Belief": "with the robot's own belief",
}
"""What is different in ids beside another."""


def write_pages() -> None:
    """Write the pages of all ids, their list, and the page of what they have in common."""
    names = [_page(name, dict(arguments)) for name, arguments in IDS.items()]
    common = inspect.cleandoc(NavigationEnv.__doc__ or "")
    write(PAGES / "common.md", f"# What all environments have in common\n\n{common}\n")
    rows = [
        f"| [`{name}`]({_file(name)}) | {_title(name, arguments)} |"
        for name, arguments in IDS.items()
    ]
    lines = ["# Environments, one by one", "", "| id | buildings |", "|---|---|", *rows, ""]
    lines += ["```{toctree}", ":titlesonly:", "", "common", *names, "```", ""]
    write(PAGES / "index.md", "\n".join(lines))
    for path in PAGES.glob("*.md"):
        if path.stem not in (*names, "common", "index"):
            path.unlink()  # of an id that is no more


def _file(name: str) -> str:
    return f"{name.rpartition('/')[2].lower()}.md"


def _title(name: str, arguments: dict[str, Any]) -> str:
    """The buildings of an id, and how it differs from the one that it stands beside."""
    differs = [text for kind, text in DIFFERS.items() if f"-{kind}-" in name]
    return ", ".join([_buildings(arguments), *differs])


def _buildings(arguments: dict[str, Any]) -> str:
    return suite(arguments["suite"]).title if "suite" in arguments else ANY_MAP


def _page(name: str, arguments: dict[str, Any]) -> str:
    """Write the page of an id; returns its name for the list."""
    chosen = {} if "suite" in arguments else {"suite": "office"}
    env = gym.make(name, render_mode="rgb_array", **{"buildings": 1, **chosen})
    picture = PAGES / f"{Path(_file(name)).stem}.png"
    if not picture.is_file():
        picture.parent.mkdir(parents=True, exist_ok=True)
        env.reset(seed=1)
        Image.fromarray(env.render()).save(picture)  # type: ignore[arg-type]
    seen = [f"| `{key}` | `{space}` |" for key, space in env.observation_space.spaces.items()]
    call = "".join(f", {key}={value!r}" for key, value in chosen.items())
    lines = [
        f"# {name}",
        "",
        f"{_title(name, arguments).capitalize()}.",
        "",
        *((ABOUT[name], "") if name in ABOUT else ()),
        f"![{name}: the robot, its estimate, its beams and the goal on the map]({picture.name})",
        "",
        "```python",
        "import gymnasium as gym",
        "import ambinav_envs  # registers the ids",
        "",
        f'one = gym.make("{name}"{call})',
        f'many = gym.make_vec("{name}", 64, vectorization_mode="vector_entry_point"{call})',
        "```",
        "",
        "## Spaces",
        "",
        "| part | space |",
        "|---|---|",
        f"| action | `{env.action_space}` |",
        *seen,
        "",
        "What each number of them is, the reward, how an episode begins and ends, and all "
        "arguments are [the same for all ids](common.md).",
        "",
        "## Arguments of this id",
        "",
        *(
            ["| argument | value |", "|---|---|"]
            + [f"| `{k}` | `{v!r}` |" for k, v in arguments.items()]
            if arguments
            else ["None."]
        ),
        *([] if "suite" in arguments else ["", "Give `map=` or `suite=` besides."]),
        "",
    ]
    if "suite" in arguments and "buildings" not in arguments:
        lines += [
            "Without `buildings=` every episode has a new building, whose map is computed first.",
            "",
        ]
    env.close()
    write(PAGES / _file(name), "\n".join(lines))
    return picture.stem
