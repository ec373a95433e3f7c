"""Elimination of a block matrix, 3 x 3 tiles, on a static schedule: one tile's share of it.

    A = L U, block by block, without symmetry: friction and the midpoint rule have none. Left-looking: tile t gathers
    X_tc Y_cj from the columns c < t of its row, with X_rc = A_rc u_c^-1, Y_cr = l_c^-1 A_cr and D_c = l_c u_c:

        D_t  -=  X_tc Y_ct        A_rt -= X_rc Y_ct        A_tr -= X_tc Y_cr

Tiles are substituted into, never inverted: with numbers of 1 / a beside those of 1 / w that would lose their ratio
twice.
Always in float64: it costs next to nothing on a CPU, and in float32 a would have to be 1e4 times as large.
Source: Duff, Erisman, Reid 1986, Direct Methods for Sparse Matrices.
"""

from __future__ import annotations

import warp as wp


@wp.func
def factor_tile(A: wp.mat33d):
    """l (below the diagonal, 1 on it) and u, with 1 / u on the diagonal; a pivot of 0 gives 0, so its unknown is 0."""
    one = wp.float64(1.0)
    zero = wp.float64(0.0)
    # Both pivots from A, not one from the other: the divisions need not wait for each other.
    second = A[0, 0] * A[1, 1] - A[1, 0] * A[0, 1]
    r0 = zero
    r1 = zero
    r2 = zero
    if A[0, 0] != zero:
        r0 = one / A[0, 0]
    if second != zero:
        r1 = A[0, 0] / second
    l10 = A[1, 0] * r0
    l20 = A[2, 0] * r0
    u12 = A[1, 2] - l10 * A[0, 2]
    l21 = (A[2, 1] - l20 * A[0, 1]) * r1
    third = A[2, 2] - l20 * A[0, 2] - l21 * u12
    if third != zero:
        r2 = one / third
    return wp.mat33d(r0, A[0, 1], A[0, 2], l10, r1, u12, l20, l21, r2)


@wp.func
def forward(F: wp.mat33d, b: wp.vec3d):
    """l^-1 b"""
    y1 = b[1] - F[1, 0] * b[0]
    return wp.vec3d(b[0], y1, b[2] - F[2, 0] * b[0] - F[2, 1] * y1)


@wp.func
def back(F: wp.mat33d, y: wp.vec3d):
    """u^-1 y"""
    z2 = y[2] * F[2, 2]
    z1 = (y[1] - F[1, 2] * z2) * F[1, 1]
    return wp.vec3d((y[0] - F[0, 1] * z1 - F[0, 2] * z2) * F[0, 0], z1, z2)


@wp.func
def forward_tile(F: wp.mat33d, A: wp.mat33d):
    """l^-1 A"""
    a0 = A[0]
    a1 = A[1] - F[1, 0] * a0
    return wp.matrix_from_rows(a0, a1, A[2] - F[2, 0] * a0 - F[2, 1] * a1)


@wp.func
def back_tile(F: wp.mat33d, Y: wp.mat33d):
    """u^-1 Y"""
    z2 = F[2, 2] * Y[2]
    z1 = F[1, 1] * (Y[1] - F[1, 2] * z2)
    return wp.matrix_from_rows(F[0, 0] * (Y[0] - F[0, 1] * z1 - F[0, 2] * z2), z1, z2)


@wp.func
def divide_tile(A: wp.mat33d, F: wp.mat33d):
    """A u^-1"""
    c0 = F[0, 0] * wp.vec3d(A[0, 0], A[1, 0], A[2, 0])
    c1 = F[1, 1] * (wp.vec3d(A[0, 1], A[1, 1], A[2, 1]) - F[0, 1] * c0)
    c2 = F[2, 2] * (wp.vec3d(A[0, 2], A[1, 2], A[2, 2]) - F[0, 2] * c0 - F[1, 2] * c1)
    return wp.matrix_from_cols(c0, c1, c2)


@wp.func
def swap_rows(p: wp.int32, q: wp.int32):
    """The permutation that exchanges rows p and q."""
    P = wp.identity(3, dtype=wp.float64)
    P[p, p] = wp.float64(0.0)
    P[q, q] = wp.float64(0.0)
    P[p, q] = wp.float64(1.0)
    P[q, p] = wp.float64(1.0)
    return P


@wp.func
def pivot(A: wp.mat33d):
    """The permutation of A's rows that brings the largest pivots up: for a tile whose symmetric part is not positive,
    as that of a particle that slides."""
    P = wp.identity(3, dtype=wp.float64)
    best = int(0)
    for k in range(1, 3):
        if wp.abs(A[k, 0]) > wp.abs(A[best, 0]):
            best = k
    if best > 0:
        P = swap_rows(0, best)
    B = P * A
    if B[0, 0] != wp.float64(0.0):
        below = B[1, 1] - B[1, 0] * B[0, 1] / B[0, 0]
        last = B[2, 1] - B[2, 0] * B[0, 1] / B[0, 0]
        if wp.abs(last) > wp.abs(below):
            P = swap_rows(1, 2) * P
    return P
