"""Several hypotheses of a particle filter: how they start, and how the robot observes them."""

from __future__ import annotations

import math

from ambinav.localization.bins import bin_of, fill_bins, label_clusters, place_of
from ambinav.localization.mcl_update import begin
from ambinav.localization.odometry import apply_motion, motion_between
from ambinav.runtime.kernels import kernel
from ambinav_envs.observations import CLUSTER
from ambinav_envs.simulation.observe import polar


@kernel
def share_out(rows, starts, model, filters):
    """Share particles that are about the true start among the poses where robots may be.

    Args:
        rows: Which robots.
        starts: See `aliases.hypotheses`, shape (N, H, 4); the first is the true start.
        model: See `filter_state.FilterModel`.
        filters: See `filter_state.FilterState`; written.
    """
    for row in range(rows.size):
        i = rows[row]
        own, particles = starts[i, 0], filters.particles[i]
        h, end = 0, own[3]
        for p in range(model.most):
            while (p + 0.5) / model.most > end and h + 1 < starts.shape[1]:
                h += 1
                end += starts[i, h, 3]
            other = starts[i, h]
            turn = other[2] - own[2]
            co, si = math.cos(turn), math.sin(turn)
            dx, dy = particles[p, 0] - own[0], particles[p, 1] - own[1]
            particles[p, 0] = other[0] + co * dx - si * dy
            particles[p, 1] = other[1] + si * dx + co * dy
            particles[p, 2] = (particles[p, 2] + turn + math.pi) % (2.0 * math.pi) - math.pi
        begin(i, model, filters)


@kernel
def show_clusters(rows, robots, filters, found, late, out):
    """Write the heaviest clusters of particles, see `observations.HYPOTHESES`.

    Args:
        rows: Which robots.
        robots: See `layout.STATE`, shape (N,).
        filters: See `filter_state.FilterState`; its work space is written.
        found: Written: share, x, y and theta of each, heaviest first, shape (N, K, 4), metres and
            radians, map frame; zeros where there are no more.
        late: Those of the latest steps, shape (D + 1, N, K, 4), written: those of step s are at s
            modulo D + 1, and what is observed is D steps old.
        out: Shape (N, 4 K); rows `rows` are written.
    """
    for row in range(rows.size):
        i = rows[row]
        find_clusters(i, robots[i].odometry, filters, found[i])
        step, held = robots[i].steps, len(late)
        for s in range(held if step == 0 else 1):
            late[(step + s) % held, i] = found[i]
        seen, goal = late[(step + 1) % held, i], robots[i].goal
        for k in range(len(seen)):
            share, x, y, theta = seen[k]
            shown = out[:, CLUSTER * k : CLUSTER * (k + 1)]
            shown[i, :] = 0.0
            if share > 0.0:
                shown[i, 0] = share
                polar(x, y, math.cos(theta), math.sin(theta), goal[0], goal[1], shown[:, 1:], i)


@kernel
def find_clusters(i, odometry, filters, found):
    """Find the heaviest clusters of filter i.

    Between two updates they move along with odometry, as the estimate does.

    Args:
        i: Which filter.
        odometry: Its odometry now, shape (3,).
        filters: See `show_clusters`.
        found: See `show_clusters`, shape (K, 4).
    """
    particles, count, keys = filters.particles[i], filters.number[i], filters.keys[i]
    label, cluster, share = filters.label[i], filters.stack[i], filters.sums[i]
    bins = fill_bins(particles, count, keys, filters.entry[i], filters.places[i], filters.found[i])
    clusters = label_clusters(bins, keys, filters.entry[i], label, cluster, filters.headings[i])
    total = 0.0
    for c in range(clusters):
        share[c] = 0.0
    for p in range(count):
        key = bin_of(particles[p, 0], particles[p, 1], particles[p, 2])
        cluster[p] = label[place_of(key, keys)]
        share[cluster[p]] += particles[p, 3]
        total += particles[p, 3]
    anchor = filters.anchor[i]
    rot1, trans, rot2 = motion_between(
        anchor[0], anchor[1], anchor[2], odometry[0], odometry[1], odometry[2]
    )
    for k in range(len(found)):
        found[k, :] = 0.0
        best = 0
        for c in range(clusters):
            if share[c] > share[best]:
                best = c
        if share[best] <= 0.0:
            continue
        x = y = co = si = 0.0
        for p in range(count):
            if cluster[p] == best:
                w = particles[p, 3] / share[best]
                x += w * particles[p, 0]
                y += w * particles[p, 1]
                co += w * math.cos(particles[p, 2])
                si += w * math.sin(particles[p, 2])
        found[k, 0] = share[best] / total
        found[k, 1], found[k, 2], found[k, 3] = apply_motion(
            x, y, math.atan2(si, co), rot1, trans, rot2
        )
        share[best] = 0.0
