"""Input that a stage can hold and that was read wrongly, or not at all, without a word: each is an error or a warning now."""

import tracemalloc

import pytest

from tests.make.usd.usda_soft import SIM, SOLID, TWO, place, solid, volume
from tests.make.usda import BIND, SHEET, Reader, cloth, errors, fabric, notes

PIN = """def PhysicsAttachment "{}" {{
    rel physics:src0 = </cloth>
    int[] physics:indices0 = [{}]
    vector3f[] physics:coords1 = [{}]
}}
"""
NET = """
def BasisCurves "net" (prepend apiSchemas = ["PhysicsDeformableBodyAPI", "WsimSpringsAPI"]) {{
    uniform token type = "linear"
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 0, 0), (2, 0, 0)]
    int[] curveVertexCounts = [2, 2]
    float[] wsim:stiffness = [100]
    float[] wsim:masses = [1]
    {}
}}
"""


@pytest.fixture
def read(tmp_path):
    return Reader(tmp_path)


def scene(values: str) -> str:
    return f'def PhysicsScene "p" (prepend apiSchemas = ["WsimSceneAPI"]) {{\n{values}\n}}\n'


# What is joined to what, and masses ----------------------------------------------------------------------------------

COLLIDER = f'def Mesh "floor" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {{{{{SHEET}\n{{}}\n}}}}\n'
TURNS = "int[] {}.timeSamples = {{0: {}, 5: {}}}"
TETS = "int4[] tetVertexIndices.timeSamples = {0: [(0, 1, 2, 3), (1, 2, 3, 4)], 5: [(0, 1, 2, 4), (1, 2, 3, 4)]}"


@pytest.mark.parametrize(("text", "path", "name"), [
    (cloth(TURNS.format("faceVertexIndices", [0, 1, 2, 0, 2, 3], [0, 1, 3, 1, 2, 3])), "/cloth", "faceVertexIndices"),
    (cloth() + COLLIDER.format(TURNS.format("faceVertexCounts", [3, 3], [3])), "/floor", "faceVertexCounts"),
    (volume(f"{SOLID}\n{TETS}") + solid(), "/ball", "tetVertexIndices"),
    (NET.format(TURNS.format("curveVertexCounts", [2, 2], [4])), "/net", "curveVertexCounts")])
def test_topology_that_changes_in_time_is_an_error(read, text, path, name):
    assert f"{path}: {name} is sampled in time and changes at time code 5" in errors(read, text)


def test_topology_that_is_sampled_and_stays_is_read(read):
    same = [0, 1, 2, 0, 2, 3]
    assert read(cloth(TURNS.format("faceVertexIndices", same, same))).cloths[0].indices.tolist() == same


@pytest.mark.parametrize(("rest", "said"), [
    ("(0, 0, 0), (0, 0, 0), (0, 0, 0), (0, 0, 0)", "/cloth: none of its faces has an area at rest"),
    ("(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 0)", "first point 3 with 0 kg (each face there has no area at rest)"),
    ("(0, 0, 0), (1e-20, 0, 0), (1e-20, 1e-20, 0), (0, 1e-20, 0)", "/cloth: 4 points have next to no mass")])
def test_points_that_the_rest_shape_leaves_without_mass_are_an_error(read, rest, said):
    assert said in errors(read, cloth(f"point3f[] physics:restShapePoints = [{rest}]"))


def test_authored_masses_without_an_inverse_are_an_error(read):
    said = "points have next to no mass, first point {} with 1e-40 kg"
    assert said.format(2) in errors(read, cloth("float[] physics:masses = [1, 1, 1e-40, 1]"))
    assert said.format(0) in errors(read, NET.format("").replace("wsim:masses = [1]", "wsim:masses = [1e-40, 1, 1, 1]"))
    assert said.format(4) in errors(read, volume(f"{SOLID}\nfloat[] physics:masses = [1, 1, 1, 1, 1e-40]") + solid())


@pytest.mark.parametrize("values", ["vector3f physics:gravityDirection = (nan, 0, 0)",
                                    "vector3f physics:gravityDirection = (0, inf, 0)",
                                    "float physics:gravityMagnitude = nan", "float physics:gravityMagnitude = inf"])
