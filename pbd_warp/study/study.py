"""Studies: runs of a scene over a grid of its parameters, its settings and its seeds, a row each."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from pbd_warp import check
from pbd_warp.errors import InputError, Interrupted, unknown
from pbd_warp.model.builder import DTYPES
from pbd_warp.scene import Scene, scene_function
from pbd_warp.study.grid import MOST_ROWS, make_grid
from pbd_warp.study.measures import Own, check_measures, check_possible
from pbd_warp.study.rows import Runs, lost
from pbd_warp.study.store import Store, check_libraries, columns
from pbd_warp.workers import Lost, Pool, open_pool, versions


def study(
    scene: str | Callable[..., Scene],
    grid: Mapping[str, Any],
    measures: Iterable[str | Own] = ("max_stretch", "energy"),
    *,
    seed: Sequence[int] | None = None,
    settings: Mapping[str, Any] | None = None,
    frames: int | None = None,
    dtype: str = "float32",
    device: str | None = None,
    out: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    yes: bool = False,
) -> Any:
    """Run a scene in every combination of a grid, and measure each run when it is finished.

    A run that fails is a row too, with its sentence. The rows are the same, to the last bit, whatever the number of
    workers; but for their wall time. Processes start anew on some systems: call it below `if __name__ == "__main__"`.

    Args:
        scene: A name, a file ending in .py, or a function that returns a Scene.
        grid: Values of the scene's parameters and of settings (method, iterations, fps, ...), by name.
        measures: Names (see measures.py), and functions of the finished simulation that give a number or a few.
        seed: Seeds, for a scene with something random in it.
        settings: Of all rows, by name.
        frames: Frames of each run, the initial state included; the scene's own unless given.
        out: A .parquet file. Rows are kept there as they come, and a study that was stopped goes on with the rest.
        workers: Processes on this machine; as many as it has cores unless given.
        scheduler: Address of a Dask scheduler instead.
        yes: Also for a million rows and more.

    Returns:
        A pandas.DataFrame, a row each combination in the order of the grid, the last axis fastest.

    Raises:
        InputError: an unknown parameter or measure, an empty grid, a file of another study, no such scheduler.
    """
    check_libraries()
    runs = make_runs(scene, grid, measures, seed, settings or {}, frames, dtype, device, yes)
    rows = run_study(runs, None if out is None else Path(out), lambda: open_pool(workers, scheduler))
    import pandas

    return pandas.DataFrame.from_records([rows[number] for number in sorted(rows)], columns=columns(rows))


def make_runs(
    scene: str | Callable[..., Scene],
    grid: Mapping[str, Any],
    measures: Iterable[str | Own],
    seed: Sequence[int] | None,
    settings: Mapping[str, Any],
    frames: int | None,
    dtype: str,
    device: str | None,
    yes: bool,
) -> Runs:
    """The rows that `study` is to make, checked as far as it can be without making any."""
    build = scene_function(scene) if isinstance(scene, str) else scene
    name = scene if isinstance(scene, str) else getattr(scene, "__name__", "scene")
    axes = make_grid(name, build, grid, seed)
    if len(axes) >= MOST_ROWS and not yes:
        raise InputError(f"that is {len(axes):,} combinations: say --yes (yes=True) if so many are meant")
    if dtype not in DTYPES:
        raise unknown("dtype", dtype, DTYPES)
    if frames is not None:
        check.whole("frames", frames, low=1)
    runs = Runs(name, build, axes, tuple(check_measures(measures)), dict(settings), frames, dtype, device)
    if len(axes) == 1:  # of a single row what is refused is refused at once
        check_possible(runs.measures, runs.scene(0))
    return runs


def run_study(
    runs: Runs,
    out: Path | None,
    pool: Callable[[], Any],
    advance: Callable[[int, int], object] = lambda done, of: None,
    tick: Callable[[], object] = lambda: None,
    on_pool: Callable[[Pool], object] = lambda pool: None,
) -> dict[int, dict[str, Any]]:
    """Make the rows that are missing in `out` (all, where that is None).

    Args:
        pool: Opens workers, if there is anything to be done.
        advance: Called with how many rows are done, of how many.
        tick: Called several times a second; what it raises ends the study, with what is done kept.
        on_pool: Called with the workers.

    Returns:
        All rows by number.
    """
    store = None if out is None else Store(out, _identity(runs))
    rows = store.rows if store else {}
    missing = [number for number in range(len(runs.grid)) if number not in rows]
    with ExitStack() as stack:
        if store:
            stack.callback(store.close)
        try:
            if missing:
                workers = stack.enter_context(pool())
                on_pool(workers)
                advance(len(rows), len(runs.grid))
                for number, row in workers.run(runs, missing, tick):
                    made = lost(runs, missing[number], row.deaths) if isinstance(row, Lost) else row
                    if store:
                        store.add([made])
                    rows[made["row"]] = made
                    advance(len(rows), len(runs.grid))
        except KeyboardInterrupt:
            kept = f"{len(rows)} of {len(runs.grid)} rows are in {out}" if out else ""
            raise Interrupted("interrupted", remedy="the same command goes on" if out else "", kept=kept) from None
    return rows


def _identity(runs: Runs) -> dict[str, Any]:
    """What the rows depend on, as values that JSON can hold."""
    return {
        "scene": runs.name,
        "scene's source": _digest(runs.build),
        "grid": {name: list(values) for name, values in runs.grid.axes.items()},
        "measures": [m if isinstance(m, str) else f"{m.__name__} {_digest(m)}" for m in runs.measures],
        "settings": runs.options,
        "frames": runs.frames,
        "dtype": runs.dtype,
        "pbd-warp": versions()["pbd-warp"],
    }


def _digest(function: Callable[..., Any]) -> str:
    """Of the file that a function is from, or of the function where there is no file."""
    try:
        path = inspect.getsourcefile(function)
        text = Path(path).read_bytes() if path and Path(path).is_file() else inspect.getsource(function).encode()
    except (OSError, TypeError):
        text = repr(function).encode()
    return hashlib.sha256(text).hexdigest()[:16]
