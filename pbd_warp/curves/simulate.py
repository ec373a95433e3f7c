"""Simulates the curves of a stage, from its first frame to its last."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType

import numpy as np

from pbd_warp.curves.layer import animated_attributes, flattened, layer_files, override_layer
from pbd_warp.curves.playback import Playback
from pbd_warp.curves.scene import StageScene
from pbd_warp.errors import SimulationFailed
from pbd_warp.figures import RunStats, provenance
from pbd_warp.identity import Identity, digest_of_files
from pbd_warp.model.model import State
from pbd_warp.paths import animation_files, check_apart
from pbd_warp.run import Hooks, check_keeps_forces, make_frames, tell_cost
from pbd_warp.simulation import Simulation
from pbd_warp.usd.animation import Animation
from pbd_warp.usd.writer import check_path


@dataclass(frozen=True)
class StageHooks(Hooks):
    """What the simulation of a stage tells besides.

    on_note: Called with a sentence on what came out otherwise than one would expect.
    on_phase: Called with "solving" and "writing" whenever one of the two begins.
    """

    on_note: Callable[[str], object] = lambda text: None
    on_phase: Callable[[str], object] = lambda phase: None


def simulate(
    source: StageScene,
    out: Path,
    flatten: bool = False,
    hooks: Hooks = StageHooks(),
    strict: bool = False,
    tension: bool = False,
) -> RunStats:
    """Simulate a stage's curves and write them as a layer over it: the first frame is as the stage has it.

    Where some curves fail, the others are simulated again without them, unless there are checkpoints; those stay as
    they are in the input, and a note names them.

    Args:
        flatten: One self-contained file instead.
        strict: Fail where some curves do.
        tension: Write `primvars:tension` of the curves too [N], "varying".

    Raises:
        InputError: before anything is simulated or written.
        SimulationFailed: the frames so far are kept (see Animation).
    """
    out = check_path(out)
    check_apart({"the stage": layer_files(source.stage)}, {"the output": animation_files(out)})
    told = hooks if isinstance(hooks, StageHooks) else StageHooks(**vars(hooks))
    may_leave = not strict and hooks.checkpoints is None
    if tension:
        check_keeps_forces(source.scene.settings)
    while True:
        attempt = _Attempt(source, out, flatten, told, may_leave, tension)
        try:
            return attempt.run()
        except SimulationFailed as error:
            sentence = attempt.playback.in_words(str(error))
            if not attempt.given_up:
                raise SimulationFailed(sentence) from error
            source = source.without({path: dict.fromkeys(found, sentence) for path, found in attempt.failed.items()})
            for path, found in attempt.failed.items():
                more = f" and {len(found) - 1} more" if len(found) > 1 else ""
                told.on_note(
                    f"curve {min(found)}{more} of {path} left as in the input, as the simulation failed: {sentence}"
                )


class _Attempt:
    """One run; writes its frames (see `Writer`).

    Attributes:
        tension: Whether it writes tensions.
        failed: The curves with which it failed, by path of the prim.
        given_up: Whether it has removed what it wrote, as the others can be simulated without those.
    """

    def __init__(self, source: StageScene, out: Path, flatten: bool, hooks: StageHooks, may_leave: bool, tension: bool):
        self.tension = tension
        self._source = source
        self._out = out
        self._hooks = hooks
        self._may_leave = may_leave
        self._scene = source.scene.changed(frames=source.timeline.frames, dt=1.0 / source.timeline.fps)
        model = self._scene.builder.finalize(source.device, source.dtype)
        tell_cost(model, self._scene.settings, hooks)
        self._sim = Simulation(model, self._scene.settings)
        self.playback = Playback(source, model)
        made_by = provenance(self._scene, model)
        self._stage = flattened(source, made_by, tension) if flatten else override_layer(source, out, made_by)
        self.failed: dict[str, set[int]] = {}
        self.given_up = False

    def run(self) -> RunStats:
        def warn(warning: object) -> None:
            hooks.on_warning(replace(warning, text=self.playback.in_words(warning.text)))  # type: ignore

        hooks = self._hooks
        told = Hooks(hooks.on_frame, hooks.on_start, warn, hooks.checkpoints)
        time = self._source.timeline
        paths = [curves.path for curves in self._source.curves]
        said = [paths, time.start, time.fps, time.time_codes_per_second, *(["tension"] if self.tension else [])]
        stage = digest_of_files(layer_files(self._source.stage), said)
        result = make_frames(self._scene, self._sim, self.playback, self._open, self._out, told, stage)
        if not self.playback.moved:
            hooks.on_note(f"nothing moved: {self.playback.why_still()}")
        if result.unconverged:
            worst = self.playback.least_converged(self._sim)
            hooks.on_note(
                f"{result.unconverged} solutions did not converge{worst}; links were stretched by at most "
                f"{100 * result.max_stretch:.2g} %; on_failure='subdivide' makes such frames again"
            )
        return result

    def _open(self, resume: int | None, identity: Identity) -> _Attempt:
        attributes = animated_attributes(self._stage, self._source, self.tension)
        self._animation = Animation(self._out, self._stage, attributes, resume, identity=identity)
        return self

    def write(self, state: State, tension: np.ndarray | None = None) -> None:
        self._hooks.on_phase("writing")
        frame = self.frames
        self._animation.write(self.playback.frame(frame, state, tension), self.playback.time_code(frame))
        self._hooks.on_phase("solving")

    def flush(self) -> None:
        self._animation.flush()

    @property
    def frames(self) -> int:
        return self._animation.frames

    @property
    def saved(self) -> Path | None:
        return self._animation.saved

    def __enter__(self) -> _Attempt:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._hooks.on_phase("writing")
        if isinstance(error, SimulationFailed) and self._may_leave:
            self.failed = self.playback.failed(self._sim)
            simulated = {curves.path: int((curves.sampling.sample_counts > 0).sum()) for curves in self._source.curves}
            self.given_up = bool(self.failed) and any(
                count > len(self.failed.get(path, ())) for path, count in simulated.items()
            )
        if self.given_up:
            self._animation.discard()
        else:
            self._animation.__exit__(kind, error, trace)
