"""Observations: the scan, and everything else relative to the delayed estimate."""

from __future__ import annotations

import math

from ambinav.geometry.collision.obstacles import around
from ambinav.runtime.kernels import kernel
from ambinav_envs.buildings.geodesic import LENGTHS, STEPS

# Distances are seen in units of this, metres, and up to so many units.
FAR, MOST_FAR = 10.0, 10.0
# Deviations are seen up to this, metres and radians.
MOST_SPREAD = 2.0


@kernel(forceinline=True)
def observe(walls, layers, goals, far, state, mean, cov, settings, readings, view, i):
    """Write row i of the observation; see `ambinav_envs.spaces`.

    Args:
        walls: See `Walls`.
        layers: See `MapLayers`.
        goals: See `GoalArrays`.
        far: Maximum range of each beam, shape (B,), metres.
        state: The robot's `STATE`.
        mean: The estimate that has reached it, shape (3,).
        cov: Its covariance, shape (3, 3).
        settings: See `SETTINGS`.
        readings: Row i is the robot's, shape (N, B), metres.
        view: See `View`.
        i: Which robot.
    """
    for b in range(far.size):
        # Too near is 0, no echo 1.
        view.scan[i, b] = min(max(readings[i, b] / far[b], 0.0), 1.0)
    x, y, theta = mean[0], mean[1], mean[2]
    co, si = math.cos(theta), math.sin(theta)
    polar(x, y, co, si, state.goal[0], state.goal[1], view.goal, i)
    view.velocity[i, 0] = state.speeds[0] / settings.max_speed
    view.velocity[i, 1] = state.speeds[1] / settings.max_turn_rate
    _uncertainty(cov, co, si, view.uncertainty, i)
    if view.window.shape[1] > 0:
        _window(x, y, theta, co, si, walls, layers, settings, view.window, i)
    view.remaining[i, 0] = max(settings.max_steps - state.steps, 0) / settings.max_steps
    if view.hypotheses.shape[1] > 0:
        # Of a localizer with one hypothesis; `particles` writes those of clusters.
        view.hypotheses[i, :] = 0.0
        view.hypotheses[i, 0] = 1.0
        for k in range(3):
            view.hypotheses[i, 1 + k] = view.goal[i, k]
    if settings.waypoint:
        towards = goals.towards[state.slot]
        wx, wy = ahead(x, y, state.goal, settings.waypoint_distance, towards, goals.frame)
        polar(x, y, co, si, wx, wy, view.waypoint, i)


@kernel(forceinline=True)
def polar(x, y, co, si, goal_x, goal_y, out, i):
    """Write distance and the cosine and sine of a point's bearing; (d, 1, 0) at the point itself.

    It is seen from (x, y) by a robot whose heading has this cosine and sine.
    """
    dx, dy = goal_x - x, goal_y - y
    distance = math.sqrt(dx * dx + dy * dy)
    out[i, 0] = min(distance / FAR, MOST_FAR)
    out[i, 1], out[i, 2] = 1.0, 0.0
    if distance > 0.0:
        out[i, 1] = min(max((co * dx + si * dy) / distance, -1.0), 1.0)
        out[i, 2] = min(max((co * dy - si * dx) / distance, -1.0), 1.0)


@kernel(forceinline=True)
def _uncertainty(cov, co, si, out, i):
    """Write deviations along and across the weak axis, its double angle, that of the heading."""
    mean, half = 0.5 * (cov[0, 0] + cov[1, 1]), 0.5 * (cov[0, 0] - cov[1, 1])
    radius = math.sqrt(half * half + cov[0, 1] * cov[0, 1])
    out[i, 0] = min(math.sqrt(max(mean + radius, 0.0)), MOST_SPREAD)
    out[i, 1] = min(math.sqrt(max(mean - radius, 0.0)), MOST_SPREAD)
    # The axis of the larger one lies at phi with tan 2 phi = P_xy / half; a circle has none.
    out[i, 2] = out[i, 3] = 0.0
    if radius > 0.0:
        c, s = half / radius, cov[0, 1] / radius
        twice_co, twice_si = co * co - si * si, 2.0 * co * si
        out[i, 2] = min(max(c * twice_co + s * twice_si, -1.0), 1.0)
        out[i, 3] = min(max(s * twice_co - c * twice_si, -1.0), 1.0)
    out[i, 4] = min(math.sqrt(max(cov[2, 2], 0.0)), MOST_SPREAD)


@kernel
def _window(x, y, theta, co, si, walls, layers, settings, out, i):
    """Write the ambiguity and the free cells of the map around a pose.

    Cells lie in rows from ahead to behind and in each from left to right. A cell within half its
    edge of a wall, or outside of the free space, is not free and has the ambiguity 1. Without
    `ambiguity_seen` all free cells have the ambiguity 0: the walls tell that, and the map nothing.
    """
    cells, spacing = settings.window_cells, settings.window_spacing
    values, free = layers.level, layers.free
    left_end, low_end, inverse = layers.frame
    heading = 0
    if values.shape[2] > 1:
        turn = theta * values.shape[2] / (2.0 * math.pi)
        heading = int(math.floor(turn + 0.5)) % values.shape[2]
    middle = 0.5 * (cells - 1)
    each = cells * cells
    for r in range(cells):
        forward = (middle - r) * spacing
        for c in range(cells):
            left = (middle - c) * spacing
            px, py = x + co * forward - si * left, y + si * forward + co * left
            k = r * cells + c
            out[i, k], out[i, each + k] = 1.0, 0.0
            room, _ = around(px, py, walls.table, walls.bound)
            if room < 0.5 * spacing:
                continue
            column = int(math.floor((px - left_end) * inverse + 0.5))
            row = int(math.floor((py - low_end) * inverse + 0.5))
            if 0 <= row < free.shape[0] and 0 <= column < free.shape[1]:
                out[i, each + k] = 1.0
                if free[row, column]:
                    out[i, k] = min(max(values[row, column, heading], 0.0), 1.0)
    if not settings.ambiguity_seen:
        for k in range(each):
            out[i, k] = 1.0 - out[i, each + k]


@kernel
def ahead(x, y, goal, distance, towards, frame):
    """Return the point this far along the route from (x, y), or the goal if that is nearer.

    Args:
        x: Metres, map frame.
        y: The same.
        goal: x and y.
        distance: Metres.
        towards: See `CostToGo`, int8, shape (rows, columns).
        frame: See `GoalArrays`.
    """
    low_x, low_y, inverse = frame
    rows, columns = towards.shape
    spacing = 1.0 / inverse
    column = int(math.floor((x - low_x) * inverse + 0.5))
    row = int(math.floor((y - low_y) * inverse + 0.5))
    if not (0 <= row < rows and 0 <= column < columns):
        return goal[0], goal[1]
    left = distance
    while towards[row, column] >= 0:
        k = towards[row, column]
        length = LENGTHS[k] * spacing
        if left < length:
            share = left / length
            px, py = low_x + column * spacing, low_y + row * spacing
            return px - share * STEPS[k, 0] * spacing, py - share * STEPS[k, 1] * spacing
        left -= length
        column, row = column - STEPS[k, 0], row - STEPS[k, 1]
    return goal[0], goal[1]
