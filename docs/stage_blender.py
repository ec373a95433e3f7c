"""Draws the pictures of stages.md that are Blender's own, and checks that Blender shows what the file says.

The way of a user, without the windows: a scene, File > Export, the command, File > Import, rendered by Cycles. In an
environment of its own, with pbd-warp on the PATH:

pip install bpy==5.0.1 && python docs/stage_blender.py
"""

import math
import subprocess
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np

bpy.utils.expose_bundled_modules()
from pxr import Usd, UsdGeom  # noqa: E402 Blender's own

HERE = Path(__file__).parent
COLOURS = {"Lines": (0.8, 0.25, 0.06), "Vines": (0.08, 0.4, 0.1)}
SHOWN = (0, 12, 24)  # frames


def build() -> None:
    """Two poles, three lines between them as a curve object, vines as hair curves."""
    for x in (-4.0, 4.0):
        bpy.ops.mesh.primitive_cylinder_add(radius=0.15, depth=5.0, location=(x, 0.0, 2.5))
    lines = bpy.data.curves.new("Lines", "CURVE")
    lines.dimensions = "3D"
    for y in (-0.6, 0.0, 0.6):
        spline = lines.splines.new("BEZIER")
        spline.bezier_points.add(4)
        for k, point in enumerate(spline.bezier_points):
            part = k / 4
            point.co = (8.0 * part - 4.0, y, 4.9 + 0.5 * y - 1.2 * math.sin(math.pi * part))
            point.handle_left_type = point.handle_right_type = "AUTO"
            point.radius = 0.03  # m
    vines = bpy.data.hair_curves.new("Vines")
    vines.add_curves([20] * 6)
    for i, point in enumerate(vines.points):
        vine, k = divmod(i, 20)
        point.position = (0.3 * vine + 0.1 * k, 1.5, 4.0 + 0.3 * math.sin(0.5 * k + vine))
        point.radius = 0.02
    for name, data in (("Lines", lines), ("Vines", vines)):
        bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, data))


def material(name: str, colour: tuple[float, float, float]) -> bpy.types.Material:
    made = bpy.data.materials.new(name)
    made.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (*colour, 1.0)
    return made


def prepare() -> None:
    """A camera from the front, a light, colours."""
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("World")
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.75, 0.8, 0.88, 1.0)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (3.0, -14.0, 4.0), (math.radians(85), 0.0, math.radians(12))
    light = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    light.data.energy, light.rotation_euler = 3.0, (math.radians(50), 0.0, math.radians(30))
    for thing in (camera, light):
        scene.collection.objects.link(thing)
    scene.camera = camera
    for thing in bpy.data.objects:
        if thing.type in ("MESH", "CURVE", "CURVES"):
            thing.data.materials.clear()
            thing.data.materials.append(material(thing.name, COLOURS.get(thing.name, (0.3, 0.27, 0.24))))
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.seed = 32, True, 0
    scene.render.resolution_x, scene.render.resolution_y = 560, 340
    scene.render.image_settings.file_format, scene.render.image_settings.quality = "JPEG", 88


def picture(path: Path) -> None:
    bpy.context.scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def check(stage: Usd.Stage, frame: int) -> float:
    """How far points in Blender are from those of the file at most [m]; each curve is one that Blender reads anew."""
    graph = bpy.context.evaluated_depsgraph_get()
    off = 0.0
    for thing in bpy.data.objects:
        if thing.type != "CURVES":
            continue
        assert [modifier.type for modifier in thing.modifiers] == ["MESH_SEQUENCE_CACHE"], thing.name
        prim = next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Curves) and prim.GetName() == thing.name)
        expected = np.array(UsdGeom.PointBased(prim).GetPointsAttr().Get(frame))
        basis = UsdGeom.BasisCurves(prim)
        if basis.GetTypeAttr().Get() == "cubic" and basis.GetBasisAttr().Get() == "bezier":
            # Blender keeps handles apart from points.
            counts = UsdGeom.Curves(prim).GetCurveVertexCountsAttr().Get()
            expected = np.concatenate([part[::3] for part in np.split(expected, np.cumsum(counts)[:-1])])
        shown = np.array([point.position for point in thing.evaluated_get(graph).data.points])
        off = max(off, float(np.abs(shown - expected).max()))
    return off


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        exported, out = Path(folder) / "cables.usda", Path(folder) / "sim.usda"
        bpy.ops.wm.read_factory_settings(use_empty=True)
        build()
        prepare()
        lines = bpy.data.curves["Lines"]
        # Cycles shows no curve object without a bevel, and Blender 5.0 exports one that has a bevel twice.
        lines.bevel_depth = 1.0
        picture(HERE / "stage_exported.jpg")
        lines.bevel_depth = 0.0
        bpy.ops.wm.usd_export(filepath=str(exported))

        command = ["pbd-warp", "simulate", str(exported), "--pin", "ends", "--frames", "48", "--out", str(out)]
        subprocess.run(command, check=True)

        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.ops.wm.usd_import(filepath=str(out))
        scene, stage = bpy.context.scene, Usd.Stage.Open(str(out))
        print(f"Blender {bpy.app.version_string}: frames {scene.frame_start} to {scene.frame_end}", file=sys.stderr)
        prepare()
        for frame in SHOWN:
            scene.frame_set(frame)
            print(f"frame {frame}: off by at most {check(stage, frame):.2g} m", file=sys.stderr)
            picture(HERE / f"stage_imported_{frame}.jpg")


if __name__ == "__main__":
    main()
