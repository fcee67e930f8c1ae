"""Mean intensity that each beam reads: columns beside its range (`Returns`)."""

from __future__ import annotations

from ambinav.runtime.kernels import kernel


@kernel
def intensity_returns(
    begin, end, distance, segment, incidence, which, reflects, frontier, start, max_incidence, beam,
    surface, limit, first, column, blind, data,
):  # fmt: skip
    """Write the intensity columns of poses `begin` to `end`.

    Args:
        begin: First pose.
        end: One past the last pose.
        distance: Distance of the rays that were cast, shape (N, R), metres.
        segment: What they meet, shape (N, R), -1 for nothing.
        incidence: Angles to the normals, shape (N, R), radians; of size 0 where any angle echoes.
        which: Ray of each heading and beam, shape (H, R').
        reflects: Whether each segment is a reflector.
        frontier: Whether it is one.
        start: First ray of each beam, shape (B + 1,): of a laser its only one.
        max_incidence: Largest angle of each ray that returns an echo, radians.
        beam: Beam of each intensity column, shape (K,).
        surface: See `BeamTable`, shape (K, 4).
        limit: Maximum range of each column, metres.
        first: Row of the first pose in `data`.
        column: The first of these columns.
        blind: Variance of a beam that tells nothing.
        data: Written, shape (H, first + N, 5, P): see `Returns`.
    """
    for p in range(begin, end):
        for h in range(data.shape[0]):
            for j in range(beam.size):
                b = beam[j]
                ray = which[h, start[b]]
                d, k = distance[p, ray], segment[p, ray]
                wall, reflector, half, nearest = surface[j]
                # What is too near, has no echo or is not known has no intensity either.
                read = k >= 0 and d >= nearest and d < limit[b] and not frontier[k]
                if incidence.size > 0 and incidence[p, ray] > max_incidence[start[b]]:
                    read = False
                to = column + j
                data[h, first + p, 0, to] = reflector if read and reflects[k] else wall
                for row in range(1, 4):
                    data[h, first + p, row, to] = 0.0
                data[h, first + p, 4, to] = half if read else blind
