"""The whole step against the NumPy reference; what is captured, launched and allocated."""

import numpy as np
import pytest
import reference
import warp as wp
from models import FOUR_SCENES, crowd_model, rope_model, state

import pbd_warp as pbd

SCENES = FOUR_SCENES


def check_next_frame(sim, atol, grabbed=None, target=None):
    """Let the simulation and the reference both make the next frame from the same state."""
    x, v = state(sim)
    method = sim.settings.method
    expected_x, expected_v = reference.frame(
        sim.model, x, v,
        dt=sim.dt, substeps=sim.substeps, iterations=method.iterations, relaxation=method.relaxation,
        averaging=method.averaging, damping=sim.settings.damping, grabbed=grabbed, target=target,
    )  # fmt: skip
    sim.step()
    x, v = state(sim)
    np.testing.assert_allclose(x, expected_x, atol=atol)
    # A displacement's error is divided by the substep on its way to the velocity.
    np.testing.assert_allclose(v, expected_v, atol=atol / sim.settings.step_dt)


# Round-off of coordinates of size 1 through the substeps and sweeps of one frame: some 100 operations each.
ROUND_OFF = {"float32": 100 * 1.2e-7, "float64": 100 * 2.2e-16}


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("name", SCENES)
def test_every_scene_follows_the_reference(name, dtype):
    """Before, in and after its drag; the reference starts from the simulation's own state each time."""
    scene = pbd.load_scene(name).changed(method=pbd.Jacobi(4))  # the method that the reference has
    sim = pbd.Simulation(scene.builder.finalize(dtype=dtype), scene.settings)
    drag = pbd.Drag(scene.drag)
    start, end = (gesture[0] for gesture in (scene.drag[0], scene.drag[-1]))
    compared = [2, int(60 * (start + 0.2)), int(60 * (end - 0.2)), int(60 * end) + 3]
    for frame in range(compared[-1] + 1):
        drag.advance(sim)
        if frame in compared:
            grabbed = sim.held
            assert (grabbed is None) == (frame in (compared[0], compared[-1]))
            check_next_frame(sim, ROUND_OFF[dtype], grabbed, sim.held_target)
        else:
            sim.step()
    assert not np.allclose(state(sim)[0], sim.model.x), "nothing moved"


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize(
    "settings",
    [
        {"method": pbd.Jacobi(4)},
        {"method": pbd.Jacobi(4, relaxation=1.3)},
        {"method": pbd.Jacobi(4, averaging="none", relaxation=0.5)},
        {"method": pbd.Jacobi(4, averaging="valence")},
        {"method": pbd.Jacobi(4), "damping": 0.3},
        {"method": pbd.Jacobi(4), "substeps": 3},
    ],
    ids=["plain", "relaxation", "none", "valence", "damping", "substeps"],
)
def test_every_setting_follows_the_reference_in_a_crowd(rng, dtype, settings):
    """Contacts of all kinds, colliders, friction, restitution, joined and fixed particles at once."""
    sim = pbd.Simulation(crowd_model(rng, dtype=dtype), **settings)
    check_next_frame(sim, ROUND_OFF[dtype])


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("soft", [{"stiffness": 0.4}, {"compliance": 1e-4}], ids=["stiffness", "compliance"])
def test_soft_ropes_follow_the_reference(dtype, soft):
    builder = pbd.ModelBuilder()
    rope = builder.add_rope(np.linspace([0.0, 0, 0], [1, 0, 0], 6), pinned=(0,), **soft)
    builder.add_point(rope[-1], target=(1.0, 0.3, 0.2), **soft)
    sim = pbd.Simulation(builder.finalize(dtype=dtype), substeps=2, method=pbd.Jacobi(5))
    for _ in range(3):
        check_next_frame(sim, ROUND_OFF[dtype])


PASSES = {
    # No collision kernel, no damping, nothing for compliance.
    "worm": ["project_distance"] * 2,  # one a colour
    "point": ["project_distance", "project_point", "add_corrections"],
    "rope": ["project_distance", "project_distance", "project_point"],
    "collision": ["project_contact", "add_corrections"],
}
DAMPING = ["accelerate", *["zero"] * 5, "sum_momentum", "divide_by_mass", "sum_angular_momentum"]
DAMPING += ["find_rotation", "damp_velocities"]
FIND = [
    *["zero", "copy", "copy", "find_close_contacts", "find_collider_contacts"],
    *["note_overflow", "zero", "zero"],
]
BOUNCE = ["zero", "count_active", "bounce", "add_corrections"]