def test_gravity_that_is_not_finite_is_an_error(read, values):
    said = errors(read, cloth() + scene(values))
    assert f"/p: {values.split()[1]} is " in said and "finite" in said


# Types and bounds ----------------------------------------------------------------------------------------------------

@pytest.mark.parametrize(("text", "name"), [
    (cloth(geometry=SHEET.replace("int[] faceVertexCounts", "float[] faceVertexCounts")), "/cloth.faceVertexCounts"),
    (cloth() + PIN.format("pin", "0", "(0, 0, 0)").replace("int[]", "float[]"), "/pin.physics:indices0"),
    (cloth() + PIN.format("pin", "0", "(0, 0, 0)").replace("[(0, 0, 0)]", "[0, 0, 0]").replace("vector3f[]", "float[]"),
     "/pin.physics:coords1"),
    (cloth("double[] physics:masses = [1, 1, 1, 1]").replace("double[]", "string[]").replace("[1, 1, 1, 1]", '["a"]'),
     "/cloth.physics:masses"),
    (cloth("float3[] physics:masses = [(1, 1, 1)]"), "/cloth.physics:masses"),
    (volume(f"{SOLID}\nint[] physics:restTetVertexIndices = [0, 1, 2, 3, 1, 2, 3, 4]") + solid(),
     "/ball.physics:restTetVertexIndices"),
    (NET.format("float[] wsim:particles = [0, 1, 1.5, 2]"), "/net.wsim:particles"),
    (NET.format("int[] wsim:damping = [1]"), "/net.wsim:damping"),
    (cloth() + scene("double wsim:substeps = 2.5"), "/p.wsim:substeps"),
    (cloth() + scene("vector2d wsim:wind = (1, 2)").replace("vector2d", "double2"), "/p.wsim:wind"),
    (cloth("string physics:bodyEnabled = \"no\""), "/cloth.physics:bodyEnabled")])
def test_an_attribute_of_another_type_is_an_error_that_names_it(read, text, name):
    said = errors(read, text)
    assert f"{name}: is of type " in said or f"{name.partition('.')[0]}: has no {name.partition('.')[2]}" in said


@pytest.mark.parametrize("text", [
    NET.format("int[] wsim:particles = [0, 1, 1, 999999999]"), NET.format("int[] wsim:particles = [0, 1, 1, -999999999]"),
    NET.format("").replace("[2, 2]", "[2, 999999999]"),
    NET.format("int[] wsim:muscles = [0, 999999999]\ndouble[] wsim:actuation = [1]"),
    cloth() + PIN.format("pin", "999999999", "(0, 0, 0)"),
    cloth("float[] physics:masses = [1, 1]", geometry=SHEET.replace("[3, 3]", "[3, 999999999]")),
    cloth("double wsim:weld = 0.1", geometry=SHEET.replace("2, 3]", "2, 999999999]")),
    cloth() + COLLIDER.format("int[] faceVertexIndices = [0, 1, 2, 0, 2, 999999999]").replace(
        "int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]", 'uniform token orientation = "leftHanded"'),
    volume(geometry=TWO.replace("3, 4)", "3, 999999999)")) + solid(),
    volume(f"{SOLID}\nint4[] physics:restTetVertexIndices = [(0, 1, 2, 3), (1, 2, 3, 999999999)]") + solid()])
def test_an_index_far_out_of_range_takes_no_memory(read, text):
    tracemalloc.start()
    errors(read, text)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 10e6


# Pins ----------------------------------------------------------------------------------------------------------------

def test_a_point_that_is_pinned_at_two_places_is_an_error(read):
    one, two = PIN.format("a", "3", "(0, 1, 0)"), PIN.format("b", "0, 3", "(0, 0, 0), (0, 1, 0.5)")
    said = errors(read, cloth() + one + two)
    assert "/b: it holds point 3 of /cloth, which is held by /a too, 0.5 m away at t = 0 s" in said
    assert "once more by itself" in errors(read, cloth() + PIN.format("c", "3, 3", "(0, 1, 0), (0, 1, 1)"))


def test_a_point_that_is_pinned_twice_at_one_place_or_softly_is_not(read):
    same = PIN.format("a", "3", "(0, 1, 0)") + PIN.format("b", "0, 3", "(0, 0, 0), (0, 1, 0)")
    soft = PIN.format("c", "3", "(0, 1, 1)").replace("rel", "float physics:stiffness = 10\nrel")
    assert len(read(cloth() + same + soft).pins) == 3


