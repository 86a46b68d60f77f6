"""Vertex maps painted on meshes: what each means, that it acts as theory has it, and what is said of maps that cannot be."""

import numpy as np
import pytest

from tests.make.usd.usda_soft import SOLID, place, solid, volume
from tests.make.usda import BIND, Reader, cloth, errors, fabric, notes
from wsim import Cloth, Fabric, Scene, Simulation, save
from wsim.scene import Load
from wsim.scene.curve import Curve
from wsim.usd import load

MATERIAL = fabric("float physics:surfaceStretchStiffness = 100\nfloat physics:surfaceShearStiffness = 40\n"
                  "float physics:surfaceBendStiffness = 1e-4\nfloat physics:poissonsRatio = 0\nfloat physics:density = 200")


@pytest.fixture
def read(tmp_path):
    return Reader(tmp_path)


def paint(name: str, values, interpolation: str = "vertex", kind: str = "float[]") -> str:
    return f'{kind} primvars:wsim:{name} = {values} (\ninterpolation = "{interpolation}"\n)'


def painted(*maps: str) -> str:
    return cloth("\n".join([BIND, *maps])) + MATERIAL


def test_points_give_faces_their_mean_and_faces_their_own(read):
    sheet = read(painted(paint("stretch", [100, 200, 300, 600]), paint("bend", [0, 2e-4], "uniform"))).cloths[0]
    assert sheet.stretches == pytest.approx([200.0, 1000.0 / 3.0]) and sheet.bends == pytest.approx([0.0, 2e-4])
    assert sheet.material.bend == pytest.approx(1e-4)
    assert sheet.material.shear / sheet.material.stretch == pytest.approx(0.4)          # the ratio stays


def test_one_value_for_all_is_the_materials(read):
    sheet = read(painted(paint("stretch", [300], "constant"))).cloths[0]
    assert sheet.stretches is None and (sheet.material.stretch, sheet.material.shear) == pytest.approx((300.0, 120.0))


def test_painted_values_are_in_stage_units(read):
    """In centimetres and grams: 1 kg/s^2 = 1000 g/s^2, 1 kg m^2/s^2 = 1e7 g cm^2/s^2."""
    sheet = read(painted(paint("stretch", [1e5] * 4), paint("bend", [1e3] * 4), paint("thickness", [0.1, 0.1, 0.2, 0.2])),
                 "metersPerUnit = 0.01\nkilogramsPerUnit = 0.001").cloths[0]
    assert sheet.stretches == pytest.approx([100.0] * 2) and sheet.bends == pytest.approx([1e-4] * 2)
    assert sheet.thicknesses == pytest.approx([1e-3, 1e-3, 2e-3, 2e-3])


def test_thickness_of_faces_is_shared_by_their_points(read):
    """Points 0 and 2 are of both triangles."""
    sheet = read(painted(paint("thickness", [1e-3, 3e-3], "uniform"))).cloths[0]
    assert sheet.thicknesses == pytest.approx([2e-3, 1e-3, 2e-3, 3e-3])


def test_weights_are_pins_hard_at_one_and_springs_below(read):
    scene = read(painted(paint("pin", [1, 0.5, 0.25, 0])))
    quarter, half, hard = sorted(scene.pins, key=lambda p: p.stiffness)
    assert (hard.points.tolist(), half.points.tolist(), quarter.points.tolist()) == ([0], [1], [2])
    assert hard.stiffness == np.inf and half.stiffness == pytest.approx(100.0)         # w / (1 - w) stretch
    assert quarter.stiffness == pytest.approx(100.0 / 3.0)


def test_weights_of_a_soft_body_are_in_its_own_stiffness(read):
    """Young's modulus times the mean edge, at one half."""
    scene = read(volume(SOLID + "\n" + paint("pin", [1, 0.5, 0, 0, 0])) + solid())
    x, tets = scene.softs[0].points.astype(float), scene.softs[0].tets
    ends = {tuple(sorted((int(t[a]), int(t[b])))) for t in tets for a in range(4) for b in range(a)}
    mean = np.mean([np.linalg.norm(x[a] - x[b]) for a, b in ends])
    assert [p.points.tolist() for p in scene.pins if p.stiffness == np.inf] == [[0]]
    assert [p.stiffness for p in scene.pins if p.stiffness < np.inf] == pytest.approx([1e5 * mean])


def test_what_is_held_moves_with_the_mesh(read):
    moved = place("double3 xformOp:translate.timeSamples", "{0: (0, 0, 0), 24: (0, 2, 0)}").replace(
        '"xformOp:translate.timeSamples"', '"xformOp:translate"')
    pin = read(painted(paint("pin", [1, 0, 0, 0]), moved)).pins[0]
    assert pin.motion.at(1.0)[:3, 3] == pytest.approx([0.0, 2.0, 0.0])


def test_young_of_points_gives_a_tet_the_mean_of_its_corners(read):
    soft = read(volume(SOLID + "\n" + paint("young", [1e5, 1e5, 1e5, 1e5, 5e5])) + solid()).softs[0]
    assert [soft.materials[k].young for k in soft.which] == pytest.approx([1e5, 2e5])


