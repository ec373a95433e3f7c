"""Position-based dynamics on NVIDIA Warp."""

from pbd_warp.errors import InputError, PbdError, SimulationFailed
from pbd_warp.grab.drag import Drag
from pbd_warp.measure import CopyMeasures, Measures, measure, measure_copies
from pbd_warp.model.builder import ModelBuilder
from pbd_warp.model.model import Model, State
from pbd_warp.model.section import RoundSection
from pbd_warp.player.motion import Motion
from pbd_warp.preflight import PreflightWarning
from pbd_warp.scene import Scene, load_scene, scene_names
from pbd_warp.settings import Settings
from pbd_warp.show import show
from pbd_warp.simulation import Simulation
from pbd_warp.step.divergence import Limits
from pbd_warp.step.methods import Direct, GaussSeidel, Jacobi
from pbd_warp.study.study import study
from pbd_warp.topology import linking_number, writhe
from pbd_warp.usd.writer import UsdWriter
from pbd_warp.version import __version__

__all__ = [
    "CopyMeasures",
    "Direct",
    "Drag",
    "GaussSeidel",
    "InputError",
    "Jacobi",
    "Limits",
    "Measures",
    "Model",
    "ModelBuilder",
    "Motion",
    "PbdError",
    "PreflightWarning",
    "RoundSection",
    "Scene",
    "Settings",
    "Simulation",
    "SimulationFailed",
    "State",
    "UsdWriter",
    "__version__",
    "linking_number",
    "load_scene",
    "measure",
    "measure_copies",
    "scene_names",
    "show",
    "study",
    "writhe",
]


def __dir__() -> list[str]:
    """What users need; the modules are there all the same."""
    return __all__