def test_two_pins_that_part_later_are_an_error(read):
    moves = ('def Xform "x" {\ndouble3 xformOp:translate.timeSamples = {0: (0, 0, 0), 12: (0, 0, 1)}\n'
             'uniform token[] xformOpOrder = ["xformOp:translate"]\n}\n')
    one, two = (f'def PhysicsAttachment "{n}" {{\nrel physics:src0 = </cloth>\nint[] physics:indices0 = [3]\n{more}\n}}\n'
                for n, more in (("a", ""), ("b", "rel physics:src1 = </x>")))
    assert "/b: it holds point 3 of /cloth, which is held by /a too" in errors(read, cloth() + moves + one + two)


BOX = """def Cube "box" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI", "PhysicsMassAPI"]) {{
    float physics:mass = 1
    {}
    def Xform "hook" {{}}
}}
"""
ROPE = """def BasisCurves "rope" (prepend apiSchemas = ["PhysicsDeformableBodyAPI", "PhysicsCurvesDeformableSimAPI"]) {
    uniform token type = "linear"
    point3f[] points = [(0, 2, 0), (0, 3, 0), (0, 4, 0)]
    int[] curveVertexCounts = [3]
    float[] widths = [0.01]
    float physics:density = 300
}
"""


@pytest.mark.parametrize("target", ["box", "box/hook"])
@pytest.mark.parametrize("body", [cloth(), ROPE])
def test_points_that_are_attached_to_a_body_that_forces_move_are_tied_to_it(read, target, body):
    """They were held where it starts."""
    pin = PIN.format("tied", "0", "(0, 1, 0)").replace("int[]", f"rel physics:src1 = </{target}>\nint[]")
    pin = pin.replace("</cloth>", "</rope>") if body == ROPE else pin
    scene = read(body + BOX.format("") + pin)
    assert [(tie.path, tie.other, tie.others) for tie in scene.ties] == [("/tied", "/box", None)] and not scene.pins
    for still in ("bool physics:kinematicEnabled = 1", "bool physics:rigidBodyEnabled = 0"):
        scene = read(body + BOX.format(still) + pin)
        assert len(scene.pins or [pin for rods in scene.things("Rods") for pin in rods.pins]) == 1


# Curves --------------------------------------------------------------------------------------------------------------

def test_widths_of_a_rope_without_thicknesses_are_said_to_be_only_seen(read):
    """The rope was 1 mm thick and said nothing."""
    said = ("/rope: widths of up to 0.01 m are only seen: physics:thicknesses is not authored, and strands are 0.001 m thick; "
            "author it, in units of the stage")
    assert said in notes(read(ROPE))
    for other in (ROPE.replace("widths = [0.01]", "widths = [0.001]"),
                  ROPE.replace("float[] widths", "float[] physics:thicknesses = [0.02]\n    float[] widths")):
        assert "only seen" not in notes(read(other))


def test_a_closed_curve_is_a_closed_rod(read):
    """It was read as springs, without bending and twist."""
    scene = read(ROPE.replace("uniform token type", 'uniform token wrap = "periodic"\n    uniform token type'))
    assert "springs" not in notes(scene) and scene.things("Rods")[0].closed


# Meshes --------------------------------------------------------------------------------------------------------------

def test_faces_that_are_holes_to_see_are_said_to_be_simulated(read):
    """A neck that was closed by one said nothing. Exporters author none of them."""
    assert ("/cloth: holeIndices are only seen: 1 faces, such as 1, are simulated; take faces where the cloth has a hole out "
            "of faceVertexCounts") in notes(read(cloth("int[] holeIndices = [1]")))
    assert "holeIndices" not in notes(read(cloth("int[] holeIndices = []")))


# Names that nobody reads ---------------------------------------------------------------------------------------------

