"""Reading masses, thicknesses, materials, curves and attachments that others wrote; bad values in them."""

import math

import numpy as np
import pytest

from tests.make.usda import BIND, SHEET, Reader, cloth, errors, fabric, notes


@pytest.fixture
def read(tmp_path):
    return Reader(tmp_path)


# Masses, thicknesses, materials -------------------------------------------------------------------------------------

@pytest.mark.parametrize("sim, body, expected", [
    ('float[] physics:masses = [1, 2, 3, 4]\nuniform token physics:masses:elementType = "point"', "", [1, 2, 3, 4]),
    ('float[] physics:masses = [3, 6]\nuniform token physics:masses:elementType = "face"', "float physics:mass = 9",
     [3, 1, 3, 2]),
    ('float[] physics:masses = [5]\nuniform token physics:masses:elementType = "constant"', "float physics:mass = 9",
     5.0),
    ("", "float physics:mass = 9\nfloat physics:density = 3", 9.0),
    ("", "float physics:mass = 0\nfloat physics:density = 3", None)])
def test_mass_of_points_goes_before_mass_of_the_body(read, sim, body, expected):
    sheet = read(cloth(f"{sim}\n{body}")).cloths[0]
    if isinstance(expected, list):
        assert sheet.masses.tolist() == expected
    else:
        assert sheet.masses is None and sheet.mass == expected


@pytest.mark.parametrize("body, material, expected", [
    ("float physics:density = 30", "float physics:density = 400", 30.0), ("", "float physics:density = 400", 400.0),
    ("float physics:density = 0", "float physics:density = 0", 1000.0)])
def test_density_of_the_body_goes_before_the_materials(read, body, material, expected):
    assert read(cloth(f"{BIND}\n{body}") + fabric(material)).cloths[0].material.density == expected


@pytest.mark.parametrize("kind, values, each, whole", [
    ("constant", "[0.002]", None, 0.002), ("point", "[0.001, 0.002, 0.003, 0.004]", [1, 2, 3, 4], 0.0025),
    ("face", "[0.001, 0.003]", [2, 1, 2, 3], 0.002)])
def test_thicknesses_of_points_faces_or_the_whole(read, kind, values, each, whole):
    sheet = read(cloth(f"float[] physics:thicknesses = {values}\n"
                       f'uniform token physics:thicknesses:elementType = "{kind}"')).cloths[0]
    assert sheet.material.thickness == pytest.approx(whole, rel=1e-6)
    assert (sheet.thicknesses is None) == (each is None)
    if each:
        assert np.allclose(sheet.thicknesses, np.array(each) / 1000.0, rtol=1e-6)


def test_stiffness_that_is_not_authored_follows_from_young_poisson_and_thickness(read):
    E, nu, h = 2.0e5, 0.25, 0.004
    m = read(cloth(f"{BIND}\nfloat[] physics:thicknesses = [{h}]") + fabric(
        f"float physics:youngsModulus = {E}\nfloat physics:poissonsRatio = {nu}\n"
        "float physics:surfaceShearStiffness = -inf")).cloths[0].material
    assert m.stretch == pytest.approx(E * h) and m.shear == pytest.approx(E / (2 * (1 + nu)) * h)
    assert m.bend == pytest.approx(E * h**3 / (12 * (1 - nu**2))) and m.poisson == nu


def test_plane_stress_stiffness_is_turned_into_that_of_a_strip(read):
    m = read(cloth(BIND) + fabric("float physics:surfaceStretchStiffness = 100\nfloat physics:poissonsRatio = 0.5e-1")
             ).cloths[0].material
    assert m.stretch == pytest.approx(100 * (1 - 0.05**2), rel=1e-12)


def test_an_unbound_cloth_has_the_fallbacks_of_the_proposal_and_says_so(read):
    scene = read(cloth())
    m = scene.cloths[0].material
    assert (m.thickness, m.density, m.poisson) == (0.001, 1000.0, 0.3) and m.stretch == pytest.approx(1e3)
    assert "no physics material is bound" in notes(scene)


@pytest.mark.parametrize("binding, stretch", [
    ("rel material:binding:physics = </mat>\nrel material:binding = </other>", 100.0),
    ("rel material:binding = </mat>", 100.0)])
def test_the_physics_binding_goes_before_the_one_for_all_purposes(read, binding, stretch):
    scene = read(cloth(binding) + fabric(f"float physics:surfaceStretchStiffness = {stretch}\n"
                                         "float physics:poissonsRatio = 0")
                 + fabric("float physics:surfaceStretchStiffness = 7", "other"))
    assert scene.cloths[0].material.stretch == stretch


def test_friction_of_a_collider_comes_from_its_material(read):
    scene = read(cloth() + 'def Sphere "bare" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {}\n'
                 'def Sphere "ball" (prepend apiSchemas = ["PhysicsCollisionAPI", "MaterialBindingAPI"]) {\n'
                 + BIND + "\n}\n"
                 + fabric("float physics:staticFriction = 0.9", apis='"PhysicsMaterialAPI"'))
    assert [(c.static_friction, c.dynamic_friction) for c in scene.colliders] == [(0.5, 0.5), (0.9, 0.0)]


