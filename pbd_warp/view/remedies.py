"""The remedies that a sentence names, as changes of settings: what a page shows as buttons beside it."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

from pbd_warp.settings import Settings
from pbd_warp.view.changes import in_force

_Remedy = tuple[str, Callable[[re.Match[str], Mapping[str, Any]], tuple[str, dict[str, Any]]]]

_REMEDIES: tuple[_Remedy, ...] = (
    (r"\buse '?[Dd]irect\b", lambda found, now: ("Direct", {"method": "direct"})),
    (r"\buse '?[Jj]acobi\b", lambda found, now: ("Jacobi", {"method": "jacobi"})),
    (r"\bmore (\w+s)\b", lambda found, now: _twice(found[1], now)),
    (r"\buse integrator '(\w+)'", lambda found, now: (f"Integrator {found[1]}", {"integrator": found[1]})),
    (r"\bon_failure='(subdivide)'", lambda found, now: ("Smaller steps where needed", {"on_failure": "subdivide"})),
    (r"\bmax_contacts=(\d+)", lambda found, now: (f"Room for {found[1]}", {"max_contacts": int(found[1])})),
    (r"\bgrab it exactly\b", lambda found, now: ("Grab exactly", {"grab_acceleration": None})),
    (r"\bfloat64\b", lambda found, now: ("float64", {"dtype": "float64"})),
    (r"\bdoes not model damping\b", lambda found, now: ("Damping 0", {"damping": 0.0})),
    (r"\bdoes not model stiffness below 1\b", lambda found, now: ("Stiffness 1", {"stiffness": 1.0})),
)


def _twice(name: str, now: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    return (f"{2 * now[name]} {name}", {name: 2 * now[name]}) if name in now else ("", {})


def remedies(sentence: str, now: Settings, dtype: str, wanted: Mapping[str, Any] | None = None) -> list[dict[str, Any]]:
    """Each as {"label": for a button, "changes": for a message "change"}.

    Args:
        now, dtype: What is in force; what it is already is no remedy.
        wanted: Changes that were refused with the sentence: made together with the remedy, unless that is another
            value of the same.
    """
    present = in_force(now) | {"dtype": dtype}
    found = []
    for pattern, make in _REMEDIES:
        match = re.search(pattern, sentence)
        if not match:
            continue
        label, changes = make(match, present)
        if any(present.get(name) != value for name, value in changes.items()):
            found.append({"label": label, "changes": {**(wanted or {}), **changes}})
    return found