@pytest.mark.parametrize(("text", "said"), [
    (cloth("double wsim:dragg = 1"), "/cloth: wsim:dragg is no name that wsim reads, and does nothing; did you mean "
     "wsim:drag?"),
    (cloth() + scene("int wsim:subSteps = 3"), "/p: wsim:subSteps is no name that wsim reads, and does nothing; did you mean "
     "wsim:substeps?"),
    (cloth() + scene("rel wsim:oder = </cloth>"), "did you mean wsim:order?"),
    (cloth() + 'def Xform "x" {\ndouble wsim:drag = 1\n}\n', "/x: wsim:drag does nothing on a Xform like this"),
    (cloth() + 'def Xform "x" {\nvector3d wsim:wind = (1, 0, 0)\n}\n', "it is read on a PhysicsScene"),
    (cloth(BIND) + fabric("float physics:surfaceStrechStiffness = 5"), "/mat: physics:surfaceStrechStiffness is no name that "
     "wsim reads here, and does nothing; did you mean physics:surfaceStretchStiffness?"),
    (cloth("point3f[] physics:restShapePoint = []"), "did you mean physics:restShapePoints?"),
    (cloth() + PIN.format("a", "0", "(0, 0, 0)").replace("rel", "float physics:stifness = 3\nrel"),
     "did you mean physics:stiffness?"),
    (cloth() + 'def Mesh "m" (prepend apiSchemas = ["PhysicsSurfaceDeformableSimApi"]) {}\n',
     "/m: PhysicsSurfaceDeformableSimApi is no schema that wsim or USD knows, and does nothing; did you mean "
     "PhysicsSurfaceDeformableSimAPI?"),
    (cloth() + 'def PhysicsAtachment "m" {}\n', "did you mean PhysicsAttachment?"),
    (cloth() + 'def OmniPhysicsVtxXformAttachment "m" {}\n', "the current type is PhysicsAttachment"),
    (cloth("bool omniphysics:deformableBodyEnabled = 1"), "a foreign spelling")])
def test_a_name_that_nobody_reads_is_named_with_what_was_meant(read, text, said):
    assert said in notes(read(text))


def test_names_that_are_read_or_others_are_not_named(read):
    text = cloth(f"{BIND}\ndouble wsim:drag = 1\ndouble wsim:thickness = 0.001\nfloat physics:mass = 1\n"
                 "bool physics:startsAsleep = 0\ndouble wsim:restart:timeCode = 3\nfloat newton:dragg = 1") + fabric(
        "double wsim:weftStretch = 3\nfloat physics:curvesBendStiffness = 1\nfloat physics:density = 3",
        apis='"PhysicsSurfaceDeformableMaterialAPI", "PhysicsMaterialAPI", "WsimMaterialAPI"')
    assert not [n for n in read(text).notes if "no name" in n.text or "does nothing" in n.text]


# What fuzzing found --------------------------------------------------------------------------------------------------

BALL = 'def Sphere "ball" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {{\n{}\n}}\n'
POSE = ('point3f[] physics:deformablePose:bind:points = [(0, 0, 0)]\n'
        'uniform token[] physics:deformablePose:bind:purposes = ["bindPose"]')


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("text", "said"), [
    (cloth() + BALL.format('string radius = "text"'), "/ball.radius: is of type"),
    (cloth(place("string xformOp:translate", '"x"')), "/cloth: its transform, or one above it, cannot be read"),
    (cloth(place("float xformOp:scale", "2")), "/cloth: its transform, or one above it, cannot be read"),
    (cloth("point3f[] velocities = [(0, 0, 0)]\ndouble wsim:weld = 1e300"), "/cloth: "),
    (cloth(place("double3 xformOp:scale", "(1e300, 1e300, 1e300)")), "/cloth: points lie"),
    (volume(f"{SOLID}\n{POSE.replace('point3f[]', 'float[]').replace('[(0, 0, 0)]', '[1, 2]')}",
            apis=f'"PhysicsDeformableBodyAPI", {SIM}, "PhysicsDeformablePoseAPI:bind"') + solid(),
     "deformablePose:bind:points: is of type"),
])
def test_values_that_ended_in_a_traceback_are_errors(read, text, said):
    assert said in errors(read, text)


@pytest.mark.parametrize(("text", "said"), [
    (volume(f'{SOLID}\nstring[] primvars:wsim:young = ["a", "b"]') + solid(), "primvars:wsim:young is of type string[]"),
    (cloth() + scene('string newton:timeStepsPerSecond = "many"'), "newton:timeStepsPerSecond is many, and no number")])
def test_hints_that_are_none_are_left_out_with_a_note(read, text, said):
    assert said in notes(read(text))
