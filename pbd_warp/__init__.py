"""Position-based dynamics on NVIDIA Warp."""

from pbd_warp.builder import ModelBuilder
from pbd_warp.cautions import Caution
from pbd_warp.drag import Drag
from pbd_warp.errors import InputError, PbdError, SimulationFailed
from pbd_warp.measure import Measures, measure
from pbd_warp.methods import Direct, GaussSeidel, Jacobi
from pbd_warp.model import Model, State
from pbd_warp.scene import Scene, load_scene, scene_names
from pbd_warp.simulation import Simulation
from pbd_warp.usd import UsdWriter
from pbd_warp.version import __version__
from pbd_warp.watch import Limits

__all__ = [
    "Caution",
    "Direct",
    "Drag",
    "GaussSeidel",
    "InputError",
    "Jacobi",
    "Limits",
    "Measures",
    "Model",
    "ModelBuilder",
    "PbdError",
    "Scene",
    "Simulation",
    "SimulationFailed",
    "State",
    "UsdWriter",
    "__version__",
    "load_scene",
    "measure",
    "scene_names",
]