@pytest.mark.parametrize("name", SCENES)
def test_passes_are_just_what_the_scene_needs(name):
    scene = pbd.load_scene(name)
    sim = pbd.Simulation(scene.builder.finalize(), scene.settings)
    collides = name == "collision"
    expected = [
        *([] if collides else DAMPING),
        "predict",
        *(FIND if collides else []),
        *(PASSES[name] * scene.settings.method.iterations),
        "update",
        *(BOUNCE if collides else []),
    ]
    assert sim.passes == expected


def test_a_free_particle_needs_two_passes_and_few_arrays():
    builder = pbd.ModelBuilder()
    builder.add_particle((0, 0, 0))
    sim = pbd.Simulation(builder.finalize())
    assert sim.passes == ["predict", "update"]
    assert not [name for name in sim._context.arrays if name.startswith(("distance", "point", "contact", "damping"))]


def test_passes_touch_nothing():
    sim = pbd.Simulation(rope_model())
    assert len(sim.passes) == 2 + 2 * 20
    np.testing.assert_array_equal(state(sim)[0], sim.model.x)


def run_frames(model, frames=5, **settings):
    sim = pbd.Simulation(model, substeps=2, damping=0.1, **settings)
    for frame in range(frames):
        if frame == 1:
            sim.grab(2)
            sim.move_to((0.1, 0.2, 0.3))
        sim.step()
    return sim.state.x.numpy(), sim.state.v.numpy()


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_captured_equals_launched_one_by_one(rng, dtype):
    model = crowd_model(rng, dtype=dtype)
    for captured, launched in zip(run_frames(model), run_frames(model, capture=False), strict=True):
        np.testing.assert_array_equal(captured, launched)


def test_two_runs_are_the_same_to_the_last_bit(rng):
    if not wp.get_preferred_device().is_cpu:
        pytest.skip("float atomics of a GPU add in no fixed order")
    model = crowd_model(rng, dtype="float32")
    for first, second in zip(run_frames(model), run_frames(model), strict=True):
        assert first.tobytes() == second.tobytes()


def test_float32_and_float64_in_one_process():
    single, double = (pbd.Simulation(rope_model(dtype=dtype)) for dtype in ("float32", "float64"))
    for _ in range(5):
        single.step()
        double.step()
    assert single.state.x.dtype == wp.vec3f
    assert double.state.x.dtype == wp.vec3d
    difference = np.abs(state(single)[0] - state(double)[0]).max()
    assert 0.0 < difference < 1e-5


ROPES = {
    "jacobi": {"method": pbd.Jacobi(4)},
    "tolerance": {"method": pbd.Jacobi(50, tolerance=1e-4)},
    "chebyshev": {"method": pbd.Jacobi(20, chebyshev=0.5)},
    "gauss-seidel": {"method": pbd.GaussSeidel(4)},
    "direct": {"method": pbd.Direct(), "integrator": "midpoint4"},
    "bdf2": {"method": pbd.Direct(), "integrator": "bdf2"},
}


@pytest.mark.parametrize("settings", ROPES)
def test_after_a_reset_everything_comes_as_the_first_time(settings):
    sim = pbd.Simulation(rope_model(9), substeps=2, on_failure="continue", **ROPES[settings])

    def run():
        for frame in range(6):
            if frame == 2:
                sim.grab(8)
            if frame >= 2:
                sim.move_to((0.8, 0.1 * frame, 0.0))
            sim.step()
        return sim.state.x.numpy().tobytes(), sim.state.v.numpy().tobytes(), sim.time

    first = run()
    sim.reset()
    assert sim.time == 0.0
    np.testing.assert_array_equal(state(sim)[0], sim.model.x)
    assert run() == first


@pytest.mark.parametrize("capture", [True, False])
@pytest.mark.parametrize("settings", [*ROPES, "crowd"])
def test_a_frame_allocates_nothing(rng, capture, settings, monkeypatch):
    if settings == "crowd":
        sim = pbd.Simulation(crowd_model(rng), damping=0.1, capture=capture)
    else:
        sim = pbd.Simulation(rope_model(), capture=capture, **ROPES[settings])
    sim.step()
    made = []
    device = sim.model.device
    allocator = type(device.get_allocator())
    allocate = allocator.allocate
    monkeypatch.setattr(allocator, "allocate", lambda *args, **kw: made.append(args) or allocate(*args, **kw))
    wp.zeros(1, device=device)
    assert len(made) == 1, "the test would not notice an allocation"
    sim.step()
    assert len(made) == 1
