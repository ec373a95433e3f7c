"""How a model is simulated: one frozen set of settings, for simulations, scenes, recordings, checkpoints and charts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

from pbd_warp import check
from pbd_warp.errors import InputError, unknown
from pbd_warp.model.constraints import check_softness
from pbd_warp.model.model import Model
from pbd_warp.step.divergence import Limits
from pbd_warp.step.integrators import ESTIMATING, EXPLICIT, INTEGRATORS
from pbd_warp.step.methods import METHODS, Direct, GaussSeidel, Jacobi, Method

SHORTEST, LONGEST = 1e-9, 1e6
"""Of a frame [s]: what single precision can still count in."""

MOST_SUBSTEPS = 1_000_000
MOST_CONTACTS = 1 << 28
"""Far beyond what is of use, and below where counting in 32 bits ends."""

AUTO = "auto"
"""Of substeps: as many as `error` asks for."""

ERROR = 1e-6
"""Unless another is given [m/s]: a micrometre a second, which no picture shows and every measure can use."""

ON_FAILURE = ("raise", "continue", "subdivide", "fallback")


@dataclass(frozen=True)
class Settings:
    """Of one simulation; others come from `changed`, or `dataclasses.replace`.

    dt: Length of a frame [s].
    substeps: Steps of the paper's loop in a frame, each of dt / substeps. "auto": the integrator's estimate of its
        error chooses them, which "dop853" has.
    method: How constraints are projected; also a method's name or class, with its defaults.
    integrator: How velocity becomes position and back: "pbd", "bdf2", "midpoint" or "midpoint4"; or "dop853" and
        "rk4", which take no method and make rigid distances, springs and points move, to almost any accuracy.
    error: What steps may be off with substeps="auto", metres a second of simulated time; what the motion itself makes
        of that, where it is chaotic, comes on top. 1e-6 unless given.
    damping: k of section 3.5: the fraction of all velocity that is not rigid motion taken away in a frame, 0..1.
    drag: c of a force -c m v on each free particle [1/s]: takes all velocity, rigid motion too, as air does.
    max_contacts: Room for contacts in one step; 8 a particle and 64 more unless given.
    depenetration_speed: What is wrong with a contact or a distance when a step begins is taken back no faster than
        this [m/s]: overlapping particles part, and a rope pulled too long and let go shrinks, at this speed a
        pair. None: at once, so that they leave with the depth of the error over the step's length.
    limits: Beyond which a frame counts as diverged.
    on_failure: What becomes of a frame that diverged, or in which `Direct` did not converge. "raise": the error.
        "subdivide": the frame is made again with twice the substeps, up to 16 times as many. "fallback": it is
        made again with integrator "bdf2", then "pbd". "continue": as "raise" when it diverged, but Newton
        iterations that did not converge are only counted.
    capture: Record a frame once and replay it (a CUDA graph, or its CPU counterpart) instead of launching
        every kernel from Python.
    stiffness: Of all distances, 0..1, instead of the model's own; None: as the model has them.
    gravity: [m/s^2], instead of the model's own; None: as the model has it.
    grab_acceleration: A grabbed particle is pulled with at most this force, over the mass of all that it is joined
        to [m/s^2], so that walls, contacts and lengths win. None, and without a method: it is exactly where it is told.
    grab_speed: What is pulled follows no faster [m/s].

    Raises:
        InputError: a value outside its range, or a name that is unknown.
    """

    dt: float = 1.0 / 60.0
    substeps: int | str = 1
    method: Method = Jacobi()  # noqa: RUF009 it is frozen
    integrator: str = "pbd"
    error: float | None = None
    damping: float = 0.0
    drag: float = 0.0
    max_contacts: int | None = None
    depenetration_speed: float | None = None
    limits: Limits = Limits()  # noqa: RUF009 it is frozen
    on_failure: str = "raise"
    capture: bool = True
    stiffness: float | None = None
    gravity: tuple[float, float, float] | None = None
    grab_acceleration: float | None = None
    grab_speed: float = 10.0

    def __post_init__(self) -> None:
        def put(name: str, value: Any) -> None:
            object.__setattr__(self, name, value)

        put("dt", check.number("dt", self.dt, low=SHORTEST, high=LONGEST))
        put("method", _method(self.method))
        if self.integrator not in (*INTEGRATORS, *EXPLICIT):
            raise unknown("integrator", self.integrator, (*INTEGRATORS, *EXPLICIT))
        self._put_steps(put)
        put("damping", check.number("damping", self.damping, low=0.0, high=1.0))
        put("drag", check.number("drag", self.drag, low=0.0))
        if self.max_contacts is not None:
            put("max_contacts", check.whole("max_contacts", self.max_contacts, low=1, high=MOST_CONTACTS))
        if self.depenetration_speed is not None:
            put("depenetration_speed", check.number("depenetration_speed", self.depenetration_speed, above=0.0))
        if not isinstance(self.limits, Limits):
            raise InputError(f"limits must be a pbd_warp.Limits, not {self.limits!r}")
        if self.on_failure not in ON_FAILURE:
            raise unknown("on_failure", self.on_failure, ON_FAILURE)
        if self.stiffness is not None:
            put("stiffness", check.number("stiffness", self.stiffness, low=0.0, high=1.0))
        if self.gravity is not None:
            put("gravity", tuple(check.vector("gravity", self.gravity).tolist()))
        if self.grab_acceleration is not None:
            put("grab_acceleration", check.number("grab_acceleration", self.grab_acceleration, above=0.0))
        put("grab_speed", check.number("grab_speed", self.grab_speed, above=0.0))

    def _put_steps(self, put: Callable[[str, Any], None]) -> None:
        """Whether substeps, error, integrator and method go together."""
        if not isinstance(self.substeps, str):
            put("substeps", check.whole("substeps", self.substeps, low=1, high=MOST_SUBSTEPS))
            if self.error is not None:
                raise InputError("error is what substeps='auto' keeps: say so, or leave error out")
        elif self.substeps != AUTO:
            raise InputError(f"substeps must be a whole number or {AUTO!r}, not {self.substeps!r}")
        elif self.integrator not in ESTIMATING:
            raise InputError(
                f"substeps='auto' needs an integrator that estimates its error, {', '.join(ESTIMATING)}; "
                f"{self.integrator!r} does not"
            )
        else:
            put("error", check.number("error", ERROR if self.error is None else self.error, above=0.0))
            if self.on_failure in ("subdivide", "fallback"):
                raise InputError(f"on_failure={self.on_failure!r} needs a number of substeps, not 'auto'")
        if self.integrator in EXPLICIT and self.method != Jacobi():
            raise InputError(f"integrator {self.integrator!r} takes no method: leave it out (the default, 'jacobi')")

    @property
    def auto(self) -> bool:
        """Whether `error` chooses the steps."""
        return self.substeps == AUTO

    @property
    def steps_a_frame(self) -> int:
        """Steps in a frame; 1, the least, where they are "auto"."""
        return 1 if isinstance(self.substeps, str) else self.substeps

    @property
    def fps(self) -> float:
        """Frames a second, without the rounding of 1 / dt."""
        return float(f"{1.0 / self.dt:.15g}")

    @property
    def step_dt(self) -> float:
        """Length of a step [s], the longest where they are "auto"."""
        return self.dt / self.steps_a_frame

    def changed(self, **changes: Any) -> Settings:
        """These settings with others in their place. What another integrator does not take is left out unless it is
        given: the method with "dop853" and "rk4", "auto" and the error with what has no estimate of it; the error with
        a number of substeps.

        Raises:
            InputError: a name that is no setting, or what a setting refuses.
        """
        for name in changes:
            if name not in NAMES:
                raise unknown("setting", name, NAMES)
        to = changes.get("integrator", self.integrator)
        if to in EXPLICIT and self.integrator not in EXPLICIT:
            changes.setdefault("method", Jacobi())
        if self.auto and to not in ESTIMATING:
            changes.setdefault("substeps", 1)
        if self.auto and changes.get("substeps", AUTO) != AUTO:
            changes.setdefault("error", None)
        return replace(self, **changes)

    def keeping(self, error: float) -> Settings:
        """These settings with the explicit integrator, and the steps that keep an error [m/s]."""
        return self.changed(integrator="dop853", substeps=AUTO, error=error, on_failure="raise")

    def with_options(self, options: Mapping[str, Any]) -> Settings:
        """These settings with what the command line says instead: fps, the method by its name, iterations and
        tolerance of the method, others by their own names."""
        method = {name: options[name] for name in ("iterations", "tolerance") if name in options}
        others = {name: options[name] for name in options if name not in ("fps", "method", *method)}
        if str(others.get("substeps", "")).lstrip("-").isdecimal():
            others["substeps"] = int(others["substeps"])
        if "fps" in options:
            others["dt"] = frame_length("fps", options["fps"])
        if "method" in options or method:
            others["method"] = self.with_method(options.get("method"), **method).method
        return self.changed(**others)

    def with_method(self, name: str | None = None, **options: Any) -> Settings:
        """These settings with another method by its name, and with options of it (iterations, tolerance).

        The present method keeps what is not said; another one begins with its defaults.

        Raises:
            InputError: an unknown method, options that it refuses.
        """
        method = self.method
        if name is not None and name != method.name:
            method = _method(name)
        return replace(self, method=replace(method, **options))

    def apply(self, model: Model) -> Model:
        """The model with the gravity and the stiffness of these settings.

        Raises:
            InputError: a stiffness below 1 for distances that have a compliance.
        """
        if self.stiffness is not None:
            distance = model.distance
            stiffness = check.spread("stiffness", self.stiffness, len(distance))
            check_softness("a distance", stiffness, distance.compliance)
            model = replace(model, distance=replace(distance, stiffness=stiffness))
        if self.gravity is not None:
            model = replace(model, gravity=check.vector("gravity", self.gravity))
        return model

    def to_json(self) -> dict[str, Any]:
        """As values that JSON can hold."""
        return {
            **vars(self),
            "method": {"name": self.method.name, **asdict(self.method)},
            "limits": asdict(self.limits),
            "gravity": None if self.gravity is None else list(self.gravity),
        }

    @classmethod
    def from_json(cls, data: Any) -> Settings:
        """Raises an InputError for what `to_json` would not have written; what is newer than a file has its default."""
        if not isinstance(data, Mapping) or not set(NAMES) - set(NEWER) <= set(data) <= set(NAMES):
            raise InputError(f"settings must have {', '.join(NAMES)}")
        values = dict(data)
        options = dict(data["method"]) if isinstance(data["method"], Mapping) else {}
        method = _method(options.pop("name", None))
        if not isinstance(data["capture"], bool):
            raise InputError(f"capture must be true or false, not {data['capture']!r}")
        if not isinstance(data["integrator"], str) or not isinstance(data["on_failure"], str):
            raise InputError("integrator and on_failure must be texts")
        try:
            values["method"] = type(method)(**options)
            values["limits"] = Limits(**data["limits"])
        except TypeError:
            raise InputError(
                f"method {method.name!r} does not take {', '.join(options)}, or limits are not stretch and energy"
            ) from None
        return cls(**values)

    def __str__(self) -> str:
        steps = f"an error of {self.error:g} m/s" if self.auto else f"{self.substeps} substeps"
        method = "" if self.integrator in EXPLICIT else f"{self.method}, "
        return f"{method}integrator {self.integrator!r} and {steps}"


def frame_length(name: str, fps: Any) -> float:
    """dt [s] of so many frames a second; `name` is what they are called in an error."""
    return 1.0 / check.number(name, fps, low=1.0 / LONGEST, high=1.0 / SHORTEST)


NAMES = tuple(field.name for field in fields(Settings))
NEWER = ("drag", "grab_acceleration", "grab_speed")
"""Settings that older files do not have."""


def _method(given: Any) -> Method:
    """A method from itself, its class or its name."""
    if isinstance(given, (Jacobi, GaussSeidel, Direct)):
        return given
    name = getattr(given, "name", given)
    if not isinstance(name, str) or name not in METHODS:
        raise unknown("method", given, METHODS)
    return METHODS[name]()
