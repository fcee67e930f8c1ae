"""Shortest curves forwards and backwards with a bounded turning radius.

Reeds and Shepp, "Optimal paths for a car that goes both forwards and backwards" (1990), section
8: the formulas (8.1) to (8.11) give the words that begin with a forward left arc; the others are
these, mirrored (left for right), with time flipped (forwards for backwards) or run from the goal
to the start: 48 in all.

With the vectors between the turning circles as length D and angle theta (the paper's R(xi, eta)),
every arc is a sum of theta, the goal's heading and an angle that depends on D alone. Mirroring
turns theta and phi into -theta and -phi, flipping time into pi - theta and -phi, and running from
the goal into phi - theta and phi: so the trigonometry is done once for all of them.
"""

from __future__ import annotations

import math

from ambinav.geometry.motion.circles import NEAR, polar, wrap
from ambinav.runtime.kernels import kernel

QUARTER = 0.5 * math.pi
TIE = 1e-11  # radii; far above what rounding makes of two words of equal length
# A step to the side costs its square root: of 1e-13 radii 1e-6.
ONE_CIRCLE = 1e-13

# Words, named as they begin forward and to the left; those that end in BACK run from the goal.
LSL, LSR, LRL, LRL_BACK, LRLR_OUT, LRLR_IN, LRSL, LRSL_BACK, LRSR, LRSR_BACK, LRSLR = range(11)


@kernel
def shortest_reeds_shepp(x, y, phi):
    """Find the shortest of the 48 words to the pose (x, y, phi), in radii.

    Returns its length, the word, 1 or -1 for as it is or mirrored, 1 or -1 for as it is or with
    time flipped, and the paper's t, u and v.
    """
    s, c = math.sin(phi), math.cos(phi)
    d_left, left = polar(x - s, y - 1.0 + c)
    d_right, right = polar(x + s, y + 1.0 - c)
    d_out, out = polar(x + s, y - 1.0 - c)
    d_in, inward = polar(x - s, y + 1.0 + c)
    best = (math.inf, LSL, 1.0, -1.0, 0.0, 0.0, 0.0)
    best = _with_straight_middle(best, 1.0, d_left, left, d_out, out, phi)
    best = _with_straight_middle(best, -1.0, d_right, -right, d_in, -inward, -phi)
    best = _with_arcs_alone(best, 1.0, d_left, left, d_out, out, phi)
    best = _with_arcs_alone(best, -1.0, d_right, -right, d_in, -inward, -phi)
    best = _with_quarter_turns(best, 1.0, d_left, left, d_out, out, d_in, inward, phi)
    return _with_quarter_turns(best, -1.0, d_right, -right, d_in, -inward, d_out, -out, -phi)


@kernel
def reeds_shepp_pieces(word_found):
    """Return lengths and sides (1 left, -1 right, 0 straight) of a word's pieces, in radii."""
    _, word, side, flip, t, u, v = word_found
    t, u, v, quarter = flip * t, flip * u, flip * v, -flip * QUARTER
    if word == LSL:
        lengths, sides = (t, u, v, 0.0, 0.0), (side, 0.0, side, 0.0, 0.0)
    elif word == LSR:
        lengths, sides = (t, u, v, 0.0, 0.0), (side, 0.0, -side, 0.0, 0.0)
    elif word == LRL:
        lengths, sides = (t, u, v, 0.0, 0.0), (side, -side, side, 0.0, 0.0)
    elif word == LRL_BACK:
        lengths, sides = (v, u, t, 0.0, 0.0), (side, -side, side, 0.0, 0.0)
    elif word == LRLR_OUT:
        lengths, sides = (t, u, -u, v, 0.0), (side, -side, side, -side, 0.0)
    elif word == LRLR_IN:
        lengths, sides = (t, u, u, v, 0.0), (side, -side, side, -side, 0.0)
    elif word == LRSL:
        lengths, sides = (t, quarter, u, v, 0.0), (side, -side, 0.0, side, 0.0)
    elif word == LRSL_BACK:
        lengths, sides = (v, u, quarter, t, 0.0), (side, 0.0, -side, side, 0.0)
    elif word == LRSR:
        lengths, sides = (t, quarter, u, v, 0.0), (side, -side, 0.0, -side, 0.0)
    elif word == LRSR_BACK:
        lengths, sides = (v, u, quarter, t, 0.0), (-side, 0.0, -side, side, 0.0)
    else:
        lengths, sides = (t, quarter, u, quarter, v), (side, -side, 0.0, side, -side)
    return lengths, sides


@kernel
def _with_straight_middle(best, side, d, theta, e, psi, phi):
    """Try words CSC: LSL (8.1) by the vector (d, theta), LSR (8.2) by (e, psi)."""
    if d < ONE_CIRCLE:  # an arc is all, and theta tells nothing
        best = _shorter(best, abs(phi), LSL, side, 1.0, 0.0, 0.0, phi)
    reach = e >= 2.0
    u = math.sqrt(max(e * e - 4.0, 0.0))
    lean = math.atan2(2.0, u) if reach else 0.0
    for flip in (1.0, -1.0):
        t = wrap(theta)
        v = wrap(phi - t)
        if t >= -NEAR and v >= -NEAR:
            best = _shorter(best, abs(t) + d + abs(v), LSL, side, flip, t, d, v)
        t = wrap(psi + lean)
        v = wrap(t - phi)
        if reach and t >= -NEAR and v >= -NEAR:
            best = _shorter(best, abs(t) + u + abs(v), LSR, side, flip, t, u, v)
        theta, psi, phi = math.pi - theta, math.pi - psi, -phi
    return best


