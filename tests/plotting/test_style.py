"""The table of colours: what must stay apart does, for whoever sees it and in grey print."""

from __future__ import annotations

import subprocess
import sys
from itertools import combinations

import numpy as np
import pytest

from ambinav.plotting import style
from ambinav.plotting.style import ROUTE_COLOURS, ZONE_COLOURS, route_style

# Linear RGB as seen with no cones of one kind: Machado, Oliveira and Fernandes (2009), severity 1.
SEEN = {
    "all": np.eye(3),
    "protan": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deutan": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritan": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def linear(colour: str) -> np.ndarray:
    part = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    return np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)


def lab(colour: str, seen: str = "all") -> np.ndarray:
    """CIELAB of a colour, D65."""
    xyz = XYZ @ np.clip(np.asarray(SEEN[seen]) @ linear(colour), 0.0, 1.0)
    t = xyz / XYZ.sum(axis=1)
    f = np.where(t > 0.008856, np.cbrt(t), 7.787 * t + 16.0 / 116.0)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


def apart(a: str, b: str) -> float:
    """Least difference (CIE 1976) of two colours, whoever sees them; 2.3 is just noticed."""
    return min(float(np.linalg.norm(lab(a, seen) - lab(b, seen))) for seen in SEEN)


def contrast(a: str, b: str) -> float:
    """Contrast ratio of WCAG 2."""
    low, high = sorted(float(linear(colour) @ XYZ[1]) for colour in (a, b))
    return (high + 0.05) / (low + 0.05)


def test_zones_and_greys_stay_apart():
    floor = (*ZONE_COLOURS, style.UNKNOWN, style.UNREACHABLE, style.SOLID)
    assert min(apart(a, b) for a, b in combinations(floor, 2)) > 10.0


def test_states_of_navigation_and_greys_stay_apart():
    floor = (*style.NAVIGATION, style.UNKNOWN, style.UNREACHABLE, style.SOLID)
    assert min(apart(a, b) for a, b in combinations(floor, 2)) > 10.0
    grey = [lab(colour)[0] for colour in style.NAVIGATION]
    assert max(np.diff(grey)) < -10.0


def test_transition_is_not_paper_white():
    assert apart(ZONE_COLOURS[1], "#FFFFFF") > 10.0


def test_zones_stay_apart_in_grey():
    grey = sorted(lab(colour)[0] for colour in ZONE_COLOURS)
    assert min(np.diff(grey)) > 10.0


def styles() -> dict[str, style.RouteStyle]:
    """The first two routes of each kind."""
    return {f"{kind} {k}": route_style(kind, k) for kind in ROUTE_COLOURS for k in (0, 1)}


@pytest.mark.parametrize("name", styles())
def test_every_route_stands_out_on_every_zone(name):
    # At least 3 to 1 (WCAG 2.2, 1.4.11), which no kind of colour blindness takes away: between
    # the line and its casing, and between the zone and one of the two.
    look = styles()[name]
    assert contrast(look.colour, look.casing) >= 3.0
    for zone in ZONE_COLOURS:
        assert max(contrast(look.colour, zone), contrast(look.casing, zone)) >= 3.0


def test_kinds_of_routes_are_distinguished():
    for a, b in combinations(ROUTE_COLOURS, 2):
        first, second = route_style(a), route_style(b)
        same_pattern = first.dashes == second.dashes
        assert apart(first.colour, second.colour) > (20.0 if same_pattern else 10.0), (a, b)


def test_routes_of_a_kind_differ_in_pattern_or_lightness():
    for kind, colours in ROUTE_COLOURS.items():
        looks = [route_style(kind, k) for k in range(4 * len(colours))]
        assert len(set(looks)) == len(looks)


def test_no_drawing_library_is_needed():
    code = (
        "import sys, ambinav.plotting.style, ambinav.maps.zones; print('matplotlib' in sys.modules)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "False"


@pytest.mark.slow
def test_maps_do_not_import_plots():
    code = (
        "import sys, ambinav.maps.ambiguity_map, ambinav.maps.judged_floor; "
        "print('ambinav.plotting' in sys.modules)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "False"
