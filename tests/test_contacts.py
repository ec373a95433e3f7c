"""Line 8 over the hash grid against all pairs in NumPy."""

import re

import numpy as np
import pytest
import reference_contacts
from models import crowd_model

import pbd_warp as pbd


def found_by_kernel(model, dt):
    sim = pbd.Simulation(model, dt=dt, capture=False)
    loop = sim._loop
    loop.integrator.predict(loop.integrator.stages[0])
    loop.contacts.find()
    count = int(sim._loop.contacts.count.numpy()[0])
    rows = {}
    for (i, j), normal, gap in zip(
        sim._loop.contacts.pair.numpy()[:count],
        sim._loop.contacts.normal.numpy()[:count],
        sim._loop.contacts.gap.numpy()[:count],
        strict=True,
    ):
        if 0 <= i < j:  # the one with the longer path comes first; the oracle has the larger index first
            i, j, normal = j, i, -normal
        assert (i, j) not in rows, "a pair was found twice"
        rows[int(i), int(j)] = (normal, gap)
    return sim, rows


@pytest.mark.parametrize("dt", [1e-9, 1 / 60, 0.5], ids=["at rest", "a step", "bullets"])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("offset", [0.0, -40.0], ids=["origin", "far and negative"])
def test_the_grid_finds_what_all_pairs_find(rng, dt, dtype, offset):
    model = crowd_model(rng, dtype=dtype)
    for array in (model.x, model.colliders.centre):
        array += offset
    sim, rows = found_by_kernel(model, dt)
    x = sim.state.x.numpy().astype(float)
    p = x + sim._context.u.numpy().astype(float)
    expected = reference_contacts.find_contacts(model, x, p, model.w)
    assert len(expected) > 12
    assert {(i, j) for i, j, *_ in expected} == set(rows)
    atol = 1e-3 if dtype == "float32" else 1e-9
    valence = sim.settings.method.valence(model)
    for i, j, normal, offset in expected:
        valence[[i, j] if j >= 0 else [i]] += 1
        got, gap = rows[i, j]
        if normal is None:
            np.testing.assert_array_equal(got, 0.0)
        else:
            np.testing.assert_allclose(got, normal, atol=atol)
            c = normal @ (x[i] - (x[j] if j >= 0 else 0.0)) - offset
            np.testing.assert_allclose(gap, c, atol=atol)
    np.testing.assert_array_equal(sim._loop.contacts.valence.numpy(), valence)


def test_bullets_are_half_spaces(rng):
    """The oracle and the kernel would also agree if neither ever chose one."""
    _, rows = found_by_kernel(crowd_model(rng), 0.5)
    assert sum(np.any(normal != 0.0) for (_, j), (normal, _) in rows.items() if j >= 0) > 5


def test_overflow_is_an_error_that_says_how_much_room_it_takes(rng):
    model = crowd_model(rng)
    sim = pbd.Simulation(model, max_contacts=3)
    with pytest.raises(
        pbd.SimulationFailed,
        match=r"frame 1 .* contacts, but there is room for 3; give Simulation or Scene max_contacts=",
    ) as caught:
        sim.step()
    enough = int(re.search(r"max_contacts=(\d+)", str(caught.value)).group(1))
    pbd.Simulation(model, max_contacts=enough).step()
