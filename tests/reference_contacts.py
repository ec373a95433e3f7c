"""Lines 8 and 16 of the paper's loop in NumPy, float64: all pairs, one after the other. Part of reference.py."""

import numpy as np

MARGIN = 0.05  # contacts are watched from this fraction of r_i + r_j on


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
            n, rest = (c.size[k], r[i]) if c.kind[k] == 0 else (None, c.size[k, 0] + r[i])
            if n is None:
                t = entry_time(a, d, rest)
                n = unit(a + (1.0 if t is None else t) * d)[0]
            if min(n @ a, n @ (a + d)) - rest < MARGIN * r[i] + np.linalg.norm(d):
                rows.append((i, -1 - k, n, rest + n @ c.centre[k]))
    return rows


def entry_time(a, d, rest):
    """When a + t d, 0 <= t <= 1, comes in to the distance `rest` from 0; inside already and going in, at once."""
    if a @ d >= 0.0:
        return None
    times = [t.real for t in np.roots([d @ d, 2.0 * a @ d, a @ a - rest**2]) if np.isreal(t)]
    return max(min(times), 0.0) if times and min(times) <= 1.0 else None


def passed_side(a, d, rest):
    """The side a pair came from, if it is on another at the end of the step."""
    t = entry_time(a, d, rest)
    if t is None:
        return None
    n = unit(a + t * d)[0]
    return n if n @ (a + d) <= 0.0 or np.linalg.norm(a + d) >= rest else None


def friction(model, j):
    return model.contacts.friction if j >= 0 else model.colliders.friction[-1 - j]


def bounce(model, x, v, before, w, h, contacts, lam):
    """Line 16 for the contacts that pushed, each with its share of the particles' masses."""
    active = [row for row, push in zip(contacts, lam, strict=True) if push > 0.0]
    n, dv = np.zeros(len(x)), np.zeros_like(v)
    for i, j, *_ in active:
        n[[i, j] if j >= 0 else [i]] += 1
    for i, j, normal, _ in active:
        mu = friction(model, j)
        e = model.contacts.restitution if j >= 0 else model.colliders.restitution[-1 - j]
        w_j, n_j = (w[j], n[j]) if j >= 0 else (0.0, 0.0)
        normal = unit(x[i] - x[j])[0] if normal is None else normal
        relative, approach = v[i] - (v[j] if j >= 0 else 0), normal @ (before[i] - (before[j] if j >= 0 else 0))
        e = 0.0 if -approach <= 2.0 * h * np.linalg.norm(model.gravity) else e
        along = normal @ relative
        slide = relative - along * normal
        speed = np.linalg.norm(slide)
        change = max(-e * approach, 0.0) - along
        grip = min(mu * max(change, 0.0), speed) / speed if speed > 0.0 else 0.0
        impulse = (normal * change - grip * slide) / (n[i] * w[i] + n_j * w_j)
        dv[i] += w[i] * impulse
        if j >= 0:
            dv[j] -= w_j * impulse
    return v + dv


def unit(d):
    length = np.linalg.norm(d)
    return (d / length if length > 0.0 else np.array([1.0, 0.0, 0.0]))[None]
