"""Makes gallery.md and its pictures: each program below is run, and what it shows is drawn.

    pip install '.[test]' && python docs/gallery.py

A program is one function; what the page shows of it is its own source. It returns a `Motion`, of which the picture
shows one frame, or draws with matplotlib.
"""

import inspect
import textwrap
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import warp as wp
from PIL import Image

import pbd_warp as pbd
from pbd_warp.player.render import Renderer

FOLDER = Path(__file__).parent / "gallery"
WIDTH, HEIGHT = 560, 315


def heavy_ball():
    """A rope between two points with a heavy ball in its middle."""
    builder = pbd.ModelBuilder()
    mass = np.full(41, 0.01)
    mass[20] = 2.0
    radius = np.where(mass > 1.0, 0.06, 0.012)
    builder.add_rope(
        np.linspace([-0.8, 0, 0], [0.8, 0, 0], 41), mass=mass, pinned=(0, -1), radius=radius, compliance=1e-5
    )
    return pbd.Simulation(builder, method="direct", substeps=4).run(seconds=2)


def net():
    """A net of 20 by 20 meshes, held at its corners."""
    n = 21
    x, z = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n))
    knots = np.stack([x, 0 * x, z], axis=-1).reshape(-1, 3)
    at = np.arange(n * n).reshape(n, n)
    edges = np.concatenate(
        [np.stack([at[:, :-1], at[:, 1:]], -1).reshape(-1, 2), np.stack([at[:-1], at[1:]], -1).reshape(-1, 2)]
    )
    builder = pbd.ModelBuilder()
    builder.add_graph(knots, edges, mass=0.5, pinned=at[[0, 0, -1, -1], [0, -1, 0, -1]], radius=0.012)
    return pbd.Simulation(builder, method=pbd.GaussSeidel(2), substeps=16, damping=0.02).run(seconds=1.5)


def rope_over_a_ball():
    """A rope falls over a ball and slides off."""
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace([-0.8, 0.5, 0.05], [0.9, 0.5, 0.05], 51), mass=0.3, pinned=(), radius=0.02)
    builder.add_sphere((0, 0, 0), 0.3, friction=0.3)
    builder.add_plane((0, -0.6, 0), (0, 1, 0), friction=0.5)
    builder.enable_contacts(friction=0.3)
    return pbd.Simulation(builder, method=pbd.GaussSeidel(1), substeps=20).run(seconds=1.6)


def dragged_about():
    """A chain is led in a circle by its end."""
    builder = pbd.ModelBuilder()
    chain = builder.add_rope(np.linspace([0.5, 0, 0], [0.5, -1, 0], 31), mass=0.2, pinned=(), radius=0.015)
    sim = pbd.Simulation(builder, method="direct", substeps=4)
    sim.grab(chain[0])
    frames = []
    for angle in np.linspace(0, 2 * np.pi, 150):
        sim.move_to((0.5 * np.cos(angle), 0, 0.5 * np.sin(angle)))
        sim.step()
        frames.append(sim.positions)
    return pbd.Motion.of(sim.model, frames, fps=60, title="dragged about")


def pendulum():
    """A pendulum against its equation, theta'' = -g / l sin(theta)."""
    from scipy.integrate import solve_ivp

    builder = pbd.ModelBuilder()
    builder.add_rope([(0, 0, 0), (1, 0, 0)])
    exact = solve_ivp(
        lambda t, y: (y[1], -9.81 * np.sin(y[0])), (0, 10), (np.pi / 2, 0), rtol=1e-10, atol=1e-10, dense_output=True
    )
    for integrator in ("pbd", "bdf2", "midpoint4"):
        motion = pbd.Simulation(
            builder.finalize(dtype="float64"), method="direct", integrator=integrator, substeps=4
        ).run(10)
        time = np.arange(motion.frame_count) / motion.fps
        angle = np.arctan2(motion.positions[:, 1, 0], -motion.positions[:, 1, 1])
        plt.semilogy(time[1:], np.abs(angle - exact.sol(time)[0])[1:], label=integrator)
    plt.xlabel("time [s]")
    plt.ylabel("error of the angle [rad]")
    plt.legend()


def tension():
    """The tension along a chain that has just been let go: nothing at its end, most at the hook."""
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace([0, 0, 0], [1, 0, 0], 51), mass=1.0, radius=0.01)
    sim = pbd.Simulation(builder, method="direct", integrator="midpoint", substeps=8)
    for _ in range(3):
        sim.run(frames=10)
        plt.plot(np.linspace(0, 1, 50), sim.tension, label=f"after {sim.time:.2f} s")
    plt.xlabel("way along the chain [m]")
    plt.ylabel("tension [N]")
    plt.legend()


def sweep():
    """A sweep: how far a rope stretches, by substeps, at one iteration a substep."""
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace([0, 0, 0], [1, 0, 0], 31), mass=0.2)
    substeps = [2, 4, 8, 16, 32, 64]
    for method in (pbd.Jacobi(1), pbd.GaussSeidel(1)):
        stretch = []
        for count in substeps:
            sim = pbd.Simulation(builder, method=method, substeps=count)
            sim.run(seconds=1)
            stretch.append(100 * pbd.measure(sim).max_stretch)
        plt.loglog(substeps, stretch, "o-", label=method.name)
    plt.xticks(substeps, substeps)
    plt.minorticks_off()
    plt.xlabel("substeps of a frame")
    plt.ylabel("largest stretch after 1 s [%]")
    plt.legend()


