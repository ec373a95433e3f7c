"""Random small graphs with random settings: every run ends finite or in a clean, explained stop."""

import numpy as np
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st
from pxr import Usd, UsdGeom

import pbd_warp as pbd
from pbd_warp.settings import ON_FAILURE

FRAMES = 8

coordinate = st.floats(-1.0, 1.0) | st.sampled_from([0.0, 0.0, 1e6, 1e-30])  # coincident, far out, almost coincident
positive = st.floats(1e-9, 1e6) | st.sampled_from([1.0, 1e-12, 1e12])


@st.composite
def builders(draw):
    builder = pbd.ModelBuilder(gravity=draw(st.sampled_from([(0, -9.81, 0), (0, 0, 0), (0, -1e6, 0)])))
    n = draw(st.integers(1, 7))
    positions = draw(st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=n, max_size=n))
    mass = draw(st.lists(st.just(0.0) | positive, min_size=n, max_size=n))
    speed = draw(st.sampled_from([0.0, 1.0, 1e3, 1e8]))
    velocity = [(speed if m else 0.0, 0.0, 0.0) for m in mass]
    radius = draw(st.sampled_from([0.0, 0.1, 0.5]))
    builder.add_particles(positions, velocity, mass, radius)
    softness = st.sampled_from([{}, {}, {"stiffness": 0.3}, {"compliance": 1e-6}, {"compliance": 1e-12}])
    if n > 1:
        edge = st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)).filter(lambda ij: ij[0] != ij[1])
        path = st.just([(i, i + 1) for i in range(n - 1)])
        for i, j in draw(path | st.lists(edge, max_size=9)):
            builder.add_distance(i, j, draw(st.none() | st.sampled_from([0.0, 0.5, 1e3])), **draw(softness))
    for i in draw(st.lists(st.integers(0, n - 1), max_size=2)):
        builder.add_point(i, draw(st.none() | st.just((0.3, 0.2, 0.1))), **draw(softness))
    if draw(st.booleans()):
        builder.add_plane((0, -0.5, 0), (0, 1, 0), friction=0.5, restitution=0.5)
    if draw(st.booleans()):
        builder.add_sphere((0, 0, 0), 0.3)
    if radius and draw(st.booleans()):
        builder.enable_contacts(0.3, 0.5)
    return builder


iterations = st.integers(1, 6)
tolerance = st.none() | st.sampled_from([1e-12, 1e-3])
methods = st.one_of(
    st.builds(
        pbd.Jacobi,
        iterations,
        relaxation=st.sampled_from([0.3, 1.0, 1.99]),
        averaging=st.sampled_from(["mass-splitting", "valence", "none"]),
        chebyshev=st.sampled_from([None, None, 0.9, 0.9999]),
        tolerance=tolerance,
    ),
    st.builds(pbd.GaussSeidel, iterations, tolerance=tolerance),
    st.builds(pbd.Direct, iterations, tolerance=tolerance),
)
options = st.fixed_dictionaries(
    {
        "dt": st.sampled_from([1 / 60, 1.0, 1e-5]),
        "substeps": st.integers(1, 3),
        "method": methods,
        "integrator": st.sampled_from(["pbd", "pbd", "bdf2", "midpoint", "midpoint4"]),
        "damping": st.sampled_from([0.0, 0.0, 0.5, 1.0]),
        "max_contacts": st.sampled_from([None, None, 1]),
        "depenetration_speed": st.sampled_from([None, 0.5]),
        "on_failure": st.sampled_from(ON_FAILURE),
    }
)


@given(builder=builders(), options=options, dtype=st.sampled_from(["float32", "float64"]), data=st.data())
@settings(max_examples=150)
def test_every_run_ends_finite_or_says_why(tmp_path_factory, builder, options, dtype, data):
    path = tmp_path_factory.mktemp("fuzz") / "run.usda"
    try:
        model = builder.finalize(dtype=dtype)
        sim = pbd.Simulation(model, **options)
    except pbd.InputError:
        return  # what is refused is refused before it starts
    written, reason = 0, "frame: none failed"
    assert all(np.isfinite(c.severity) or c.severity == np.inf for c in sim.check())
    try:
        with pbd.UsdWriter(path, model) as writer:
            for frame in range(FRAMES):
                writer.write(sim.state)
                written += 1
                if frame == 2:
                    sim.grab(data.draw(st.integers(0, model.particle_count - 1)))
                    sim.move_to(data.draw(st.tuples(coordinate, coordinate, coordinate)))
                if frame == 5:
                    sim.release()
                sim.step()
                assert np.isfinite(sim.state.x.numpy()).all()
    except pbd.SimulationFailed as error:
        reason = str(error)
    assert "frame" in reason, "it says when"
    stage = Usd.Stage.Open(str(path))
    points = UsdGeom.Points.Get(stage, "/World/Particles").GetPointsAttr()
    assert len(points.GetTimeSamples()) == written >= 1
    for time in points.GetTimeSamples():
        assert np.isfinite(np.array(points.Get(time))).all()
    wp.synchronize()
