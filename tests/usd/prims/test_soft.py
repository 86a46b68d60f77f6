"""Soft bodies of a stage: what a save writes a load reads back equal, and what others write is understood or refused."""

from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdValidation

from tests.make.usd.prims.soft import soft_scene
from tests.make.usd.usd import _difference
from tests.make.usd.usda_soft import BONE, LOOK, SOLID, TWO, body, part, place, solid, volume
from tests.make.usda import Reader, cloth, errors, notes
from tools.lint import ROOT
from wsim.geometry.tetra import tets as meshes
from wsim.physics.soft import check as check_soft
from wsim.scene import Soft
from wsim.scene.check.scene import check_scene
from wsim.scene.solid import MODELS, Bulk
from wsim.usd import load, names, save

BEAR = ROOT / "scenes/assets/bear_tet.usdc"


@pytest.fixture
def read(tmp_path):
    return Reader(tmp_path)


# Saved and loaded ----------------------------------------------------------------------------------------------------


@pytest.fixture
def all_of_it(monkeypatch):
    """A stage can say more than is simulated yet: pressure, quadratic tets, plasticity."""
    monkeypatch.setattr(check_soft, "check_unsupported_material", lambda thing: ())


@pytest.mark.parametrize("seed", range(12))
def test_save_then_load_gives_an_equal_scene_and_the_same_bytes_again(tmp_path, all_of_it, seed):
    scene, file = soft_scene(seed), tmp_path / f"a.{'usdc' if seed % 3 == 0 else 'usda'}"
    save(scene, file)
    back = load(file)
    assert _difference(scene, back) == "" and scene == back
    assert [note for note in back.notes if "metersPerUnit" not in note.text] == []
    for name in ("b.usda", "c.usda"):
        save(back, tmp_path / name)
        back = load(tmp_path / name)
    assert (tmp_path / "b.usda").read_text() == (tmp_path / "c.usda").read_text()


@pytest.mark.parametrize("seed", range(3))
def test_usd_cores_own_reading_of_a_saved_body_agrees(tmp_path, all_of_it, seed):
    """Its validators pass, no element is inverted to it, and the surface is the one that it computes."""
    save(soft_scene(seed), tmp_path / "s.usda")
    stage = Usd.Stage.Open(str(tmp_path / "s.usda"))
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    assert [(e.GetName(), e.GetMessage()) for e in context.Validate(stage)] == []
    at_start = UsdGeom.XformCache(Usd.TimeCode(stage.GetStartTimeCode()))
    for path in ("/soft", "/World/b/in", "/World/ball/sim"):
        mesh = UsdGeom.TetMesh(stage.GetPrimAtPath(path))
        assert list(UsdGeom.TetMesh.FindInvertedElements(mesh, Usd.TimeCode.Default())) == []
        theirs = UsdGeom.TetMesh.ComputeSurfaceFaces(mesh, Usd.TimeCode.Default())
        assert _cycles(mesh.GetSurfaceFaceVertexIndicesAttr().Get()) == _cycles(theirs)
        mirrored = at_start.GetLocalToWorldTransform(mesh.GetPrim()).GetDeterminant() < 0
        assert mesh.GetOrientationAttr().Get() == ("leftHanded" if mirrored else "rightHanded")


def _cycles(faces) -> set:
    """Triangles whichever corner comes first."""
    return {tuple(np.roll(face, -int(np.argmin(face)))) for face in np.array(faces)}


def bear() -> str:
    return (f'def Xform "zoo" (prepend references = @{BEAR}@) {{\nover "bear" (prepend apiSchemas = '
            f'["PhysicsDeformableBodyAPI", "PhysicsVolumeDeformableSimAPI", "MaterialBindingAPI"]) {{\n{SOLID}\n}}\n}}\n'
            + solid("float physics:youngsModulus = 1e5"))


def test_the_bear_loads_checks_saves_and_loads_equal(read, tmp_path):
    scene = read(bear() + 'def Plane "floor" (prepend apiSchemas = ["PhysicsCollisionAPI"]) '
                 f'{{\nuniform token axis = "Y"\n{place("double3 xformOp:translate", "(0, -1, 0)")}\n}}\n')
    soft = scene.softs[0]
    assert (soft.path, len(soft.points), len(soft.tets)) == ("/zoo/bear", 961, 3008)
    assert meshes.signed_tet_volumes(soft.points, soft.tets).sum() == pytest.approx(98.4285, rel=1e-5)  # as its mesher had it
    assert check_scene(scene) == [] and {n.text.split()[0] for n in scene.notes} == {
        "physics:staticFriction", "physics:dynamicFriction", "physics:density", "has"}           # and no range of time
    save(scene, tmp_path / "b.usdc")
    assert load(tmp_path / "b.usdc") == scene


