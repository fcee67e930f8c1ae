"""Which route keeps a robot localized? Both are driven with a particle filter in the loop."""

import shutil
from pathlib import Path

from ambinav import DEMO_BUILDING, compare_routes, load_scenario

if __name__ == "__main__":  # the drives run in processes of their own, which import this file
    folder = Path("out/05-scenario")  # a scenario names its building relative to itself
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(DEMO_BUILDING, folder)
    shutil.copy(Path(__file__).with_suffix(".yaml"), folder / "scenario.yaml")
    report, rows = compare_routes(load_scenario(folder / "scenario.yaml"), "out/05-compare")
    for row in rows:
        print(f"{row.route}: lost in {row['lost'].value.value:.0%} of the runs")
    print("report: out/05-compare/report.html")
