"""How a scene is simulated, as a thing that can be changed while it runs, written to a file and read back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

from pbd_warp import check
from pbd_warp.errors import InputError, unknown
from pbd_warp.model.model import Model
from pbd_warp.run import make_simulation
from pbd_warp.scene import Scene
from pbd_warp.simulation import Simulation
from pbd_warp.step.constraints.parameters import check_parameters
from pbd_warp.step.integrators import INTEGRATORS
from pbd_warp.step.methods import METHODS, Direct, Method


@dataclass(frozen=True)
class Settings:
    """What may be changed while a scene runs. The names are those of Scene and ModelBuilder.

    stiffness: Of all distances, 0..1; None: as the scene has them.
    gravity: [m/s^2].
    """

    method: Method
    integrator: str
    substeps: int
    damping: float
    stiffness: float | None
    gravity: tuple[float, float, float]

    @classmethod
    def of(cls, scene: Scene) -> Settings:
        """The scene's own."""
        x, y, z = scene.builder.gravity.tolist()
        return cls(scene.method, scene.integrator, scene.substeps, scene.damping, None, (x, y, z))

    def changed(
        self, scene: Scene, *, method: str | None = None, iterations: int | None = None, **others: Any
    ) -> Settings:
        """These settings with others in their place: `method` by its name, its `iterations`, and any of the fields.

        The scene's own method comes as the scene has it. Another one begins with its defaults, but keeps the number of
        iterations, unless one of the two is `Direct`, to which the number is only a limit.

        Raises:
            InputError: an unknown method, iterations that the method refuses.
        """
        chosen = self.method
        if method is not None and method != chosen.name:
            if method not in METHODS:
                raise unknown("method", method, METHODS)
            if method == scene.method.name:
                chosen = scene.method
            elif Direct.name in (method, chosen.name):
                chosen = METHODS[method]()
            else:
                chosen = METHODS[method](iterations=chosen.iterations)
        if iterations is not None:
            chosen = replace(chosen, iterations=iterations)
        return replace(self, method=chosen, **others)

    def simulation(self, scene: Scene, model: Model) -> Simulation:
        """A simulation of a scene's model with these settings, from its initial state.

        Raises:
            InputError: what the simulation, the method or the integrator refuse.
        """
        distance = model.distance
        if self.stiffness is not None:
            stiffness = check.spread("stiffness", self.stiffness, len(distance), low=0.0, high=1.0)
            check_parameters("a distance", stiffness, distance.compliance)
            distance = replace(distance, stiffness=stiffness)
        model = replace(model, distance=distance, gravity=check.vector("gravity", self.gravity))
        changed = replace(
            scene,
            method=self.method,
            integrator=self.integrator,
            substeps=self.substeps,
            damping=self.damping,
            # A hand asks for what Newton's method does not always find: the next frame makes up for it.
            on_failure="continue" if scene.on_failure == "raise" else scene.on_failure,
        )
        return make_simulation(changed, model)

    def continued(self, sim: Simulation, scene: Scene, model: Model) -> Simulation:
        """As `simulation`, but going on from where another one is: its state, its frame, its point targets and whom it
        holds. Methods and integrators that remember the step before begin anew."""
        new = self.simulation(scene, model)
        new.take_over(sim)
        new.retried = sim.retried
        return new

    def to_json(self) -> dict[str, Any]:
        return {**vars(self), "method": {"name": self.method.name, **asdict(self.method)}}

    @classmethod
    def from_json(cls, data: Any) -> Settings:
        """Raises an InputError for what `to_json` would not have written."""
        names = [field.name for field in fields(cls)]
        if not isinstance(data, Mapping) or sorted(data) != sorted(names):
            raise InputError(f"settings must have {', '.join(names)}")
        options = dict(data["method"]) if isinstance(data["method"], Mapping) else {}
        name = options.pop("name", None)
        if not isinstance(name, str) or name not in METHODS:
            raise unknown("method", name, METHODS)
        integrator = data["integrator"]
        if not isinstance(integrator, str) or integrator not in INTEGRATORS:
            raise unknown("integrator", integrator, INTEGRATORS)
        substeps = check.whole("substeps", data["substeps"], low=1)
        try:
            method = METHODS[name](**options)
        except TypeError:
            raise InputError(f"method {name!r} does not take {', '.join(options)}") from None
        stiffness = None
        if data["stiffness"] is not None:
            stiffness = check.number("stiffness", data["stiffness"], low=0.0, high=1.0)
        x, y, z = check.vector("gravity", data["gravity"]).tolist()
        damping = check.number("damping", data["damping"], low=0.0, high=1.0)
        return cls(method, integrator, substeps, damping, stiffness, (x, y, z))