def test_fallbacks_of_the_schemas_are_the_defaults_of_a_soft_body_and_its_material():
    registry, soft = Usd.SchemaRegistry(), Soft("/a", [], [])
    for row in (row for row in names.TABLE if row.owner in ("Soft", "Bulk") and row.attribute.startswith("wsim:")):
        attribute = registry.FindAppliedAPIPrimDefinition(row.schema).GetAttributeDefinition(row.attribute)
        assert attribute.GetFallbackValue() == getattr(soft if row.owner == "Soft" else soft.material, row.field)
        if row.type == "token":
            assert tuple(attribute.GetMetadata("allowedTokens")) == tuple(MODELS)


# Read ----------------------------------------------------------------------------------------------------------------

def test_centimetres_and_grams_become_si(read, all_of_it):
    """1 g/(cm s^2) is 0.1 Pa."""
    scene = read(volume(f"{SOLID}\ndouble wsim:pressure = 50\nfloat[] wsim:filled = [1, 0.25]\nfloat[] physics:masses = [3]\n"
                        "vector3f[] velocities = [(1, 0, 0), (0, 0, 0), (0, 0, 0), (0, 0, 0), (0, 0, 0)]\n"
                        + place("double3 xformOp:translate", "(0, 0, 50)"))
                 + solid("float physics:youngsModulus = 2e5\nfloat physics:density = 1.1\nfloat physics:poissonsRatio = 0.4\n"
                         "double wsim:yieldStrain = 0.2\ndouble wsim:damping = 0.01\nfloat physics:staticFriction = 0.7\n"
                         'uniform token wsim:elasticModel = "neo_hookean"'),
                 header='metersPerUnit = 0.01\nkilogramsPerUnit = 0.001\nupAxis = "Z"')
    soft, material = scene.softs[0], scene.softs[0].material
    assert material.young == pytest.approx(2e4, rel=1e-12) and material.density == pytest.approx(1100.0, rel=1e-12)
    assert material == replace(material, poisson=0.4, yield_strain=0.2, damping=0.01, static_friction=0.7,
                               dynamic_friction=0.0, model="neo_hookean")
    assert np.array_equal(soft.points[4], [0.01] * 3) and soft.velocities[0, 0] == 0.01
    assert soft.motion.at(0.0)[2, 3] == 0.5 and soft.pressure == pytest.approx(5.0)
    assert soft.mass == pytest.approx(0.003) and soft.masses is None and soft.filled.tolist() == [1.0, 0.25]
    assert scene.gravity == (0.0, 0.0, -9.81)


@pytest.mark.parametrize("values", ["", "float physics:youngsModulus = -inf\nfloat physics:density = 0"])
def test_what_is_not_authored_is_the_proposals_fallback_in_si(read, values):
    scene = read(volume() + solid(values or "float physics:poissonsRatio = 0.3"), header="metersPerUnit = 0.01")
    material = scene.softs[0].material
    assert (material.young, material.poisson, material.density) == (1e6, 0.3, 1000.0)
    assert ("youngsModulus is not authored" in notes(scene)) == (values == "")


def test_an_unbound_body_has_the_fallbacks_and_says_so(read):
    scene = read(volume(""))
    assert scene.softs[0].material == Bulk() and "no physics material is bound" in notes(scene)


@pytest.mark.parametrize("sim, above, masses, mass", [
    ('float[] physics:masses = [1, 2, 3, 4, 5]\nuniform token physics:masses:elementType = "point"', "", [1, 2, 3, 4, 5], None),
    ('float[] physics:masses = [4, 8]\nuniform token physics:masses:elementType = "tetrahedron"', "float physics:mass = 9",
     [1, 3, 3, 3, 2], 9.0),
    ('float[] physics:masses = [4, 8]', "", [1, 3, 3, 3, 2], None),
    ('float[] physics:masses = [5]\nuniform token physics:masses:elementType = "constant"', "float physics:mass = 9",
     None, 5.0),
    ("", "float physics:mass = 9\nfloat physics:density = 3", None, 9.0), ("", "float physics:density = 3", None, None)])
