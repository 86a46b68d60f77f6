"""Reading stages that others wrote: units, gravity, bodies, transforms, composition, files that are broken."""

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdPhysics

from tests.make.usda import BIND, SHEET, Reader, cloth, errors, fabric, notes
from wsim.scene import Plane, SceneError
from wsim.usd import load


@pytest.fixture
def read(tmp_path):
    return Reader(tmp_path)


# Units, gravity, time ------------------------------------------------------------------------------------------------

def test_centimetres_and_grams_become_si(read):
    values = ("float physics:surfaceStretchStiffness = 2000\nfloat physics:poissonsRatio = 0\n"
              "float physics:surfaceBendStiffness = 500\nfloat physics:density = 0.4")
    scene = read(cloth(f"{BIND}\nfloat[] physics:thicknesses = [0.1]\nvector3f[] velocities = [(1, 0, 0), (0, 0, 0), "
                       "(0, 0, 0), (0, 0, 0)]\ndouble3 xformOp:translate = (0, 0, 50)\n"
                       'uniform token[] xformOpOrder = ["xformOp:translate"]\nfloat physics:mass = 30')
                 + fabric(values), header='metersPerUnit = 0.01\nkilogramsPerUnit = 0.001\nupAxis = "Z"')
    sheet = scene.cloths[0]
    assert np.array_equal(sheet.points[2], [0.01, 0.01, 0.0])
    assert sheet.velocities[0, 0] == 0.01 and sheet.motion.at(0.0)[2, 3] == 0.5
    assert sheet.material.stretch == pytest.approx(2.0, rel=1e-12)          # 2000 g/s^2
    assert sheet.material.bend == pytest.approx(500e-7, rel=1e-12)          # g cm^2/s^2
    assert sheet.material.density == pytest.approx(400.0, rel=1e-12)        # 0.4 g/cm^3
    assert sheet.material.thickness == pytest.approx(0.001, rel=1e-12) and sheet.mass == pytest.approx(0.03)
    assert scene.gravity == (0.0, 0.0, -9.81) and scene.up == "Z"


def test_a_stage_that_authors_no_units_is_in_centimetres(read):
    assert read(cloth(), header='doc = ""').cloths[0].points.max() == 0.01


@pytest.mark.parametrize("attributes", [
    "", "float physics:gravityMagnitude = -inf", "vector3f physics:gravityDirection = (0, 0, 0)",
    "float physics:gravityMagnitude = 3.5", "vector3f physics:gravityDirection = (1, 2, 2)",
    "float physics:gravityMagnitude = 0",
    "vector3f physics:gravityDirection = (0, 5, 0)\nfloat physics:gravityMagnitude = 2"])
@pytest.mark.parametrize("metres", [1.0, 0.01])
@pytest.mark.parametrize("up", ["Y", "Z"])
def test_gravity_is_what_usdphysics_says(read, tmp_path, attributes, metres, up):
    scene = read(cloth() + f'def PhysicsScene "p" {{\n{attributes}\n}}\n',
                 header=f'metersPerUnit = {metres}\nupAxis = "{up}"')
    stage = Usd.Stage.Open(str(tmp_path / "scene.usda"))
    desc = UsdPhysics.UsdPhysicsLoadStageFromPrimRange(stage, ["/p"])[UsdPhysics.ObjectType.Scene][1][0]
    expected = np.array(desc.gravityDirection) * desc.gravityMagnitude * metres
    assert np.allclose(scene.gravity, expected, rtol=1e-6, atol=1e-6)


def test_any_negative_magnitude_asks_for_earths_gravity(read):
    scene = read(cloth() + 'def PhysicsScene "p" {\nfloat physics:gravityMagnitude = -1\n}\n')
    assert scene.gravity == (0.0, -9.81, 0.0)


def test_time_codes_give_frames_and_rate_and_settings_come_from_the_first_scene(read):
    scene = read(cloth() + 'def PhysicsScene "a" (prepend apiSchemas = ["WsimSceneAPI"]) {\nint wsim:substeps = 7\n'
                 'token wsim:integrator = "bdf2"\nvector3d wsim:wind = (100, 0, 0)\n}\ndef PhysicsScene "b" {}\n',
                 header='metersPerUnit = 0.01\ntimeCodesPerSecond = 30\nstartTimeCode = 11\nendTimeCode = 41')
    assert (scene.fps, scene.start, scene.frames, scene.substeps, scene.integrator) == (30.0, 11.0, 30, 7, "bdf2")
    assert scene.wind == (1.0, 0.0, 0.0) and "one of 2 PhysicsScene prims" in notes(scene)


def test_newtons_step_rate_is_a_hint_for_the_substeps(read):
    scene = read(cloth() + 'def PhysicsScene "a" {\nint newton:timeStepsPerSecond = 480\n}\n')
    assert scene.substeps == 20 and "newton:timeStepsPerSecond" in notes(scene)


