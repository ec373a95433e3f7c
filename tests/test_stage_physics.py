"""UsdPhysics: densities, friction and restitution of bound materials, gravity of the scene, units."""

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, UsdShade
from stages import add_curves, line, new_stage

import pbd_warp as pbd
from pbd_warp.curves import Material, load_stage

BULK = np.pi / 4 * 0.02**2 * 0.2  # of a link of the curve [m^3]


def stage_with_material(path, metres=1.0, kilograms=1.0, density=700.0):
    """A curve 1 m long, 20 mm thick, whatever the units, and a physics material of a density in SI units."""
    stage = new_stage(path, metres=metres)
    UsdPhysics.SetStageKilogramsPerUnit(stage, kilograms)
    add_curves(stage, "/World/C", line(6) / metres, width=0.02 / metres)
    material = UsdShade.Material.Define(stage, "/World/Rubber")
    physics = UsdPhysics.MaterialAPI.Apply(material.GetPrim())
    physics.CreateDensityAttr(density * metres**3 / kilograms)
    physics.CreateDynamicFrictionAttr(0.7)
    physics.CreateRestitutionAttr(0.25)
    return stage, material


def bind(prim, material):
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material, UsdShade.Tokens.weakerThanDescendants, "physics")


def density(path, **options):
    """Of the curve, from the mass of its last point but one."""
    model = load_stage(path, **options).scene.builder.finalize()
    return 1.0 / model.w[-2] / BULK


def to_the_prim(stage, material):
    bind(stage.GetPrimAtPath("/World/C"), material)


def above(stage, material):
    bind(stage.GetPrimAtPath("/World"), material)


def through_a_collection(stage, material):
    world = stage.GetPrimAtPath("/World")
    collection = Usd.CollectionAPI.Apply(world, "ropes")
    collection.CreateIncludesRel().AddTarget("/World/C")
    api = UsdShade.MaterialBindingAPI.Apply(world)
    api.Bind(collection, material, "ropes", UsdShade.Tokens.weakerThanDescendants, "physics")


def for_all_purposes(stage, material):
    UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath("/World/C")).Bind(material)


@pytest.mark.parametrize("binding", [to_the_prim, above, through_a_collection, for_all_purposes])
@pytest.mark.parametrize(("metres", "kilograms"), [(1.0, 1.0), (0.01, 1.0), (0.01, 0.001)])
def test_density_of_a_bound_material(tmp_path, binding, metres, kilograms):
    stage, material = stage_with_material(tmp_path / "a.usda", metres, kilograms)
    binding(stage, material)
    stage.Save()
    assert density(tmp_path / "a.usda") == pytest.approx(700.0, rel=1e-4)
    assert density(tmp_path / "a.usda", material=Material(density=50.0)) == pytest.approx(50.0, rel=1e-4)
    prim = stage.GetPrimAtPath("/World/C")
    UsdPhysics.MassAPI.Apply(prim).CreateDensityAttr(300.0 * metres**3 / kilograms)
    stage.Save()
    assert density(tmp_path / "a.usda") == pytest.approx(300.0, rel=1e-4)
    prim.CreateAttribute("pbd:density", Sdf.ValueTypeNames.Float).Set(200.0)
    stage.Save()
    assert density(tmp_path / "a.usda") == pytest.approx(200.0, rel=1e-4)


def test_a_material_without_a_density_or_of_another_purpose_says_nothing(tmp_path):
    stage, material = stage_with_material(tmp_path / "a.usda", density=0.0)
    bind(stage.GetPrimAtPath("/World/C"), material)
    stage.Save()
    assert density(tmp_path / "a.usda") == pytest.approx(1000.0, rel=1e-4)
    stage, material = stage_with_material(tmp_path / "b.usda")
    UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath("/World/C")).Bind(material, materialPurpose="preview")
    stage.Save()
    assert density(tmp_path / "b.usda") == pytest.approx(1000.0, rel=1e-4)


def test_friction_and_restitution_of_a_collider(tmp_path):
    stage, material = stage_with_material(tmp_path / "a.usda")
    for name in ("Bound", "Own", "Bare"):
        plane = UsdGeom.Plane.Define(stage, f"/World/Set/{name}").GetPrim()
        if name != "Bare":
            bind(plane, material)
        if name == "Own":
            plane.CreateAttribute("pbd:friction", Sdf.ValueTypeNames.Float).Set(0.0)
    stage.Save()
    colliders = load_stage(tmp_path / "a.usda", collide=["/World/Set"]).scene.builder.finalize().colliders
    np.testing.assert_allclose(colliders.friction, [0.7, 0.0, 0.0], rtol=1e-6)
    np.testing.assert_allclose(colliders.restitution, [0.25, 0.25, 0.0], rtol=1e-6)


