"""Existing USD stages: their curves simulated, the animation given back as a layer over them."""

from pbd_warp.stage.scene import StageScene, load_stage
from pbd_warp.stage.settings import Material
from pbd_warp.stage.simulate import simulate

__all__ = ["Material", "StageScene", "load_stage", "simulate"]