def test_older_and_foreign_spellings_are_reported_with_the_current_name(read):
    scene = read(cloth(BIND + "\nfloat omniphysics:mass = 1") + fabric("float physics:stretchStiffness = 9")
                 + f'def Mesh "old" (prepend apiSchemas = ["PhysxParticleClothAPI"]) {{{SHEET}\n}}\n')
    assert "physics:surfaceStretchStiffness" in notes(scene) and "current namespace is physics:" in notes(scene)
    assert "PhysxParticleClothAPI is not read; the current schema is PhysicsDeformableBodyAPI" in notes(scene)


# Curves --------------------------------------------------------------------------------------------------------------

def test_a_curves_deformable_is_a_rod_with_the_mass_of_its_segments(read):
    scene = read('def BasisCurves "rope" (prepend apiSchemas = ["PhysicsDeformableBodyAPI", '
                 '"PhysicsCurvesDeformableSimAPI", "MaterialBindingAPI"]) {\n'
                 'uniform token type = "linear"\nint[] curveVertexCounts = [3, 2]\n'
                 "point3f[] points = [(0, 0, 0), (1, 0, 0), (3, 0, 0), (0, 1, 0), (0, 2, 0)]\n"
                 f"float[] physics:thicknesses = [0.02]\n{BIND}\n}}\n"
                 + fabric("float physics:youngsModulus = 1e6\nfloat physics:density = 500",
                          apis='"PhysicsCurvesDeformableMaterialAPI"'))
    from wsim.physics.rods.tables import StrandTable
    area, rope = math.pi * 0.02**2 / 4, scene.things("Rods")[0]
    assert rope.counts.tolist() == [3, 2] and not scene.springs
    table = StrandTable([(rope, 0)])
    assert np.allclose(table.values["A"].T[table.values["A"].T > 0], 1e6 * area / np.array([1, 2, 1]), rtol=1e-6)
    assert np.allclose(table.values["m"].T.ravel()[:5], 500 * area * np.array([0.5, 1.5, 1.0, 0.5, 0.5]), rtol=1e-6)


def test_springs_share_points_by_a_map_and_pins_name_vertices(read):
    scene = read('def BasisCurves "net" (prepend apiSchemas = ["PhysicsDeformableBodyAPI", "WsimSpringsAPI"]) {\n'
                 'uniform token type = "linear"\nint[] curveVertexCounts = [2, 2]\n'
                 "point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 0, 0), (2, 0, 0)]\n"
                 "int[] wsim:particles = [0, 1, 1, 2]\nfloat[] wsim:stiffness = [5]\nfloat[] wsim:masses = [1]\n}\n"
                 'def PhysicsAttachment "pin" {\nrel physics:src0 = </net>\nuniform token physics:type0 = "point"\n'
                 'uniform token physics:type1 = "xform"\nint[] physics:indices0 = [3, 2]\n'
                 "vector3f[] physics:coords1 = [(2, 0, 0), (1, 0, 0)]\n}\n")
    assert scene.springs[0].edges.tolist() == [[0, 1], [1, 2]] and len(scene.springs[0].points) == 3
    assert scene.pins[0].points.tolist() == [2, 1]


MUSCLES = ('def BasisCurves "net" (prepend apiSchemas = ["PhysicsDeformableBodyAPI", "WsimSpringsAPI"]) {\n'
           'uniform token type = "linear"\nint[] curveVertexCounts = [3]\n'
           "point3f[] points = [(0, 0, 0), (1, 0, 0), (2, 0, 0)]\n"
           "float[] wsim:stiffness = [5]\nfloat[] wsim:masses = [1]\nuniform int[] wsim:muscles = [-1, 0]\n"
           "double[] wsim:actuation.timeSamples = {%s}\n}\n")


def test_muscles_follow_samples_over_time(read):
    scene = read(MUSCLES % "2: [1.0], 12: [0.5]", header="timeCodesPerSecond = 20\nstartTimeCode = 2\nendTimeCode = 12")
    springs = scene.springs[0]
    assert springs.muscles.tolist() == [-1, 0] and springs.actuation.times.tolist() == [0.0, 0.5]
    assert springs.actuation.at(0.25).tolist() == [0.75]


def test_samples_of_muscles_of_different_sizes_are_refused(read):
    assert "has 1 and 2 values at different times" in errors(read, MUSCLES % "1: [1.0], 2: [0.5, 1.0]")


# Attachments ---------------------------------------------------------------------------------------------------------

def attachment(extra: str = "int[] physics:indices0 = [0, 3]", kinds=("point", "xform"), target: str = "/hook") -> str:
    return (f'def PhysicsAttachment "pin" {{\nrel physics:src0 = </cloth>\nrel physics:src1 = <{target}>\n'
            f'uniform token physics:type0 = "{kinds[0]}"\nuniform token physics:type1 = "{kinds[1]}"\n{extra}\n}}\n')


HOOK = ('def Xform "hook" {{\ndouble3 xformOp:translate = (0, 2, 0)\n{}\n'
        'float3 xformOp:scale = (2, 2, 2)\nuniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]\n}}\n')


