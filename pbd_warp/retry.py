"""What "subdivide" and "fallback" of `Settings.on_failure` try with a frame that failed, in this order."""

from __future__ import annotations

from collections.abc import Iterator

from pbd_warp.settings import MOST_SUBSTEPS, Settings

DOUBLINGS = 4
""" "subdivide" goes up to 2^4 times the substeps."""

FALLBACKS = ("bdf2", "pbd")
"""Integrators that "fallback" goes through: ever more robust, ever less accurate."""


def attempts(settings: Settings) -> Iterator[tuple[str, Settings]]:
    """More robust settings, each with its name in a message; none but for the two."""
    once = settings.changed(on_failure="raise")
    if settings.on_failure == "subdivide":
        for doubling in range(1, DOUBLINGS + 1):
            substeps = min(settings.steps_a_frame * 2**doubling, MOST_SUBSTEPS)
            yield f"{substeps} substeps", once.changed(substeps=substeps)
    elif settings.on_failure == "fallback":
        own = settings.integrator
        for integrator in FALLBACKS[FALLBACKS.index(own) + 1 if own in FALLBACKS else 0 :]:
            yield f"integrator {integrator!r}", once.changed(integrator=integrator)


def tried(settings: Settings) -> str:
    """All attempts, for the message when none has helped; empty where nothing is tried."""
    if settings.on_failure not in ("subdivide", "fallback"):
        return ""
    names = ", ".join(name for name, _ in attempts(settings)) or f"nothing more robust than {FALLBACKS[-1]!r}"
    return f"tried without success: {names}"
