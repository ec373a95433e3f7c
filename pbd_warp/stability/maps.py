"""All maps of the atlas, by name."""

from __future__ import annotations

from collections.abc import Sequence

from pbd_warp.errors import unknown
from pbd_warp.stability.bending_map import BENDING
from pbd_warp.stability.contact_maps import COINCIDENT, CRADLE, OVERLAP, SPEED, UNREACHABLE
from pbd_warp.stability.direct_maps import CAPSTAN, LOOPS, SHORT_LINK
from pbd_warp.stability.map import Axis, Boundary, Map, Panel
from pbd_warp.stability.solver_maps import (
    CHAIN_LENGTH,
    CHEBYSHEV,
    MASS_RATIO,
    OVERCONSTRAINED,
    RELAXED,
    STAR,
    SWEEP_NUMBER,
)
from pbd_warp.stability.step_maps import DRAG, PRECISION, STEP, SWEEP_ENERGY

__all__ = ["MAPS", "Axis", "Boundary", "Map", "Panel", "choose"]

MAPS: dict[str, Map] = {
    made.name: made
    for made in (
        *(RELAXED, STAR, OVERCONSTRAINED, SWEEP_NUMBER, CHEBYSHEV, CHAIN_LENGTH, MASS_RATIO),
        *(STEP, SWEEP_ENERGY, DRAG, PRECISION, SPEED, OVERLAP, UNREACHABLE, CRADLE, COINCIDENT),
        *(CAPSTAN, SHORT_LINK, LOOPS, BENDING),
    )
}


def choose(names: Sequence[str]) -> list[Map]:
    """The maps of these names, or of these scenes; all for none. Raises InputError for a name that is neither."""
    for name in names:
        if name not in MAPS and all(made.scene != name for made in MAPS.values()):
            raise unknown("map or scene", name, dict.fromkeys([*MAPS, *(made.scene for made in MAPS.values())]))
    return [made for made in MAPS.values() if not names or made.name in names or made.scene in names]
