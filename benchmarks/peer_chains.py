"""The same chain in other simulators: particles in a row, joined by rigid links, the first one fixed.

Each peer is a function of a model (of ours: positions, masses, lengths, gravity) that gives its families of settings.
A family makes, for a number of steps a frame, a call that simulates a second from the start and returns the seconds
it took and the positions, [particle_count, 3]. Python is in a peer's loop only where its own interface needs it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

import pbd_warp as pbd

FPS = 60
AUTO = "dop853, auto"
"""Its "steps" are the digits of the error that it is asked to keep."""

Run = Callable[[], tuple[float, np.ndarray]]
Families = dict[str, Callable[[int], Run]]

POINT, POINT_FLOAT32 = 1e-12, 1e-6
"""Moment of inertia of what stands for a point mass, over its mass and the square of its link: it is also what the
motion is off by, relative, so it must be below the errors to be measured."""


def ours(model: pbd.Model) -> Families:
    """All frames in one call."""

    def family(**settings: Any) -> Callable[[int], Run]:
        def make(steps: int) -> Run:
            chosen = {"substeps": steps, **settings}
            if settings.get("substeps") == "auto":
                chosen["error"] = 10.0**-steps
            sim = pbd.Simulation(model, dt=1.0 / FPS, on_failure="continue", limits=pbd.Limits(stretch=None), **chosen)

            def run() -> tuple[float, np.ndarray]:
                sim.reset()
                start = time.perf_counter()
                sim.step(frames=FPS)
                return time.perf_counter() - start, sim.state.x.numpy().copy()

            return run

        return make

    return {
        AUTO: family(integrator="dop853", substeps="auto"),
        "dop853": family(integrator="dop853"),
        "rk4": family(integrator="rk4"),
        "direct, midpoint4": family(integrator="midpoint4", method=pbd.Direct()),
        **{
            f"gauss-seidel, 1 iteration, {integrator}": family(
                integrator=integrator, method=pbd.GaussSeidel(iterations=1)
            )
            for integrator in ("midpoint", "bdf2", "pbd")
        },
    }


def mujoco(model: pbd.Model) -> Families:
    """Nested bodies of one point mass each; hinges where the motion is plane, balls where it need not be."""
    import mujoco as mj

    links = np.diff(model.x, axis=0)
    # Motion does not depend on the unit of mass, but MuJoCo refuses moments of inertia below 1e-15.
    unit = max(model.w[k + 1] / float(d @ d) for k, d in enumerate(links))
    mj.set_mju_user_warning(lambda text: None)  # which it would write to a file here; they are counted below

    def body(k: int, joint: str) -> str:
        if k == len(links):
            return ""
        d, m = links[k], float(unit / model.w[k + 1])
        inertia = POINT * m * float(d @ d)
        at = np.zeros(3) if k == 0 else links[k - 1]
        return (
            f'<body pos="{_numbers(at)}">{joint}<inertial pos="{_numbers(d)}" mass="{m!r}" '
            f'diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>{body(k + 1, joint)}</body>'
        )

    def family(joint: str, integrator: str) -> Callable[[int], Run]:
        def make(steps: int) -> Run:
            m = mj.MjModel.from_xml_string(
                f'<mujoco><option timestep="{1.0 / (FPS * steps)!r}" integrator="{integrator}" '
                f'gravity="{_numbers(model.gravity)}"><flag contact="disable" constraint="disable"/></option>'
                f'<worldbody><body pos="{_numbers(model.x[0])}">{body(0, joint)}</body></worldbody></mujoco>'
            )
            data = mj.MjData(m)

            def run() -> tuple[float, np.ndarray]:
                mj.mj_resetData(m, data)
                start = time.perf_counter()
                mj.mj_step(m, data, FPS * steps)
                took = time.perf_counter() - start
                if any(data.warning[k].number for k in range(len(data.warning))):
                    raise FloatingPointError("it warned and began anew")
                mj.mj_kinematics(m, data)
                mj.mj_comPos(m, data)
                return took, np.vstack([model.x[:1], data.xipos[2:]])

            return run

        return make

    joints = {"ball": '<joint type="ball"/>'}
    if not np.any(links[:, 2]):
        joints = {"hinge": '<joint type="hinge" axis="0 0 1"/>', **joints}
    return {
        f"{name}, {integrator}": family(joint, integrator)
        for name, joint in joints.items()
        for integrator in ("RK4", "Euler", "implicitfast")
    }


def newton(model: pbd.Model) -> Families:
    """In float32, all it has: XPBD on particles (stiff springs) and on hinged bodies, Featherstone's on hinges.

    Its frames are captured graphs. Bodies of hardly any inertia, as point masses are, are not what XPBD is made for,
    but it has nothing else that keeps links rigid. On particles it adds up what its springs ask of each, and takes no
    relaxation for that.
    """
    import newton as nt
    import warp as wp

    mass = [1.0 / float(w) if w > 0.0 else 0.0 for w in model.w]
    links = np.diff(model.x, axis=0)

    def particles() -> Any:
        b = nt.ModelBuilder(up_axis=nt.Axis.Y, gravity=tuple(map(float, model.gravity)))
        for x, m in zip(model.x, mass, strict=True):
            b.add_particle(wp.vec3(*x), wp.vec3(), m)
        for k in range(len(links)):
            b.add_spring(k, k + 1, 1e12, 0.0, 0.0)
        return b

    def hinges() -> Any:
        b = nt.ModelBuilder(up_axis=nt.Axis.Y, gravity=tuple(map(float, model.gravity)))
        joints, before = [], -1
        for k, d in enumerate(links):
            inertia = wp.mat33(np.eye(3) * POINT_FLOAT32 * mass[k + 1] * float(d @ d))
            placed = wp.transform(wp.vec3(*model.x[k]), wp.quat_identity())
            link = b.add_link(xform=placed, com=wp.vec3(*d), mass=mass[k + 1], inertia=inertia, lock_inertia=True)
            at = wp.transform(wp.vec3(*(model.x[0] if k == 0 else links[k - 1])), wp.quat_identity())
            joints.append(b.add_joint_revolute(before, link, parent_xform=at, axis=wp.vec3(0.0, 0.0, 1.0)))
            before = link
        b.add_articulation(joints)
        return b

    def family(build: Callable[[], Any], solver_of: Callable[[Any], Any], kind: str) -> Callable[[int], Run]:
        def make(steps: int) -> Run:
            m = build().finalize(device=model.device)
            m.particle_max_velocity = 1e9  # not the scene's business
            solver, a, b, first, control = solver_of(m), m.state(), m.state(), m.state(), m.control()
            names = [f"{kind}_q", f"{kind}_qd"]
            if kind == "body":
                names += ["joint_q", "joint_qd"]
                nt.eval_fk(m, m.joint_q, m.joint_qd, first)

            def step(before: Any, after: Any) -> None:
                before.clear_forces()
                solver.step(before, after, control, None, 1.0 / (FPS * steps))

            pairs = max(steps, 2) // 2  # of steps: a frame, or two where a frame is one step
            with wp.ScopedCapture(device=model.device) as capture:
                for _ in range(pairs):
                    step(a, b)
                    step(b, a)

            def run() -> tuple[float, np.ndarray]:
                for name in names:
                    wp.copy(getattr(a, name), getattr(first, name))
                start = time.perf_counter()
                for _ in range(FPS * steps // (2 * pairs)):
                    wp.capture_launch(capture.graph)
                wp.synchronize()
                took = time.perf_counter() - start
                if kind == "particle":
                    return took, a.particle_q.numpy().astype(float)
                poses = zip(a.body_q.numpy(), m.body_com.numpy(), strict=True)
                ends = [wp.transform_point(wp.transform(*q), wp.vec3(*com)) for q, com in poses]
                return took, np.vstack([model.x[:1], np.array(ends, dtype=float)])

            return run

        return make

    families = {}
    for i in (1, 4, 16):

        def xpbd(m: Any, iterations: int = i) -> Any:
            return nt.solvers.SolverXPBD(m, iterations=iterations)

        families[f"XPBD on particles, {i} iterations"] = family(particles, xpbd, "particle")
        families[f"XPBD on hinges, {i} iterations"] = family(hinges, xpbd, "body")
    families["Featherstone"] = family(hinges, lambda m: nt.solvers.SolverFeatherstone(m, angular_damping=0.0), "body")
    return families


def pypbd(model: pbd.Model) -> Families:
    """Distances of XPBD in float64, a colour after the other; a frame is one call.

    Its second-order velocities are swept like the first, although they make what falls freely fall at 2 g: with
    (3 d_n - d_{n-1}) / 2h for the velocity and h v + h^2 g for the next d, the acceleration a has a = a / 2 + g.
    """
    import pypbd as pp

    control = pp.TimeStepController

    def family(iterations: int, order: str) -> Callable[[int], Run]:
        def make(steps: int) -> Run:
            def run() -> tuple[float, np.ndarray]:
                simulation = pp.Simulation.getCurrent()
                simulation.initDefault()
                pp.TimeManager.getCurrent().setTimeStepSize(1.0 / FPS)
                chain, controller = simulation.getModel(), simulation.getTimeStep()
                controller.setValueUInt(control.NUM_SUB_STEPS, steps)
                controller.setValueUInt(control.MAX_ITERATIONS, iterations)
                # Its constants have their values only now.
                controller.setValueInt(control.VELOCITY_UPDATE_METHOD, getattr(control, order))
                particles = chain.getParticles()
                for k, (x, w) in enumerate(zip(model.x, model.w, strict=True)):
                    particles.addVertex(x)
                    particles.setMass(k, 1.0 / w if w > 0.0 else 0.0)
                for k in range(model.particle_count - 1):
                    chain.addDistanceConstraint_XPBD(k, k + 1, 0.0)
                start = time.perf_counter()
                for _ in range(FPS):
                    controller.step(chain)
                took = time.perf_counter() - start
                return took, np.array([particles.getPosition(k) for k in range(model.particle_count)])

            return run

        return make

    orders = {"first": "ENUM_VUPDATE_FIRST_ORDER", "second": "ENUM_VUPDATE_SECOND_ORDER"}
    return {f"XPBD, {i} iterations, {name} order": family(i, o) for i in (1, 4, 16) for name, o in orders.items()}


def pyelastica(model: pbd.Model) -> Families:
    """Its rods stretch, bend and shear, and its rigid bodies are joined by springs: nothing in it keeps a length."""
    import elastica  # noqa: F401

    raise NotImplementedError("has no rigid links: its joints and rods are springs")


PEERS = {"pbd-warp": ours, "mujoco": mujoco, "newton": newton, "pypbd": pypbd, "pyelastica": pyelastica}


def _numbers(values: np.ndarray) -> str:
    return " ".join(repr(float(v)) for v in values)
