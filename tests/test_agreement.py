"""`run --accuracy` without a chart: the steps that keep what was asked, whatever the motion makes of errors."""

import re

import numpy as np
import pytest
from models import state

import pbd_warp as pbd
from pbd_warp.accuracy import references
from pbd_warp.accuracy.agreement import agree, charted
from pbd_warp.accuracy.chart import flags, load, within
from pbd_warp.accuracy.sweep import charts_folder
from pbd_warp.errors import InputError


def random_chain(seed):
    """4 to 13 particles on a bent line of about a metre, links and masses of many sizes, one end fixed."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(4, 13))
    heading = rng.normal(size=3)
    headings = []
    for _ in range(n - 1):
        headings.append(heading / np.linalg.norm(heading))
        heading = headings[-1] + 0.5 * rng.normal(size=3)
    links = np.array(headings) * rng.uniform(0.5, 1.5, (n - 1, 1)) / (n - 1)
    x = np.vstack([np.zeros(3), np.cumsum(links, axis=0)])
    builder = pbd.ModelBuilder()
    masses = rng.uniform(0.5, 2.0, n) / n
    masses[0] = 0.0
    builder.add_particles(x, np.zeros((n, 3)), masses)
    builder.add_distances([(k, k + 1) for k in range(n - 1)])
    return builder


def after_a_second(builder):
    m = builder.finalize(dtype="float64")
    return references.chain([1.0], m.x, m.v, m.w, m.gravity, 1e-13, 1e-14)[0][-1]


def off(builder, settings, reference):
    sim = pbd.Simulation(builder.finalize(dtype="float64"), settings)
    sim.step(frames=60)
    return np.linalg.norm(state(sim)[0] - reference, axis=1).max()


@pytest.mark.parametrize("seed", range(10))
def test_the_error_is_never_above_what_was_asked_and_not_below_a_hundredth(seed):
    """Ten random chains over a second, some of which make 500 times as much of a disturbance."""
    builder = random_chain(seed)
    reference = after_a_second(builder)
    for asked in (1e-6, 1e-8):
        found = agree(pbd.Scene(builder, 61, name="random"), asked)
        error = off(builder, found.settings, reference)
        assert asked / 100.0 < error <= asked
        assert found.off <= asked
        assert found.until == 1.0


def test_what_the_motion_makes_of_it_is_what_needs_shorter_steps():
    """With the accuracy itself as `error` the first of the chains is off by more."""
    builder = random_chain(0)
    scene = pbd.Scene(builder, 61, name="random")
    assert off(builder, scene.settings.keeping(1e-8), after_a_second(builder)) > 1e-8
    assert agree(scene, 1e-8).settings.error < 0.5e-8


def test_frames_of_one_step_are_not_taken_for_agreement():
    """Of a slow pendulum one step a frame is all that either error asks for; the difference then says nothing."""
    builder = pbd.ModelBuilder()
    builder.add_rope([[0.0, 0, 0], [0.3, 0, 0]], pinned=(0,))
    scene = pbd.Scene(builder, 16, fps=15.0, name="pendulum")
    found = agree(scene, 0.5)
    sim = pbd.Simulation(builder.finalize(dtype="float64"), found.settings)
    sim.step(frames=15)
    assert sim.substeps_used == 1
    error = np.linalg.norm(sim.positions - after_a_second(builder), axis=1).max()
    assert 0.5 * error < found.off < 0.5


def test_it_says_until_when_it_holds():
    """A rope that cracks like a whip, after which no one knows where it is."""
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace([0.0, 0, 0], [1.0, 0, 0], 21), pinned=(0,))
    assert 1.0 < agree(pbd.Scene(builder, 241, name="whip"), 1e-6).until < 3.0
    assert agree(pbd.Scene(builder, 31, name="whip"), 1e-6).until == 0.5


def test_what_rounding_leaves_is_told():
    """Two runs that round alike would agree to less."""
    scene = pbd.Scene(random_chain(0), 61, name="random")
    with pytest.raises(InputError, match=r"no steps bring scene random within 2e-13 m: of rounding.* makes \S+e-1\d m"):
        agree(scene, 2e-13)


@pytest.fixture
def call(call):
    """With stdout and stderr in one line each."""

    def run(*args):
        code, *texts = call(*args)
        return code, *(" ".join(text.split()) for text in texts)

    return run


MINE = """
import numpy as np
import pbd_warp as pbd


def scene(damping: float = 0.0):
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace([0.0, 0, 0], [1.0, 0, 0], 6), pinned=(0,))
    return pbd.Scene(builder, frames=31, damping=damping, on_failure="subdivide")
"""


def test_a_scene_of_ones_own_runs_within_an_accuracy(call, tmp_path):
    (tmp_path / "mine.py").write_text(MINE)
    code, out, err = call("run", "mine.py", "--accuracy", "1e-5")
    assert code == 0, err
    flags = re.match(
        r"--accuracy 1e-05: (--integrator dop853 .* --dtype float64) \(off by \S+ m in .* all along\)", out
    )
    assert flags
    # What it says is what `run` takes.
    code, out, err = call("run", "mine.py", "--on-failure", "raise", *flags[1].split())
    assert code == 0, err


def test_a_chart_is_of_the_scene_as_it_comes(call):
    """With other parameters or settings it says nothing."""
    assert "on the chart" in call("run", "chain", "--accuracy", "1e-3", "--frames", 5)[1]
    for other in (["--set", "links=12"], ["--fps", 30]):
        assert "dop853" in call("run", "chain", "--accuracy", "1e-3", "--frames", 5, *other)[1]


def test_what_neither_a_chart_nor_the_integrator_has_is_refused(call, tmp_path):
    (tmp_path / "mine.py").write_text(MINE)
    code, _, err = call("run", "mine.py", "--accuracy", "1e-5", "--set", "damping=0.5")
    assert code == 2
    assert (
        "mine comes with no chart (pbd-warp chart makes one, and has --pick); and integrator 'dop853' does not" in err
    )
    code, _, err = call("run", "mine.py", "--accuracy", "-1")
    assert code == 2
    assert "--accuracy must be a finite number above 0" in err


def test_what_is_fastest_on_the_chart_and_known_to_fail_later_is_passed_over(call):
    """Of the chain's settings within a millimetre in the first second, the fastest crack like a whip in the next."""
    rows = load(charts_folder() / "chain.csv").rows
    scene = pbd.load_scene("chain")

    def foretold(row):
        return pbd.Simulation(scene.builder, row.apply(scene.settings)).check()

    fast = within(rows, 1e-3)
    taken = charted(scene, rows, 1e-3)
    assert taken is not None
    assert taken.position_error <= 1e-3
    assert not foretold(taken)
    assert all(foretold(row) for row in fast[: fast.index(taken)])
    code, out, err = call("run", "chain", "--accuracy", "1e-3", "--frames", 5)
    assert (code, err) == (0, "")
    assert flags(taken) in out
