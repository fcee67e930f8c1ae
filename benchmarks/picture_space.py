"""Zones of an office for a planar laser and for a 3D scanner of the same range, as one figure.

    AMBINAV_DATA=... python benchmarks/picture_space.py

The ground floor of `plans/institute.ifc` of the recorded data, in three dimensions. Both scanners
have the range and the noise of a TurtleBot3's laser, so that only where they look differs: 60 beams
level, 0.3 m up, or the pattern of a Livox Mid-360, which looks up to lintels and ceilings.
"""

from __future__ import annotations

from harness import ROOT, environment_path
from lasers import laser

from ambinav.buildings.load import load_environment
from ambinav.map_building.build import build_map
from ambinav.plotting.canvas import new_figure, save_figure
from ambinav.plotting.maps import plot_zones
from ambinav.sensing import RangeScanner, RangeSensor
from ambinav.sensing.layout import Part

PICTURE = ROOT / "docs" / "images" / "office-in-space.png"


def main() -> None:
    """Map the office twice, and draw the maps one above the other."""
    office = load_environment(environment_path("institute"), level=1, in_space=True)
    sensor = RangeSensor(max_range=3.5, std=0.03, resolution=0.001)
    pattern = RangeScanner.from_preset("livox-mid-360").parts[0].layout
    scanners = {
        "Planar laser, 60 beams of 3.5 m": laser(3.5, z=0.3),
        "Mid-360's pattern, 480 beams of 3.5 m": RangeScanner((Part(sensor, pattern),)),
    }
    figure = new_figure(11.0, 10.5)
    for axes, (title, scanner) in zip(figure.subplots(2, 1), scanners.items(), strict=True):
        amap = build_map(office, scanner, spacing=0.1, store=False)
        plot_zones(amap, ax=axes, title=title)
    save_figure(figure, PICTURE)


if __name__ == "__main__":
    main()