@pytest.mark.parametrize(("map_", "said"), [
    (paint("stretch", [1, 2, 3]), "primvars:wsim:stretch has 3 values with interpolation 'vertex'; allowed is 4 with vertex"),
    (paint("bend", [1, 2, 3, 4], "uniform"), "or 2 with uniform, or 1 with constant: paint it again, or correct its interp"),
    (paint("stretch", [1, 2, 3, 4], "constant"), "primvars:wsim:stretch has 4 values with interpolation 'constant'"),
    (paint("bend", [1] * 6, "faceVarying"), "primvars:wsim:bend has 6 values with interpolation 'faceVarying'"),
    (paint("stretch", [1, 1, -2, 1]), "primvars:wsim:stretch[2] is -2 (in SI units)"),
    (paint("bend", "[1, nan, 1, 1]"), "primvars:wsim:bend[1] is nan"),
    (paint("thickness", [1, 1, 1, 0]), "primvars:wsim:thickness[3] is 0"),
    (paint("pin", [0, 0, 1.5, 0]), "primvars:wsim:pin[2] is 1.5; allowed is 0 (free) to 1 (held)"),
    (paint("pin", [0, -1, 0, 0]), "primvars:wsim:pin[1] is -1"),
    (paint("pin", [0, 1], "uniform"), "primvars:wsim:pin has 2 values with interpolation 'uniform'; allowed is 4 with vertex"),
    (paint("pin", '["a", "b", "c", "d"]', kind="string[]"), "primvars:wsim:pin is of type string[]; allowed is float[]")])
def test_maps_that_cannot_be_are_errors_with_path_and_mend(read, map_, said):
    found = errors(read, painted(map_))
    assert f"/cloth: {said.split('or 2')[0]}" in found and said in found and ("again" in found)


def test_a_misspelt_map_and_one_on_another_prim_are_said(read):
    assert "did you mean primvars:wsim:stretch?" in notes(read(painted(paint("strech", [1] * 4))))
    ball = volume(SOLID + "\n" + paint("bend", [1] * 5)) + solid()
    assert "primvars:wsim:bend does nothing on a TetMesh" in notes(read(ball))


def test_a_sampled_stretch_of_the_material_cannot_follow_a_map(read):
    text = MATERIAL.replace("Stiffness = 100", "Stiffness.timeSamples = {0: 100, 5: 200}")
    said = notes(read(cloth(f"{BIND}\n{paint('stretch', [1, 2, 3, 4])}") + text))
    assert "stretch of /cloth cannot follow (its faces have values of their own)" in said


def test_a_saved_cloth_keeps_its_faces(tmp_path):
    scene = Scene()
    scene.cloths.append(_strip([100.0, 200.0, 400.0], bends=[1e-6, 0.0, 1e-3]))
    save(scene, tmp_path / "strip.usda")
    again = load(tmp_path / "strip.usda").cloths[0]
    assert np.array_equal(again.stretches, [100.0, 200.0, 400.0]) and np.array_equal(again.bends, [1e-6, 0.0, 1e-3])


def _strip(stretches, bends=None, model="membrane") -> Cloth:
    """Quads of 10 cm below each other, the first at the top."""
    m = len(stretches)
    points = np.array([(x, -0.1 * k, 0.0) for k in range(m + 1) for x in (0.0, 0.1)])
    quads = np.array([(2 * k, 2 * k + 2, 2 * k + 3, 2 * k + 1) for k in range(m)])
    mean, bend = float(np.mean(stretches)), float(np.mean(bends or [0.0]))
    return Cloth("/strip", points, np.full(m, 4), quads.ravel(), stretches=stretches, bends=bends, model=model,
                 material=Fabric(stretch=mean, shear=0.3 * mean, bend=bend, density=50.0))


@pytest.mark.parametrize(("solver", "substeps"), [("implicit", 8), ("explicit", 64), ("xpbd", 128)])
def test_faces_in_series_stretch_each_by_its_own_stiffness(solver, substeps):
    """Strain F / (stretch width) of a strip; F = 1 N, width 0.1 m; small strains: second order 2 %. The sweeps of xpbd need
    substeps in which the force moves a point by little."""
    stretches = np.array([1000.0, 2000.0, 500.0])
    scene = Scene(gravity=(0.0, 0.0, 0.0), air_drag=40.0, substeps=substeps, iterations=30, solver=solver)
    scene.cloths.append(_strip(stretches))
    scene.pin("/pin", "/strip", [0, 1])
    scene.loads.append(Load("/pull", "/strip", Curve([0.0], [[0.0, -1.0, 0.0]]), points=[6, 7]))
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.run(40)
    x = sim.positions("/strip")
    strain = (x[0:-2:2, 1] - x[2::2, 1]) / 0.1 - 1.0
    assert strain == pytest.approx(1.0 / (0.1 * stretches), rel=0.03)


def test_springs_of_a_uniform_map_are_those_of_the_material():
    from wsim.model.model import make_body
    from wsim.physics.cloth.constraints import constraints_of_body
    plain, mapped = _strip([300.0] * 3, model="springs"), _strip([300.0] * 3, model="springs")
    plain.stretches = None
    for one, other in zip(*(constraints_of_body(make_body(c, 0, 0, 0)) for c in (plain, mapped)), strict=True):
        assert one.kind == other.kind and np.broadcast_to(one.alpha, len(one.ids)) == pytest.approx(other.alpha)


def test_a_hinge_bends_by_the_mean_of_its_faces():
    from wsim.model.model import make_body
    from wsim.physics.cloth.constraints import constraints_of_body
    row = next(r for r in constraints_of_body(make_body(_strip([300.0] * 3, bends=[1e-5, 3e-5, 7e-5]), 0, 0, 0))
               if r.kind == "dihedral")
    assert sorted(set(np.round(row.stiffness["bend"] / 1e-5, 6))) == [1.0, 2.0, 3.0, 5.0, 7.0]


def test_a_fit_is_not_offered_one_number_where_faces_differ():
    from wsim.fitting.parameter import parameters_of_names
    scene = Scene()
    scene.cloths.append(_strip([300.0, 400.0]))
    with pytest.raises(Exception, match="nothing here has stretch"):
        parameters_of_names(["stretch"], [scene])