def test_mass_of_points_tets_or_the_whole_goes_before_the_bodys(read, sim, above, masses, mass):
    soft = read(volume(f"{SOLID}\n{sim}\n{above}") + solid("float physics:density = 70")).softs[0]
    assert (soft.masses if masses is None else soft.masses.tolist()) == masses and soft.mass == mass
    assert soft.material.density == (3.0 if "density" in above else 70.0)


@pytest.mark.parametrize("orientation, scale, turned", [
    ("rightHanded", 1, False), ("leftHanded", 1, True), ("rightHanded", -1, True), ("leftHanded", -1, False)])
def test_volumes_are_positive_in_the_world_whatever_the_handedness(read, orientation, scale, turned):
    """Geometry of the right winding, as its orientation has it: nothing to warn of."""
    geometry = TWO if orientation == "rightHanded" else TWO.replace("(0, 1, 2, 3), (1, 2, 3, 4)", "(0, 1, 3, 2), (1, 2, 4, 3)")
    scene = read(volume(f'{SOLID}\nuniform token orientation = "{orientation}"\n'
                        + place("float3 xformOp:scale", f"({scale}, 1, 1)"), geometry=geometry) + solid())
    soft = scene.softs[0]
    assert (meshes.signed_tet_volumes(soft.motion.points(soft.points), soft.tets) > 0).all() and "wound" not in notes(scene)
    assert soft.tets[0].tolist() == ([0, 1, 2, 3] if scale > 0 else [0, 1, 3, 2])


def test_wrong_winding_is_mended_with_a_warning_that_names_the_first_tet(read):
    scene = read(volume(geometry=TWO.replace("(1, 2, 3, 4)", "(2, 1, 3, 4)")) + solid())
    assert "/ball: 1 of its 2 tets are wound against its orientation rightHanded (first: tet 1)" in notes(scene)
    soft = scene.softs[0]
    assert (meshes.signed_tet_volumes(soft.points, soft.tets) > 0).all() and not any(p.fatal for p in check_scene(scene))


@pytest.mark.parametrize("rest, expected, said", [
    ("point3f[] physics:restShapePoints = [(0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 2), (2, 2, 2)]", 2.0, ""),
    ("point3f[] physics:restShapePoints = [(0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 2), (2, 2, 2)]\n"
     "int4[] physics:restTetVertexIndices = [(0, 1, 2, 3), (1, 2, 3, 4)]", 2.0, ""),
    ("point3f[] physics:restShapePoints = [(9, 9, 9), (2, 2, 2), (0, 0, 2), (0, 2, 0), (2, 0, 0), (0, 0, 0)]\n"
     "int4[] physics:restTetVertexIndices = [(5, 4, 3, 2), (4, 3, 2, 1)]", 2.0, ""),
    ("point3f[] physics:restShapePoints = [(0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 2), (2, 2, 2), (2, 0, 0)]\n"
     "int4[] physics:restTetVertexIndices = [(0, 1, 2, 3), (5, 2, 3, 4)]", None,
     "cuts its tets from each other (first: tet 0)"),
])
def test_a_rest_shape_is_read_in_the_order_of_the_points(read, rest, expected, said):
    scene = read(volume(f"{SOLID}\n{rest}") + solid())
    soft = scene.softs[0]
    assert said in notes(scene) if said else "cuts" not in notes(scene)
    assert soft.rest_points is None if expected is None else np.array_equal(soft.rest_points, 2 * soft.points)


def test_points_that_are_animated_start_where_they_are_and_rest_at_their_default(read):
    moved = TWO + "\npoint3f[] points.timeSamples = {0: [(0, 0, 5), (1, 0, 5), (0, 1, 5), (0, 0, 6), (1, 1, 6)]}"
    soft = read(volume(geometry=moved) + solid()).softs[0]
    assert soft.points[0, 2] == 5.0 and soft.rest_points[0, 2] == 0.0


# Materials of some tets ----------------------------------------------------------------------------------------------

def test_subsets_give_some_tets_a_material_and_looks_do_not(read):
    scene = read(volume(SOLID + part("1") + part("0", "seen", material="paint", binding="material:binding")) + solid() + BONE
                 + LOOK)
    soft = scene.softs[0]
    assert soft.which.tolist() == [0, 1] and [m.young for m in soft.materials] == [1e5, 1e9]
    assert soft.others[0].density == 1900.0