def test_newtons_switch_of_gravity_and_mujocos_medium(read):
    scene = read(cloth() + 'def PhysicsScene "a" {\nbool newton:gravityEnabled = 0\ndouble mjc:option:density = 1.2\n}\n')
    assert scene.gravity == (0.0, 0.0, 0.0) and "mjc:option:density = 1.2 is left out" in notes(scene)


# Bodies --------------------------------------------------------------------------------------------------------------

def test_a_body_on_the_parent_gives_its_mass_and_the_mesh_its_path(read):
    scene = read('def Xform "body" (prepend apiSchemas = ["PhysicsDeformableBodyAPI"]) {\nfloat physics:mass = 2\n'
                 f'def Mesh "sim" (prepend apiSchemas = ["PhysicsSurfaceDeformableSimAPI"]) {{{SHEET}\n}}\n'
                 f'def Mesh "look" {{{SHEET}\n}}\n}}\n')
    assert scene.cloths[0].path == "/body/sim" and scene.cloths[0].mass == 2.0
    assert "/body/look: lies in the deformable body" in notes(scene)


def test_two_simulation_geometries_in_one_body_are_an_error(read):
    api = '(prepend apiSchemas = ["PhysicsSurfaceDeformableSimAPI"])'
    sims = "".join(f'def Mesh "{n}" {api} {{{SHEET}\n}}\n' for n in "ab")
    text = errors(read, f'def Xform "body" (prepend apiSchemas = ["PhysicsDeformableBodyAPI"]) {{\n{sims}}}\n')
    assert "/body: is one deformable body with 2 simulation geometries" in text


def test_no_deformable_names_the_meshes_and_the_command(read):
    text = errors(read, f'def Mesh "shirt" {{{SHEET}\n}}\n')
    assert "/shirt" in text and "wsim new cloth scene.usda -o SCENE" in text
    assert "has no Mesh" in errors(read, 'def Xform "empty" {}\n')


def test_an_empty_stage_says_what_could_be_by_the_rows_of_methods_too(read, monkeypatch):
    from tests.make.rows.wheels import ROW
    from wsim.usd.new import hints
    monkeypatch.setattr(hints, "METHODS", [*hints.METHODS, ROW])
    text = errors(read, 'def Xform "empty" {}\n')
    for thing in ("cloth (PhysicsSurfaceDeformableSimAPI)", "soft bodies (PhysicsVolumeDeformableSimAPI)",
                  "rigid bodies (PhysicsRigidBodyAPI)", "wheels (ToyWheelAPI)"):
        assert thing in text
    assert len(text) < 500 and "A scene may hold" not in errors(read, f'def Mesh "shirt" {{{SHEET}\n}}\n')


def test_a_kinematic_body_is_a_collider_and_a_disabled_one_is_left_out(read):
    scene = read(cloth() + cloth("bool physics:kinematicEnabled = 1", "moving")
                 + cloth("bool physics:bodyEnabled = 0", "off"))
    assert [c.path for c in scene.cloths] == ["/cloth"] and [c.path for c in scene.colliders] == ["/moving"]
    assert "/off: physics:bodyEnabled is off" in notes(scene)


def test_polygons_rest_shape_and_animated_points_are_kept_as_authored(read):
    quads = """
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0), (2, 1, 0), (3, 0.5, 0)]
    point3f[] points.timeSamples = {0: [(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1), (2, 0, 1), (2, 1, 1), (3, 0.5, 1)]}
    int[] faceVertexCounts = [4, 5]
    int[] faceVertexIndices = [0, 1, 2, 3, 1, 4, 6, 5, 2]"""
    sheet = read(cloth('uniform token physics:restBendAnglesDefault = "restShape"', geometry=quads)).cloths[0]
    assert sheet.counts.tolist() == [4, 5] and not sheet.flat
    assert np.all(sheet.points[:, 2] == 1.0) and np.all(sheet.rest_points[:, 2] == 0.0)


# Composition ---------------------------------------------------------------------------------------------------------

def test_a_cloth_in_an_instance_is_an_error_that_names_the_instance(read):
    text = errors(read, f'def Xform "asset" {{\n{cloth()}\n}}\n'
                  'def Xform "copy" (instanceable = true\nprepend references = </asset>) {}\n')
    assert "/copy/cloth" in text and "author instanceable = false on /copy" in text


def test_a_collider_in_an_instance_collides(read):
    scene = read(cloth() + 'class Xform "asset" {\n'
                 'def Sphere "s" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {}\n}\n'
                 'def Xform "copy" (instanceable = true\nprepend references = </asset>) {}\n')
    assert [c.path for c in scene.colliders] == ["/copy/s"]


LARGE = SHEET.replace("(1, 0, 0), (1, 1, 0), (0, 1, 0)", "(2, 0, 0), (2, 2, 0), (0, 2, 0)")
VARIANTS = ('def Xform "root" (variants = {string size = "small"}\nprepend variantSets = "size") {\n'
            'variantSet "size" = {\n"small" {\n' + cloth() + '}\n"large" {\n' + cloth(geometry=LARGE) + "}\n}\n}\n")


