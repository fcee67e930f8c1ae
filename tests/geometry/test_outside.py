"""What lies outside of the free space of a drawn plan."""

from __future__ import annotations

import numpy as np
import shapely
import shapely.affinity

from ambinav.geometry.lattice import Lattice
from ambinav.geometry.outside import solid_cells
from tests.geometry import scenes


def test_notches_of_an_outline_are_solid_whatever_their_mitres() -> None:
    """A square of 4 m with notches along its rim, one of which has a mitre without a tip."""
    env = scenes.scene(18, size=4.0, blocks=9, thin=4).transformed(0.1234, 0.017, 0.023)
    lattice = Lattice.over(env, 0.1)
    turned = shapely.affinity.rotate(shapely.box(0, 0, 4, 4), 0.1234, (0, 0), use_radians=True)
    square = shapely.affinity.translate(turned, 0.017, 0.023)
    x, y = np.meshgrid(lattice.x, lattice.y)
    expected = shapely.contains_xy(square, x, y) & ~lattice.free
    assert expected.any()
    np.testing.assert_array_equal(solid_cells(lattice), expected)
