"""What became of a run: its figures, and the outcome that they amount to by stated thresholds."""

from __future__ import annotations

from dataclasses import dataclass, fields

from pbd_warp.step.divergence import STRETCHED

GAINED = 0.1
"""Energy gained, over what the scene has to spend: its kinetic energy at the start, and its weight (with 9.81 m/s^2
where it has none) times its size."""

LEFT = 0.5
"""Of the error that a scene starts with."""

OFF = 0.01
"""Distance from the known answer, over the scene's size."""


@dataclass(frozen=True)
class Figures:
    """What a run is judged by; nan where a scene has no such figure.

    finite: Whether all positions were, to the end. missed: Whether particles on a line passed through each other.
    energy_gain: Largest energy in the second half of the run less the energy at the start, see GAINED.
    stretch: Largest, in the second half of the run, see STRETCHED.
    left: Largest residual in the second half of the run over the one at the start, see LEFT.
    error: At the end, see OFF.
    iterations: Of the method in a step, in the mean.
    """

    finite: bool = True
    missed: bool = False
    energy_gain: float = float("nan")
    stretch: float = float("nan")
    left: float = float("nan")
    error: float = float("nan")
    iterations: float = float("nan")


NUMBERS = tuple(field.name for field in fields(Figures) if field.type == "float")

OUTCOMES = {
    "refused": "the settings are refused before the run, with a sentence that says why",
    "not finite": "a position is no longer a finite number",
    "missed": "a collision was missed: particles on a line have passed through each other",
    "gained energy": "in the second half of the run there is more energy than at the start, by more than "
    f"{100 * GAINED:.0f} % of what the scene has to spend (its kinetic energy at the start and its weight times its "
    "size)",
    "stretched": f"in the second half of the run a link is more than {100 * STRETCHED:.0f} % off its length, or two "
    "discs so much of their diameter inside each other",
    "not converged": f"in the second half of the run more than {100 * LEFT:.0f} % of the error is left that the scene "
    "starts with, or the run stopped by itself",
    "off": f"more than {100 * OFF:.0f} % of the scene's size from the known answer at the end",
    "converged": "none of these",
}
"""Every outcome and its threshold, the one that takes precedence first. A cell has exactly one of them."""


def classify(figures: Figures) -> str:
    """The first of OUTCOMES that the figures amount to (never "refused": then there was no run)."""
    amounts_to = {
        "not finite": not figures.finite,
        "missed": figures.missed,
        "gained energy": figures.energy_gain > GAINED,
        "stretched": figures.stretch > STRETCHED,
        "not converged": figures.left > LEFT,
        "off": figures.error > OFF,
    }
    return next((outcome for outcome, is_so in amounts_to.items() if is_so), "converged")