def catenary():
    """A chain hangs between two hooks, heavier on its right half."""
    builder = pbd.ModelBuilder()
    x = np.linspace(-0.5, 0.5, 41)
    mass = np.where(x > 0, 0.05, 0.01)
    positions = np.stack([x, -1.2 * (0.25 - x**2), 0 * x], axis=1)
    builder.add_rope(positions, mass=mass, pinned=(0, -1), radius=np.where(x > 0, 0.014, 0.008))
    return pbd.Simulation(builder, method="direct", substeps=4, damping=0.2).run(seconds=3)


def billiards():
    """Fifteen balls and the one that hits them; no gravity."""
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    rack = [(0.11 * row, 0.126 * (k - row / 2), 0) for row in range(5) for k in range(row + 1)]
    builder.add_particles(rack, radius=0.06)
    builder.add_particle((-1.2, 0.01, 0), velocity=(4, 0, 0), radius=0.06)
    builder.enable_contacts(restitution=0.95)
    return pbd.Simulation(builder, method=pbd.Jacobi(10), substeps=16).run(seconds=0.8)


def pile():
    """Balls of three sizes fall into a box."""
    random = np.random.default_rng(1)
    builder = pbd.ModelBuilder()
    places = [(x, y, z) for y in range(6) for x in range(4) for z in range(4)]
    positions = 0.2 * np.array(places) + random.uniform(-0.02, 0.02, (len(places), 3))
    builder.add_particles(positions, radius=random.choice([0.05, 0.07, 0.085], len(places)))
    for point, normal in (
        ((0, -0.2, 0), (0, 1, 0)),
        ((-0.2, 0, 0), (1, 0, 0)),
        ((0.8, 0, 0), (-1, 0, 0)),
        ((0, 0, -0.2), (0, 0, 1)),
        ((0, 0, 0.8), (0, 0, -1)),
    ):
        builder.add_plane(point, normal, friction=0.4)
    builder.enable_contacts(friction=0.4)
    return pbd.Simulation(builder, method=pbd.GaussSeidel(4), substeps=8).run(seconds=1.5)


def tree():
    """A tree of strings, each knot of which carries two more, is let go and falls into place."""
    builder = pbd.ModelBuilder(gravity=(0, -1, 0))
    points, edges = [(0.0, 0.0, 0.0)], []
    for level in range(6):
        for parent in range(2**level - 1, 2 ** (level + 1) - 1):
            for side in (-1, 1):
                x, y, z = points[parent]
                edges.append((parent, len(points)))
                points.append((x + side * 0.5**level, y - 0.35, z + 0.1 * side * (level % 2)))
    builder.add_graph(points, edges, mass=1.0, pinned=(0,), radius=0.02)
    return pbd.Simulation(builder, method=pbd.GaussSeidel(2), substeps=16).run(seconds=2.5)


def elastic():
    """The same rope with three compliances [m/N], 1 kg at each end."""
    builder = pbd.ModelBuilder()
    for x, compliance in ((-0.5, 0.0), (0, 1e-3), (0.5, 3e-3)):
        mass = np.full(21, 0.01)
        mass[-1] = 1.0
        radius = np.where(mass == 1.0, 0.05, 0.01)
        builder.add_rope(np.linspace([x, 0, 0], [x, -1, 0], 21), mass=mass, radius=radius, compliance=compliance)
    return pbd.Simulation(builder, method="direct", substeps=4, damping=0.1).run(seconds=3)


PROGRAMS = (
    heavy_ball, net, rope_over_a_ball, dragged_about, catenary, elastic, billiards, pile, tree,
    pendulum, tension, sweep,
)  # fmt: skip

SHOWN = {rope_over_a_ball: 0.45, billiards: 0.75, tree: 0.6, net: 0.9, dragged_about: 0.7}
"""Where in the motion, of 0 to 1, the picture is taken; its end unless given."""


def picture(program) -> str:
    """Run a program and save what it shows; the name of the file."""
    plt.figure(figsize=(5.6, 3.15), dpi=100)
    motion, name = program(), f"{program.__name__}.png"
    if motion is None:
        plt.grid(alpha=0.3)
        plt.tight_layout()
        plt.savefig(FOLDER / name, metadata={"Software": None})
    else:
        frame = motion.positions[int(SHOWN.get(program, 1.0) * (motion.frame_count - 1))]
        drawn = Renderer(motion.drawn, motion.drawn.around(frame[None]), 2 * WIDTH, 2 * HEIGHT).draw(frame)
        small = Image.fromarray(drawn).resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS)
        small.quantize(255, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE).save(FOLDER / name, optimize=True)
    plt.close()
    return name


def source(program) -> str:
    """What a program does, without its name and docstring."""
    lines = textwrap.dedent(inspect.getsource(program).partition('"""')[2].partition('"""\n')[2]).rstrip()
    return lines.replace("return pbd.", "motion = pbd.")


def main() -> None:
    wp.config.log_level = wp.LOG_ERROR
    page = [
        "# Gallery\n\nShort programs, each with what it shows; made by `python docs/gallery.py`. All begin with\n\n"
        "```python\nimport matplotlib.pyplot as plt\nimport numpy as np\nimport pbd_warp as pbd\n```\n\n"
        'A `motion` shows itself in Jupyter, `motion.show()` opens it in the browser, and `motion.save("it.html")`\n'
        "(`.mp4`, `.gif`) keeps it."
    ]
    for program in PROGRAMS:
        title = " ".join(program.__doc__.split()).rstrip(".")
        page.append(f"## {title}\n\n![{title}](gallery/{picture(program)})\n\n```python\n{source(program)}\n```")
    (FOLDER.parent / "gallery.md").write_text("\n\n".join(page) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
