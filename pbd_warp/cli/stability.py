"""pbd-warp stability."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pbd_warp import check
from pbd_warp.accuracy.plot import check_picture
from pbd_warp.atomic import write_text
from pbd_warp.cli.app import command
from pbd_warp.cli.options import Debug, Scheduler, Workers
from pbd_warp.cli.terminal import interruptible, one_sentence, tell
from pbd_warp.errors import Interrupted
from pbd_warp.progress import progress_bar
from pbd_warp.scene import references
from pbd_warp.stability.atlas import measure_maps, save
from pbd_warp.stability.draw import draw
from pbd_warp.stability.maps import choose
from pbd_warp.stability.page import page
from pbd_warp.workers import open_some


@command("stability", "stability", "stability chain_length --out maps")
def stability(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[MAP or SCENE]...", help="Maps, or scenes that have some; all unless given."),
    ] = None,
    out: Annotated[Path, typer.Option(help="The folder for pictures, numbers and README.md; made if need be.")] = Path(
        "stability"
    ),
    workers: Workers = None,
    scheduler: Scheduler = None,
    debug: Debug = False,
) -> None:
    """Map where methods fail: sweep two parameters of a scene, draw what became of each run."""
    with one_sentence(debug):
        maps = choose(names or [])
        check_picture(out.parent / "map.svg")
        references()  # some maps need SciPy: better now than as refused cells
        if not out.exists():
            out.mkdir()
        check.folder(out)
        cells, done = sum(made.size for made in maps), 0
        atlas = []
        with (
            progress_bar("stability") as advance,
            interruptible() as stop_if_asked,
            open_some(workers, scheduler) as pool,
        ):

            def on_cell() -> None:
                nonlocal done
                done += 1
                advance(done, cells)

            try:
                for measured in measure_maps(maps, on_cell, pool, stop_if_asked):
                    save(measured, out / f"{measured.map.name}.csv")
                    draw(measured, out / f"{measured.map.name}.svg")
                    atlas.append(measured)
            except KeyboardInterrupt:
                kept = f"; {', '.join(m.map.name for m in atlas)} in {out}" if atlas else ""
                raise Interrupted(f"interrupted after {len(atlas)} of {len(maps)} maps{kept}") from None
        atlas.sort(key=lambda measured: maps.index(measured.map))
        write_text(out / "README.md", page(atlas))
        tell(f"{len(atlas)} maps, {cells} cells: {out / 'README.md'}")