def test_an_animated_pin_follows_its_xform_and_the_xforms_scale_goes_into_the_places(read):
    moves = "double3 xformOp:translate.timeSamples = {0: (0, 2, 0), 24: (0, 4, 0)}"
    pin = read(cloth() + HOOK.format(moves) + attachment(
        "int[] physics:indices0 = [0, 3]\nvector3f[] physics:coords1 = [(1, 0, 0), (0, 0, 1)]\n"
        "float physics:stiffness = 50")).pins[0]
    assert (pin.body, pin.target, pin.stiffness) == ("/cloth", "/hook", 50.0)
    assert pin.places.tolist() == [[2, 0, 0], [0, 0, 2]]
    M = pin.motion.at(0.5)
    assert np.allclose(M[:3, 3], (0, 3, 0), atol=1e-12) and np.allclose(M[:3, :3], np.eye(3), atol=1e-12)


@pytest.mark.parametrize("text, said", [
    (attachment(kinds=("face", "xform")), "attaches face to xform and is left out"),
    (attachment(kinds=("point", "point")), "attaches /hook, which is no simulated cloth or soft body"),
    (attachment(""), "has no physics:indices0")])
def test_attachments_that_are_not_simulated_are_noted(read, text, said):
    scene = read(cloth() + HOOK.format("") + text)
    assert scene.pins == [] and said in notes(scene)


def test_a_disabled_attachment_is_not_there(read):
    on = attachment("int[] physics:indices0 = [0]\nbool physics:attachmentEnabled = 0")
    assert read(cloth() + HOOK.format("") + on).pins == []


@pytest.mark.parametrize("text, said", [
    (attachment("int[] physics:indices0 = [0, 4]"), "it holds point 4"),
    (attachment("int[] physics:indices0 = [0]\nvector3f[] physics:coords1 = [(0, 0, 0), (0, 0, 0)]"), "places"),
    (attachment(target="/nowhere"), "/nowhere, which does not exist"),
    (attachment("int[] physics:indices0 = [0]\nfloat physics:stiffness = -2"), "stiffness is -2")])
def test_broken_attachments_are_errors_with_their_path(read, text, said):
    found = errors(read, cloth() + HOOK.format("") + text)
    assert "/pin" in found and said in found


# Errors --------------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("text, said", [
    (cloth(geometry=SHEET.replace("(1, 1, 0)", "(nan, 1, 0)")), "/cloth"),
    (cloth(geometry=SHEET.replace("(1, 1, 0)", "(inf, 1, 0)")), "/cloth"),
    (cloth(geometry=SHEET.replace("2, 3]", "2, 9]")), "/cloth"),
    (cloth(geometry=SHEET.replace("2, 3]", "2]")), "/cloth"),
    (cloth(geometry=""), "has no points"),
    (cloth("float[] physics:masses = [1, -1, 1, 1]"), "physics:masses[1] is -1"),
    (cloth("float[] physics:masses = [1, 1, 1]"), "physics:masses has 3 values"),
    (cloth("float[] physics:thicknesses = [0]"), "physics:thicknesses[0] is 0"),
    (cloth("float physics:mass = -3"), "physics:mass is -3"),
    (cloth("float physics:density = nan"), "physics:density is nan"),
    (cloth("point3f[] physics:restShapePoints = [(0, 0, 0)]"), "/cloth: 1 rest points"),
    (cloth('uniform token physics:restBendAnglesDefault = "round"'), "'round'"),
    (cloth(BIND) + fabric("float physics:surfaceStretchStiffness = -5"), "/mat: physics:surfaceStretchStiffness"),
    (cloth(BIND) + fabric("float physics:surfaceBendStiffness = nan"), "/mat: physics:surfaceBendStiffness"),
    (cloth(BIND) + fabric("float physics:poissonsRatio = 0.5"), "/mat: physics:poissonsRatio"),
    (cloth(BIND) + fabric("float physics:poissonsRatio = -1"), "/mat: physics:poissonsRatio"),
    (cloth(BIND) + fabric("float physics:youngsModulus = -1"), "/mat: physics:youngsModulus"),
    (cloth(BIND) + fabric("float physics:density = -1"), "/mat: physics:density"),
    (cloth(BIND) + fabric("float physics:staticFriction = -1"), "/mat: physics:staticFriction"),
    (cloth() + 'def Sphere "s" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {\ndouble radius = -1\n}\n',
     "/s: radius is -1"),
    (cloth() + 'def Mesh "m" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {}\n', "/m: is a mesh collider without")])
def test_bad_values_are_errors_that_name_the_prim(read, text, said):
    assert said in errors(read, text)


def test_every_error_is_reported_together(read):
    text = errors(read, cloth("float physics:mass = -1\n" + BIND) + cloth(geometry="", name="b")
                  + fabric("float physics:poissonsRatio = 3\nfloat physics:surfaceBendStiffness = -1"))
    for part in ("/cloth: physics:mass", "/b: has no points", "poissonsRatio", "surfaceBendStiffness"):
        assert part in text
