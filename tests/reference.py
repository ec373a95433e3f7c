"""The paper's loop in NumPy, float64: what the kernels are checked against. Shares no code with them.

Loops over constraints, all pairs instead of a grid, positions p instead of displacements. Mueller et al. 2007.
"""

import numpy as np
from reference_contacts import bounce, find_contacts, friction, unit


def frame(model, x, v, *, dt, substeps, iterations, relaxation=1.0, averaging="mass-splitting", damping=0.0,
          grabbed=None, target=None):  # fmt: skip
    """One frame of `substeps` steps from positions x and velocities v [n, 3]; returns the new ones."""
    w = model.w.copy()
    if grabbed is not None:
        w[grabbed] = 0.0
    h = dt / substeps
    k_step = 1.0 - (1.0 - damping) ** (1.0 / substeps)
    for substep in range(substeps):
        v = v + h * np.where(w[:, None] > 0.0, model.gravity, 0.0)  # 5
        v = damp(model.component, x, v, w, k_step)  # 6
        if grabbed is not None:
            v[grabbed] = (target - x[grabbed]) / (substeps - substep) / h
        p = x + h * v  # 7
        contacts = find_contacts(model, x, p, w)  # 8
        p, lam = solve(model, x, p, w, h, contacts, iterations, relaxation, averaging)  # 9-11
        before, v, x = v, (p - x) / h, p  # 12-15
        v = bounce(model, x, v, before, w, h, contacts, lam)  # 16
    return x, v


def damp(component, x, v, w, k):
    v = v.copy()
    for c in np.unique(component):
        i = np.flatnonzero((component == c) & (w > 0.0))
        if k == 0.0 or not len(i):
            continue
        m = 1.0 / w[i, None]
        r = x[i] - x[i[0]]  # so that one particle has r = 0 exactly, and no axis to turn about
        r -= (m * r).sum(0) / m.sum()
        v_cm = (m * v[i]).sum(0) / m.sum()
        angular = np.cross(r, m * v[i]).sum(0)
        inertia = sum(mi * (ri @ ri * np.eye(3) - np.outer(ri, ri)) for mi, ri in zip(m[:, 0], r, strict=True))
        omega = np.linalg.pinv(inertia, rcond=1e-6, hermitian=True) @ angular
        v[i] += k * (v_cm + np.cross(omega, r) - v[i])
    return v


def solve(model, x, p, w, h, contacts, iterations, relaxation, averaging):
    """Lines 9-11: every constraint is (particles, signs, C, gradient); all see the same p, then move it at once."""
    edges, points, n = model.distance, model.point, np.zeros(len(x))
    ends = [*edges.edge, *points.particle[:, None], *(([i, j] if j >= 0 else [i]) for i, j, *_ in contacts)]
    for end in ends:
        n[end] += 1
    share = n if averaging == "mass-splitting" else np.ones(len(x))
    stiffness = 1.0 - (1.0 - np.append(edges.stiffness, points.stiffness)) ** (1.0 / iterations)
    alpha = np.append(edges.compliance, points.compliance) / h**2
    lam = [np.zeros(3 if len(edges) <= k < len(alpha) else 1) for k in range(len(ends))]
    held = {k: np.zeros(3) for k in range(len(alpha), len(ends))}  # by friction
    for _ in range(iterations):
        move = np.zeros_like(p)
        for k, end in enumerate(ends):
            weight = share[end] @ w[end]
            if weight == 0.0:
                continue
            soft = k < len(alpha)
            d = p[end[0]] - (p[end[1]] if len(end) > 1 else 0.0)
            if k < len(edges):
                gradient, c = unit(d), np.array([np.linalg.norm(d) - edges.rest_length[k]])
            elif soft:
                gradient, c = np.eye(3), d - points.target[k - len(edges)]
            else:
                _, _, normal, offset = contacts[k - len(alpha)]
                gradient = unit(d) if normal is None else normal[None]
                c = gradient @ d - offset
            a = alpha[k] if soft else 0.0
            dlam = -relaxation * (c * (stiffness[k] if soft else 1.0) + a * lam[k]) / (weight + a)
            dlam = dlam if soft else np.maximum(dlam, -lam[k])
            lam[k] = lam[k] + dlam
            push = dlam @ gradient
            if not soft:
                step = (p - x)[end[0]] - ((p - x)[end[1]] if len(end) > 1 else 0.0)
                hold = held[k] - relaxation * (step - gradient[0] * (gradient[0] @ step)) / weight
                bound, size = friction(model, contacts[k - len(alpha)][1]) * lam[k][0], np.linalg.norm(hold)
                hold = hold * bound / size if size > bound else hold
                push, held[k] = push + hold - held[k], hold
            for sign, particle in zip((1.0, -1.0), end, strict=False):
                move[particle] += sign * w[particle] * push
        p = p + move / (np.maximum(n, 1)[:, None] if averaging == "valence" else 1.0)
    return p, [float(multiplier[0]) for multiplier in lam[len(alpha) :]]
