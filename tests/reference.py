"""The paper's loop in NumPy, float64: what the kernels are checked against. Shares no code with them.

Loops over constraints, all pairs instead of a grid, positions p instead of displacements. Mueller et al. 2007.
"""

import numpy as np

MARGIN = 0.05  # contacts are watched from this fraction of r_i + r_j on


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
        r = x[i] - (m * x[i]).sum(0) / m.sum()
        v_cm = (m * v[i]).sum(0) / m.sum()
        angular = np.cross(r, m * v[i]).sum(0)
        inertia = sum(mi * (ri @ ri * np.eye(3) - np.outer(ri, ri)) for mi, ri in zip(m[:, 0], r, strict=True))
        omega = np.linalg.pinv(inertia, rcond=1e-6, hermitian=True) @ angular
        v[i] += k * (v_cm + np.cross(omega, r) - v[i])
    return v


def find_contacts(model, x, p, w):
    """Rows (i, j, normal or None for a round contact, offset): C = normal . (p_i - p_j) - offset, j < 0 a collider."""
    rows, r, c = [], model.radius, model.colliders
    joined = {frozenset(edge) for edge in model.distance.edge.tolist()}
    for i in range(len(x) if model.contacts else 0):
        for j in range(i):
            rest, a, d = r[i] + r[j], x[i] - x[j], (p[i] - p[j]) - (x[i] - x[j])
            t = np.clip(-(a @ d) / (d @ d), 0.0, 1.0) if d @ d > 0.0 else 0.0
            if rest == 0.0 or w[i] + w[j] == 0.0 or {i, j} in joined:
                continue
            if np.linalg.norm(a + t * d) < (1.0 + MARGIN) * rest:
                rows.append((i, j, passed_side(a, d, rest), rest))
    for i in np.flatnonzero(w > 0.0):
        for k in range(len(c.kind)):
            a, d = x[i] - c.centre[k], p[i] - x[i]
            n, rest = (c.normal[k], r[i]) if c.kind[k] == 0 else (None, c.size[k] + r[i])
            if n is None:
                times = entry_times(a, d, rest)
                n = a + (times[0] if times else 0.0) * d
                n = n / np.linalg.norm(n)
            if min(n @ a, n @ (a + d)) - rest < MARGIN * r[i] + np.linalg.norm(d):
                rows.append((i, -1 - k, n, rest + n @ c.centre[k]))
    return rows


def entry_times(a, d, rest):
    """When a + t d, 0 <= t <= 1, comes from outside to the distance `rest` from 0."""
    roots = np.roots([d @ d, 2.0 * a @ d, a @ a - rest**2]) if d @ d > 0.0 else np.zeros(0)
    return [t.real for t in sorted(roots, key=np.real)[:1] if np.isreal(t) and 0.0 <= t.real <= 1.0 and a @ d < 0.0]


def passed_side(a, d, rest):
    """The side a pair came from, if it is on another at the end of the step."""
    if np.linalg.norm(a) < rest:
        return a / np.linalg.norm(a) if a @ (a + d) <= 0.0 < a @ a else None
    entry = [(a + t * d) / rest for t in entry_times(a, d, rest)]
    return next((n for n in entry if n @ (a + d) <= 0.0 or np.linalg.norm(a + d) >= rest), None)


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
            for sign, particle in zip((1.0, -1.0), end, strict=False):
                move[particle] += sign * w[particle] * (dlam @ gradient)
        p = p + move / (np.maximum(n, 1)[:, None] if averaging == "valence" else 1.0)
    return p, [float(multiplier[0]) for multiplier in lam[len(alpha) :]]


def unit(d):
    length = np.linalg.norm(d)
    return (d / length if length > 0.0 else np.array([1.0, 0.0, 0.0]))[None]


def bounce(model, x, v, before, w, h, contacts, lam):
    """Line 16 for the contacts that pushed, each with its share of the particles' masses."""
    active = [(*row, push) for row, push in zip(contacts, lam, strict=True) if push > 0.0]
    n, dv = np.zeros(len(x)), np.zeros_like(v)
    for i, j, *_ in active:
        n[[i, j] if j >= 0 else [i]] += 1
    for i, j, normal, _, push in active:
        table = model.contacts if j >= 0 else None
        mu = table.friction if table else model.colliders.friction[-1 - j]
        e = table.restitution if table else model.colliders.restitution[-1 - j]
        w_j, n_j = (w[j], n[j]) if j >= 0 else (0.0, 0.0)
        normal = unit(x[i] - x[j])[0] if normal is None else normal
        relative, approach = v[i] - (v[j] if j >= 0 else 0), normal @ (before[i] - (before[j] if j >= 0 else 0))
        e = 0.0 if -approach <= 2.0 * h * np.linalg.norm(model.gravity) else e
        along = normal @ relative
        slide = relative - along * normal
        speed = np.linalg.norm(slide)
        grip = min(mu * push / h * (w[i] + w_j), speed) / speed if speed > 0.0 else 0.0
        impulse = (normal * (max(-e * approach, 0.0) - along) - grip * slide) / (n[i] * w[i] + n_j * w_j)
        dv[i] += w[i] * impulse
        if j >= 0:
            dv[j] -= w_j * impulse
    return v + dv