@pytest.mark.parametrize("parts, path, said", [
    (part("0, 2"), "/ball/part", "indices[1] names tet 2; allowed is 0 to 1"),
    (part("-1"), "/ball/part", "indices[0] names tet -1"),
    (part("0, 1") + part("1", "more"), "/ball/more", "indices[0] names tet 1, and so does /ball/part"),
    (part("0", material="soap"), "/soap", "physics:poissonsRatio: poisson is 0.6"),
])
def test_subsets_that_overlap_or_name_no_tet_are_errors_with_their_path_and_index(read, parts, path, said):
    found = errors(read, volume(SOLID + parts) + solid() + BONE + solid("float physics:poissonsRatio = 0.6", "soap"))
    assert f"{path}: {said}" in found


def test_a_subset_of_faces_is_noted(read):
    scene = read(volume(SOLID + part("0", kind="face")) + solid() + BONE)
    assert scene.softs[0].others == [] and "/ball/part: binds a physics material to elements of type 'face'" in notes(scene)


# Pins, other bodies, bad input -----------------------------------------------------------------------------------------

@pytest.mark.parametrize("held", ["/body/sim", "/body"])
def test_a_pin_holds_points_of_a_soft_body_to_a_moving_frame(read, held):
    scene = read(body("") + 'def Xform "hook" {\ndouble3 xformOp:translate.timeSamples = {0: (0, 0, 0), 24: (0, 4, 0)}\n'
                 'uniform token[] xformOpOrder = ["xformOp:translate"]\n}\n'
                 f'def PhysicsAttachment "pin" {{\nrel physics:src0 = <{held}>\nrel physics:src1 = </hook>\nuniform token '
                 'physics:type0 = "point"\nuniform token physics:type1 = "xform"\nint[] physics:indices0 = [0, 3]\n}\n')
    pin = scene.pins[0]
    assert pin.body == "/body/sim" and pin.points.tolist() == [0, 3] and pin.motion.at(0.5)[1, 3] == 2.0


def test_an_attachment_of_what_is_no_body_is_left_out_with_the_bodies_named(read):
    pin = ('def PhysicsAttachment "pin" {\nrel physics:src0 = </jelly>\nuniform token physics:type0 = "point"\n'
           'uniform token physics:type1 = "xform"\nint[] physics:indices0 = [0]\n}\n')
    scene = read(volume() + solid() + pin)
    assert scene.pins == [] and "cloth, spring net, soft body, rods or material points (/ball)" in notes(scene)


def test_a_kinematic_soft_body_collides_by_its_surface(read):
    """Six of the eight faces of two tets that share one, and what they enclose is their volume, 1/6 and 1/3, outward."""
    left = TWO.replace("2, 3), (1, 2, 3, 4)", "3, 2), (1, 2, 4, 3)") + '\nuniform token orientation = "leftHanded"'
    scene = read(cloth() + "".join(volume(f"{SOLID}\nbool physics:kinematicEnabled = 1", name, geometry)
                                   for name, geometry in (("right", TWO), ("left", left))) + solid())
    assert scene.softs == [] and [c.path for c in scene.colliders] == ["/right", "/left"]
    for shape in (c.shape for c in scene.colliders):
        a, b, c = shape.points[shape.indices.reshape(-1, 3)].transpose(1, 0, 2).astype(float)
        assert len(a) == 6 and np.einsum("fk,fk", a, np.cross(b, c)) / 6.0 == pytest.approx(1 / 6 + 1 / 3)


def test_a_cloth_and_a_soft_body_share_a_stage(read, tmp_path):
    scene = read(volume() + solid() + cloth())
    assert [b.path for b in scene.bodies()] == ["/cloth", "/ball"]
    save(scene, tmp_path / "both.usda")
    assert load(tmp_path / "both.usda") == scene


def test_without_physics_a_tetmesh_is_named_with_the_command_that_makes_it_soft(read):
    found = errors(read, f'def TetMesh "bare" {{{TWO}\n}}\n')
    assert "Its TetMeshes: /bare. `wsim new softbody scene.usda -o SCENE`" in found


def test_older_and_foreign_spellings_are_reported_with_the_current_name(read):
    scene = read(volume(f"{SOLID}\nint4[] physics:restTetVtxIndices = [(0, 1, 2, 3)]\nfloat omniphysics:mass = 1") + solid()
                 + f'def TetMesh "old" (prepend apiSchemas = ["OmniPhysicsVolumeDeformableSimAPI"]) {{{TWO}\n}}\n')
    for said in ("author physics:restTetVertexIndices", "the current namespace is physics:",
                 "OmniPhysicsVolumeDeformableSimAPI is not read; the current schema is PhysicsVolumeDeformableSimAPI"):
        assert said in notes(scene)