@pytest.mark.parametrize(
    ("up", "metres", "direction", "magnitude", "expected"),
    [
        ("Y", 1.0, None, None, (0, -9.81, 0)),
        ("Z", 0.01, None, None, (0, 0, -9.81)),
        ("Y", 1.0, None, 1.62, (0, -1.62, 0)),
        ("Y", 0.01, None, 162.0, (0, -1.62, 0)),
        ("Y", 0.01, (3, 0, 4), 500.0, (3, 0, 4)),
        ("Z", 1.0, (0, 0, 0), 0.0, (0, 0, 0)),
        ("Z", 1.0, (0, 2, 0), -1.0, (0, 9.81, 0)),
    ],
)
def test_gravity_of_the_physics_scene(tmp_path, up, metres, direction, magnitude, expected):
    stage = new_stage(tmp_path / "a.usda", up=up, metres=metres)
    add_curves(stage, "/World/C", line())
    scene = UsdPhysics.Scene.Define(stage, "/World/Physics")
    if direction is not None:
        scene.CreateGravityDirectionAttr(Gf.Vec3f(*direction))
    if magnitude is not None:
        scene.CreateGravityMagnitudeAttr(magnitude)
    stage.Save()
    source = load_stage(tmp_path / "a.usda")
    np.testing.assert_allclose(source.scene.builder.finalize().gravity, expected, rtol=1e-6, atol=1e-12)
    said = load_stage(tmp_path / "a.usda", gravity=2.0).scene.builder.finalize().gravity
    np.testing.assert_allclose(said, (0, -2, 0) if up == "Y" else (0, 0, -2))


def test_of_several_scenes_the_first_is_taken_and_named(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    add_curves(stage, "/World/C", line())
    for name, magnitude in ("A", 1.0), ("B", 2.0):
        UsdPhysics.Scene.Define(stage, f"/World/{name}").CreateGravityMagnitudeAttr(magnitude)
    stage.Save()
    source = load_stage(tmp_path / "a.usda")
    np.testing.assert_allclose(source.gravity, (0, -1, 0))
    assert source.notes == ["the stage has several physics scenes; gravity is that of /World/A"]


def test_gravity_that_changes_is_refused(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    add_curves(stage, "/World/C", line())
    attribute = UsdPhysics.Scene.Define(stage, "/World/P").CreateGravityMagnitudeAttr()
    attribute.Set(1.0, 0)
    attribute.Set(2.0, 10)
    stage.Save()
    with pytest.raises(pbd.InputError, match=r"^/World/P: physics:gravityMagnitude changes with time"):
        load_stage(tmp_path / "a.usda")


def resisting(path, width=0.02, material=None, **attributes):
    """The model of a bent curve whose prim has these attributes."""
    stage = new_stage(path)
    points = [(0.2 * k, 0.02 * k * k, 0.0) for k in range(6)]
    prim = add_curves(stage, "/World/C", points, width=width)
    prim = stage.GetPrimAtPath("/World/C")
    for name, value in attributes.items():
        kind = Sdf.ValueTypeNames.String if isinstance(value, str) else Sdf.ValueTypeNames.Double
        prim.CreateAttribute(f"pbd:{name}", kind).Set(value)
    stage.GetRootLayer().Save()
    return load_stage(path, material=material).scene.builder.finalize(dtype="float64")


def test_resistance_to_bending(tmp_path):
    """E pi d^4 / 64 and l / (E A), B itself, and the shape at rest; the command line goes before the prim."""
    free = resisting(tmp_path / "a.usda")
    assert len(free.bending) == 0
    model = resisting(tmp_path / "b.usda", youngsModulus=1e7, restShape="as_built")
    np.testing.assert_array_equal(model.bending.triple, [(k, k + 1, k + 2) for k in range(4)])
    np.testing.assert_allclose(model.bending.stiffness, 1e7 * np.pi * 0.02**4 / 64.0)
    np.testing.assert_allclose(model.distance.compliance, model.distance.rest_length / (1e7 * np.pi * 1e-4), rtol=1e-6)
    np.testing.assert_allclose(model.bending.energy(model.x), 0.0, atol=1e-9)
    straight = resisting(tmp_path / "c.usda", bending=0.3)
    np.testing.assert_array_equal(straight.bending.stiffness, 0.3)
    assert np.all(straight.bending.energy(straight.x) > 1e-4)
    given = resisting(tmp_path / "d.usda", material=Material(youngs_modulus=1e6), bending=0.3)
    np.testing.assert_allclose(given.bending.stiffness, 1e6 * np.pi * 0.02**4 / 64.0)


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ({"youngsModulus": -1.0}, "youngs_modulus must be"),
        ({"bending": -1.0}, "bending must be"),
        ({"bending": 1.0, "youngsModulus": 1.0}, "give one of the two"),
        ({"restShape": "curly"}, "unknown rest_shape"),
    ],
)
def test_bad_stiffness_is_one_sentence(tmp_path, attributes, message):
    with pytest.raises(pbd.InputError, match=message):
        resisting(tmp_path / "a.usda", **attributes)
