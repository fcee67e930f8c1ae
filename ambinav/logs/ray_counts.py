"""Kernel that counts the beams passing through and ending in each cell of a grid."""

from __future__ import annotations

import math

import numpy as np

from ambinav.runtime.kernels import kernel


@kernel
def count_rays(poses, angles, ranges, reach, left, low, cell, hits, passes):
    """Add the beams of scans to the counts, by exact traversal (Amanatides and Woo 1987).

    A beam counts once in each cell that its line goes through: as a hit in the cell where it
    ends, as a pass in those before. One that is longer than `reach` passes as far as that and hits
    nothing. Beams that are not finite tell nothing.

    Args:
        poses: (S, 3), poses of the laser.
        angles: (B,), directions of the beams in the laser's frame.
        ranges: (S, B), metres.
        reach: Metres.
        left: x of the outer corner of cell (0, 0).
        low: y of the same corner.
        cell: Edge of a cell, metres. Every beam must lie within the grid.
        hits: (rows, columns), integers, added to.
        passes: (rows, columns), integers, added to.
    """
    for s in range(poses.shape[0]):
        # Lengths are in cells from here on.
        x0 = (poses[s, 0] - left) / cell
        y0 = (poses[s, 1] - low) / cell
        for b in range(angles.shape[0]):
            length = ranges[s, b]
            if not np.isfinite(length):
                continue
            ends = length <= reach
            span = min(length, reach) / cell
            c = math.cos(poses[s, 2] + angles[b])
            n = math.sin(poses[s, 2] + angles[b])
            col, row = int(math.floor(x0)), int(math.floor(y0))
            last_col = int(math.floor(x0 + span * c))
            last_row = int(math.floor(y0 + span * n))
            step_col = 1 if c > 0.0 else -1
            step_row = 1 if n > 0.0 else -1
            # Distance along the beam to the next border, and between two borders.
            per_col = 1.0 / abs(c) if c != 0.0 else np.inf
            per_row = 1.0 / abs(n) if n != 0.0 else np.inf
            edge_col = col + 1 - x0 if c > 0.0 else x0 - col
            edge_row = row + 1 - y0 if n > 0.0 else y0 - row
            next_col = edge_col * per_col if c != 0.0 else np.inf
            next_row = edge_row * per_row if n != 0.0 else np.inf
            # The number of borders between the two cells is known, so rounding ends nothing early.
            left_col = abs(last_col - col)
            left_row = abs(last_row - row)
            while left_col + left_row > 0:
                passes[row, col] += 1
                if left_row == 0 or (left_col > 0 and next_col < next_row):
                    col += step_col
                    next_col += per_col
                    left_col -= 1
                else:
                    row += step_row
                    next_row += per_row
                    left_row -= 1
            if ends:
                hits[row, col] += 1
            else:
                passes[row, col] += 1
