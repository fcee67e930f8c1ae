"""Transfer functions: the effect of a stretch of path on any covariance.

Prentice & Roy (2009, "The belief roadmap: efficient planning in belief space by factoring the
covariance", IJRR 28(11-12), section 4) write the covariance as S = B C^-1. A prediction and an
update of the extended Kalman filter are then linear in (B, C), one 2n x 2n matrix a step, and a
whole motion is the product of its steps. The entries of such a product grow like exp(k) and
exp(-k) with the number of scans, and what the weakly observed directions carry is lost to
rounding beside the others.

The same function has a second form, in which nothing grows: the scattering matrix of the motion
(Redheffer 1962, "On the relation of transmission-line theory to scattering and transfer";
Verghese, Friedlander & Kailath 1980, "Scattering theory and linear least-squares estimation, part
III"). It is kept here as three n x n blocks, and maps S to

    S' = N + F (I + S O)^-1 S F^T

F is how an error is carried along, N the covariance that perfect knowledge ends with, O what the
scans tell about the state at the beginning. Nothing is inverted that may be singular: S may be
zero, and O too. Two motions in a row are one again (Redheffer's star product), with
K = (I + N1 O2)^-1:

    F = F2 K F1,    N = N2 + F2 K N1 F2^T,    O = O1 + F1^T O2 K F1
"""

from __future__ import annotations

import numpy as np

from ambinav.runtime.kernels import kernel


@kernel
def compose(f1, n1, o1, f2, n2, o2):
    """Return the blocks F, N, O of two consecutive stretches."""
    room = _product(n1, o2)
    for i in range(room.shape[0]):
        room[i, i] += 1.0
    passed, left = _solved(room, f1, n1)
    noise = _product(_product(f2, left), f2.T)
    seen = _product(_product(f1.T, o2), passed)
    return _product(f2, passed), _symmetric_sum(n2, noise), _symmetric_sum(o1, seen)


@kernel
def carried(f, n, o, covariance):
    """Return the covariance at the end of a stretch."""
    room = _product(covariance, o)
    for i in range(room.shape[0]):
        room[i, i] += 1.0
    _, left = _solved(room, covariance, covariance)
    return _symmetric_sum(n, _product(_product(f, left), f.T))


@kernel
def _product(a, b):
    # For matrices this small a loop is several times faster than a call of BLAS.
    size = a.shape[0]
    out = np.zeros((size, size))
    for i in range(size):
        for k in range(size):
            for j in range(size):
                out[i, j] += a[i, k] * b[k, j]
    return out


@kernel
def _symmetric_sum(a, b):
    """Return the sum of a symmetric matrix and one that is symmetric up to rounding."""
    size = a.shape[0]
    out = np.empty((size, size))
    for i in range(size):
        for j in range(i + 1):
            out[i, j] = out[j, i] = a[i, j] + 0.5 * (b[i, j] + b[j, i])
    return out


@kernel
def _solved(matrix, first, second):
    """Return matrix^-1 first and matrix^-1 second, by elimination with row pivots."""
    size = matrix.shape[0]
    a, x, y = matrix.copy(), first.copy(), second.copy()
    for k in range(size):
        pivot = k
        for i in range(k + 1, size):
            if abs(a[i, k]) > abs(a[pivot, k]):
                pivot = i
        if pivot != k:
            for j in range(size):
                a[k, j], a[pivot, j] = a[pivot, j], a[k, j]
                x[k, j], x[pivot, j] = x[pivot, j], x[k, j]
                y[k, j], y[pivot, j] = y[pivot, j], y[k, j]
        inverse = 1.0 / a[k, k]
        for i in range(size):
            if i == k:
                continue
            factor = a[i, k] * inverse
            for j in range(size):
                a[i, j] -= factor * a[k, j]
                x[i, j] -= factor * x[k, j]
                y[i, j] -= factor * y[k, j]
        for j in range(size):
            a[k, j] *= inverse
            x[k, j] *= inverse
            y[k, j] *= inverse
    return x, y