def test_variants_are_chosen_by_name(read):
    assert read(VARIANTS).cloths[0].points.max() == 1.0
    scene = read(VARIANTS, variants={"/root": {"size": "large"}})
    assert scene.cloths[0].points.max() == 2.0 and scene.variants == {"/root": {"size": "large"}}


@pytest.mark.parametrize("variants, said", [
    ({"/root": {"size": "huge"}}, "small, large"), ({"/root": {"colour": "red"}}, "it has: size"),
    ({"/no": {"size": "small"}}, "no such prim")])
def test_a_variant_that_does_not_exist_lists_those_that_do(read, variants, said):
    found = errors(read, VARIANTS, variants=variants)
    assert said.split(", ")[0] in found and said.split(", ")[-1] in found


def test_payloads_are_loaded_and_broken_references_only_warn(read, tmp_path, capfd):
    (tmp_path / "part.usda").write_text('#usda 1.0\n(defaultPrim = "p")\ndef Xform "p" {\n' + cloth() + "}\n")
    scene = read('def "a" (prepend payload = @./part.usda@) {}\ndef "b" (prepend references = @./gone.usda@) {}\n'
                 'def Shader "look" {\nasset inputs:file = @./gone.png@\n}\n')
    assert [c.path for c in scene.cloths] == ["/a/cloth"]
    assert "gone.usda" in notes(scene) and "@./gone.png@ is not found" in notes(scene)
    assert capfd.readouterr().err == ""


def test_unknown_apis_and_metadata_are_passed_over(read):
    scene = read(cloth().replace('"MaterialBindingAPI"', '"MaterialBindingAPI", "PhysxNoSuchAPI:a"')
                 + 'def Odd "odd" {\nint odd:value = 3\n}\n', header="metersPerUnit = 1\nkilogramsPerMass = 1")
    assert len(scene.cloths) == 1


def test_inactive_prims_are_not_there_and_invisible_ones_and_guides_count(read):
    def ball(name, extra="", meta=""):
        return f'def Sphere "{name}" (prepend apiSchemas = ["PhysicsCollisionAPI"]\n{meta}) {{\n{extra}\n}}\n'

    scene = read(cloth('token visibility = "invisible"') + ball("off", meta="active = false")
                 + ball("hidden", 'token visibility = "invisible"') + ball("guide", 'uniform token purpose = "guide"')
                 + ball("no", "bool physics:collisionEnabled = 0"))
    assert len(scene.cloths) == 1 and [c.path for c in scene.colliders] == ["/hidden", "/guide"]


@pytest.mark.parametrize("content", ["", "not usd at all", "#usda 1.0\ndef Mesh {"])
def test_a_file_that_is_no_usd_is_one_clear_error(tmp_path, content):
    path = tmp_path / "x.usda"
    path.write_text(content)
    with pytest.raises(SceneError, match="is not a readable USD file"):
        load(path)


def test_a_missing_file_and_a_folder_are_clear_errors(tmp_path):
    for path in (tmp_path / "none.usda", tmp_path):
        with pytest.raises(SceneError, match="no such file|is a folder"):
            load(path)


def test_a_file_that_changed_on_disk_is_read_again(read):
    held = read(cloth())
    assert len(held.cloths) == 1
    assert len(read(cloth() + cloth(name="second")).cloths) == 2


def test_a_plane_of_a_foreign_stage_faces_along_its_axis(read):
    scene = read(cloth() + 'def Plane "p" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {\n'
                 'uniform token axis = "Y"\n}\n')
    assert isinstance(scene.colliders[0].shape, Plane)
    assert np.allclose(scene.colliders[0].motion.at(0.0)[:3, 2], (0, 1, 0))


def test_a_cloth_under_an_animated_parent_moves_with_it_exactly_at_frames_and_between(read, tmp_path):
    """Along arcs, as USD evaluates ops; of doubles, as USD rounds floats between samples."""
    parent = ('def Xform "up" {\ndouble xformOp:rotateZ.timeSamples = {0: 0, 7.5: 100, 20: -30}\n'
              'double3 xformOp:translate = (5, 0, 0)\n'
              'uniform token[] xformOpOrder = ["xformOp:rotateZ", "xformOp:translate"]\n')
    scale = 'float3 xformOp:scale = (1, -2, 1)\nuniform token[] xformOpOrder = ["xformOp:scale"]'
    scene = read(parent + cloth(scale) + "}\n",
                 header="metersPerUnit = 0.01\nstartTimeCode = 2\nendTimeCode = 26")
    stage = Usd.Stage.Open(str(tmp_path / "scene.usda"))
    prim = stage.GetPrimAtPath("/up/cloth")
    for frame in np.linspace(0.0, 24.0, 73).tolist():
        M = np.array(UsdGeom.XformCache(Usd.TimeCode(2 + frame)).GetLocalToWorldTransform(prim))
        seen = np.array([Gf.Vec3d(*p) for p in ((0, 0, 0), (100, 100, 0))]) @ M[:3, :3] + M[3, :3]
        ours = scene.cloths[0].motion.points(np.array([(0, 0, 0), (1, 1, 0)]), frame / 24.0)
        assert np.abs(ours - seen * 0.01).max() < 1e-12
