"""Existing USD stages: their curves simulated, the animation given back as a layer over them."""

from pbd_warp.curves.material import Material
from pbd_warp.curves.scene import StageScene, load_stage
from pbd_warp.curves.simulate import StageHooks, simulate

__all__ = ["Material", "StageHooks", "StageScene", "load_stage", "simulate"]