@kernel
def _with_arcs_alone(best, side, d, theta, e, psi, phi):
    """Try words CCC (8.3 and 8.4) by (d, theta), CCCC (8.7 and 8.8) by (e, psi)."""
    middle = -2.0 * math.asin(min(0.25 * d, 1.0))
    out = math.acos(min(0.25 * (2.0 + e), 1.0))
    cosine = min(max((20.0 - e * e) / 16.0, 0.0), 1.0)
    inside = -math.acos(cosine)
    # The paper's tau = theta - atan2(B, A) (+ pi) with A and B of u alone.
    lean = math.atan2(2.0 - cosine, -math.sqrt(1.0 - cosine * cosine))
    for flip in (1.0, -1.0):
        if d <= 4.0 and -middle < best[0]:
            t = wrap(theta + 0.5 * middle + math.pi)
            v = wrap(phi - t + middle)
            if t >= -NEAR:
                best = _shorter(best, abs(t) - middle + abs(v), LRL, side, flip, t, middle, v)
            t = wrap(phi - theta + 0.5 * middle + math.pi)
            v = wrap(phi - t + middle)
            if t >= -NEAR:
                best = _shorter(best, abs(t) - middle + abs(v), LRL_BACK, side, flip, t, middle, v)
        if e <= 2.0 and 2.0 * out < best[0]:
            t = wrap(psi + out + QUARTER)
            v = wrap(t - 2.0 * out - phi)
            if t >= -NEAR and v <= NEAR:
                best = _shorter(best, abs(t) + 2.0 * out + abs(v), LRLR_OUT, side, flip, t, out, v)
        if 2.0 <= e <= math.sqrt(20.0) and -2.0 * inside < best[0]:
            t = wrap(psi + lean)
            v = wrap(t - phi)
            if t >= -NEAR and v >= -NEAR:
                best = _shorter(
                    best, abs(t) - 2.0 * inside + abs(v), LRLR_IN, side, flip, t, inside, v
                )
        theta, psi, phi = math.pi - theta, math.pi - psi, -phi
    return best


@kernel
def _with_quarter_turns(best, side, d, theta, e, psi, f, chi, phi):
    """Try words CCSC (8.9, 8.10) by (d, theta), (e, psi), (f, chi); CCSCC (8.11) by (e, psi).

    (f, chi) joins the other circles than (e, psi): the end of a word run from the goal.
    """
    along = 2.0 - math.sqrt(max(d * d - 4.0, 0.0))
    lean = math.atan2(2.0 - along, -2.0)
    between = math.sqrt(max(e * e - 4.0, 0.0))
    slant = math.atan2(2.0, between)
    for flip in (1.0, -1.0):
        if d >= 2.0 and along <= NEAR and QUARTER - along < best[0]:
            t = wrap(theta + lean)
            v = wrap(phi - QUARTER - t)
            if t >= -NEAR and v <= NEAR:
                best = _shorter(
                    best, abs(t) + QUARTER + abs(along) + abs(v), LRSL, side, flip, t, along, v
                )
            t = wrap(phi - theta + lean)
            v = wrap(phi - QUARTER - t)
            if t >= -NEAR and v <= NEAR:
                best = _shorter(
                    best, abs(t) + QUARTER + abs(along) + abs(v), LRSL_BACK, side, flip, t, along, v
                )
        u = 2.0 - e
        if u <= NEAR and QUARTER - u < best[0]:
            t = wrap(psi + QUARTER)
            v = wrap(t + QUARTER - phi)
            if t >= -NEAR and v <= NEAR:
                best = _shorter(best, abs(t) + QUARTER + abs(u) + abs(v), LRSR, side, flip, t, u, v)
        u = 2.0 - f
        if u <= NEAR and QUARTER - u < best[0]:
            t = wrap(phi - chi + QUARTER)
            v = wrap(t + QUARTER - phi)
            if t >= -NEAR and v <= NEAR:
                best = _shorter(
                    best, abs(t) + QUARTER + abs(u) + abs(v), LRSR_BACK, side, flip, t, u, v
                )
        u = 4.0 - between
        if u <= NEAR and math.pi - u < best[0]:
            t = wrap(psi + slant + QUARTER)
            v = wrap(t - phi)
            if t >= -NEAR and v >= -NEAR:
                best = _shorter(
                    best, abs(t) + math.pi + abs(u) + abs(v), LRSLR, side, flip, t, u, v
                )
        theta, psi, chi, phi = math.pi - theta, math.pi - psi, math.pi - chi, -phi
    return best


@kernel
def _shorter(best, length, word, side, flip, t, u, v):
    """Return the shorter of two words.

    L+R-L+ and R-L+R- both have the length phi, and rounding should not choose between them. Of
    equally long words the one that begins to the left is taken, then the one that begins
    forwards, so that the path back is the same curve.
    """
    if length < best[0] - TIE:
        return length, word, side, flip, t, u, v
    if length < best[0] + TIE and (side > best[2] or (side == best[2] and flip > best[3])):
        return length, word, side, flip, t, u, v
    return best
