"""Particles of other schemas, materials of subsets, ids, widths and colours: from stages, through runs, back."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

import wsim
from wsim.physics.mpm.objects import Granular, Jelly, Snow, Water
from wsim.scene.samples import DROPS

SAND = Path(__file__).parents[5] / "scenes/assets/mpm_sand.usda"
HEAD = '#usda 1.0\n(\n metersPerUnit = {metres}\n upAxis = "Y"\n timeCodesPerSecond = 60\n endTimeCode = 2\n)\n'


def write(folder, text, metres=1.0):
    path = folder / "s.usda"
    path.write_text(HEAD.format(metres=metres) + text)
    return str(path)


def load(folder, text, metres=1.0):
    scene = wsim.load(write(folder, text, metres))
    return scene.things("MaterialPoints"), " ".join(map(str, scene.notes))


def points(apis, body, children="", name="sand"):
    return (f'def Points "{name}" (prepend apiSchemas = [{", ".join(map(repr, apis))}]) {{\n'.replace("'", '"')
            + f'point3f[] points = [(0, 0, 0), (10, 0, 0), (0, 10, 0), (10, 10, 0)]\n{body}\n{children}\n}}\n')


def material(body, api="NewtonMPMMaterialAPI", name="m"):
    return f'def Material "{name}" (prepend apiSchemas = ["{api}"]) {{\n{body}\n}}\n'


W = "float[] widths = [1]\n"
STRESS = "float newton:mpm:yieldStress = 1e9\nfloat newton:mpm:youngsModulus = 300\nfloat newton:mpm:elasticDamping = 13"
NEWTON = ["NewtonPointsDeformableSimAPI", "PhysicsDeformableBodyAPI", "MaterialBindingAPI"]
BOUND = "rel material:binding:physics = </m>"


def test_the_sand_of_newton_runs_as_it_is(tmp_path):
    """Mass as Newton has it, density times width cubed; materials of the subset; ids and widths in the result; gravity 10."""
    scene = wsim.load(str(SAND), frames=2)
    (sand,) = scene.things("MaterialPoints")
    assert [m.density for m in sand.materials] == [1000.0, 1200.0] and sand.cell == 0.1
    assert np.allclose(np.tan([m.friction_angle for m in sand.materials]), [0.68, 0.8]) and sand.material.young == 1e7
    assert np.array_equal(np.flatnonzero(sand.which), np.arange(100, 150))
    simulation = wsim.Simulation(scene, device="cpu")
    with simulation.record(tmp_path / "out.usda"):
        simulation.run()
    mass = next(m for m in simulation.plan.methods if m.name == "mpm").read_particles(0)["m"]
    assert np.isclose(mass.sum(), 655.36) and np.allclose(mass[100:] / mass[0], 1.2)
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    found = UsdGeom.Points(stage.GetPrimAtPath("/World/Sand"))
    assert np.array_equal(found.GetIdsAttr().Get(2), np.arange(150)) and np.allclose(found.GetWidthsAttr().Get(2), 0.16)
    steps = 24.0
    assert np.allclose(np.array(found.GetVelocitiesAttr().Get(2)), [0, 0, -10 * 2 / steps], atol=1e-5)


def test_each_unread_number_of_newton_is_named_and_no_other(tmp_path):
    body = material('float newton:mpm:hardening = 2\nfloat newton:mpm:hardeningRate = 0.5\nfloat newton:mpm:dilatancy = 0.3\n'
                    'float newton:mpm:yieldPressure = 10\nfloat newton:mpm:viscosity = 3\nfloat newton:mpm:softeningRate = 1')
    (sand,), notes = load(tmp_path, body + points(NEWTON, W + BOUND))
    for name in ("hardening", "hardeningRate", "dilatancy", "yieldPressure"):
        assert f"newton:mpm:{name}" in notes
    assert "softeningRate" not in notes and "viscosity" not in notes and sand.material.viscosity == 3.0


def test_laws_by_what_newton_says(tmp_path):
    """Units of centimetres: pressures are 100 times as many Pa there; a yield stress that is not reached makes jelly."""
    of = {"float newton:mpm:internalFriction = 0\nfloat newton:mpm:youngsModulus = 300": Water,
          "float newton:mpm:internalFriction = 0.5\nfloat newton:mpm:yieldStress = 2": Granular,
          STRESS: Jelly}
    found = {}
    for text, kind in of.items():
        (body,), _ = load(tmp_path, material(text) + points(NEWTON, W + BOUND), metres=0.01)
        assert type(body.material) is kind
        found[kind] = body.material
    assert np.isclose(found[Water].bulk, 30000 / 1.2) and np.isclose(found[Granular].cohesion, 200.0)
    assert np.isclose(found[Jelly].viscosity, 1300 / 2.6) and np.isclose(found[Jelly].young, 3e4)


def test_masses_before_densities(tmp_path):
    body = "float[] widths = [2]\n" + BOUND
    dense = material("float physics:density = 700")
    (a,), _ = load(tmp_path, dense + points(NEWTON, body))
    (b,), _ = load(tmp_path, dense + points(NEWTON, body + "\nfloat physics:density = 500"))
    (c,), _ = load(tmp_path, dense + points(NEWTON, body + "\nfloat physics:mass = 64\nfloat physics:density = 500"))
    (d,), _ = load(tmp_path, dense + points(NEWTON, body + "\nfloat[] physics:masses = [8, 8, 16, 8]"))
    assert [x.material.density for x in (a, b)] == [700.0, 500.0] and np.isclose(c.material.density, 2.0)
    assert np.allclose([m.density for m in d.materials], [1, 2], rtol=1e-12) and d.which.tolist() == [0, 0, 1, 0]


@pytest.mark.parametrize("text, said", [
    (points(NEWTON, ""), "its points have no volume"),
    (points(NEWTON, "float[] widths = [1, 1]"), "2 widths and 4 points"),
    (points(NEWTON, W + "float[] physics:masses = [1, 2]"), "physics:masses has 2 values"),
    (material("float newton:mpm:internalFriction = -1") + points(NEWTON, W + BOUND), "a finite number of 0"),
    (points(NEWTON, W, 'def GeomSubset "a" {\n uniform token elementType = "point"\n uniform token familyName = "materialBind"'
            '\n int[] indices = [7]\n }'), "indices go from 7 to 7; allowed is 0 to 3"),
])
def test_broken_stages_get_one_line(tmp_path, text, said):
    with pytest.raises(wsim.SceneError) as caught:
        load(tmp_path, text)
    assert len(caught.value.problems) == 1 and said in str(caught.value)


def test_bodies_that_are_off_are_left_out(tmp_path):
    on = points(NEWTON, W, name="on")
    off = points(NEWTON, W + "bool physics:bodyEnabled = 0", name="off")
    moved = points(NEWTON, W + "bool physics:kinematicEnabled = 1", name="moved")
    bodies, notes = load(tmp_path, on + off + moved)
    assert [b.path for b in bodies] == ["/on"] and "/off is left out" in notes and "/moved is left out" in notes


PHYSX = '''def PhysxParticleSystem "system" (prepend apiSchemas = ["MaterialBindingAPI"]) {
 float particleContactOffset = 2
 %s
 rel material:binding:physics = </m>
}
'''


@pytest.mark.parametrize("fluid", [True, False])
def test_particles_of_physx(tmp_path, fluid):
    """Fluids rest 2 x 0.594 contact offsets apart, others 2 x 0.99; friction is that of slopes; all else is named."""
    m = material("float physxPBDMaterial:density = 900\nfloat physxPBDMaterial:friction = 0.4\n"
                 "float physxPBDMaterial:surfaceTension = 0.1\nfloat physxPBDMaterial:cohesion = 0", "PhysxPBDMaterialAPI")
    set_ = points(["PhysxParticleSetAPI"], f"bool physxParticle:fluid = {int(fluid)}\n"
                  "rel physxParticle:particleSystem = </system>\nint physxParticle:particleGroup = 0\n"
                  "vector3f[] velocities = [(1, 0, 0), (1, 0, 0), (1, 0, 0), (1, 0, 0)]")
    (body,), notes = load(tmp_path, m + PHYSX % "vector3f wind = (1, 0, 0)\nbool enableCCD = 1" + set_, metres=0.01)
    r = 0.02 * (0.99 * 0.6 if fluid else 0.99)
    assert np.isclose(body.cell, 4 * r) and np.allclose(body.volumes, 8 * r**3) and np.allclose(body.velocity, [0.01, 0, 0])
    assert np.isclose(body.material.density, 900e6) and type(body.material) is (Water if fluid else Granular)
    assert "surfaceTension" in notes and "wind" in notes and "cohesion" not in notes and "enableCCD" not in notes
    assert ("friction" in notes) is fluid and (fluid or np.isclose(np.tan(body.material.friction_angle), 0.4))


def test_own_subsets_ids_widths_and_colours_return(tmp_path):
    """A body with three materials: save, load, run. Colours of each point stay on the prim, those of a shape go to its
    particles."""
    x = np.random.default_rng(0).uniform(-0.1, 0.1, (30, 3))
    colors = np.random.default_rng(1).uniform(0, 1, (30, 3)).astype(np.float32)
    scene = wsim.Scene(frames=2, fps=60)
    scene.mpm("/a", points=x, volumes=1e-5, cell=0.05, material=Granular(), further=(Snow(), Water(bulk=3e4)), colors=colors,
              which=np.arange(30) % 3, ids=np.arange(30)[::-1] + 100, widths=np.linspace(0.01, 0.02, 30))
    scene.mpm("/b", wsim.Box((0.05, 0.05, 0.05)), at=(1, 0, 0), cell=0.05, colors=(0.25, 0.5, 0.75))
    wsim.save(scene, str(tmp_path / "s.usda"))
    loaded = wsim.load(str(tmp_path / "s.usda"))
    one, two = (s.things("MaterialPoints") for s in (scene, loaded))
    assert one[0].materials == two[0].materials and not loaded.notes and np.array_equal(one[0].which, two[0].which)
    assert np.array_equal(one[0].ids, two[0].ids) and np.allclose(one[0].widths, two[0].widths)
    assert np.array_equal(two[0].colors, colors) and np.allclose(two[1].colors, [0.25, 0.5, 0.75])
    simulation = wsim.Simulation(loaded, device="cpu")
    with simulation.record(tmp_path / "out.usdc"):
        simulation.run()
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    for path, color in (("/a", colors), ("/b" + DROPS, [[0.25, 0.5, 0.75]])):
        found = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(path)).GetPrimvar("displayColor")
        assert np.allclose(found.Get(2), color) and found.GetInterpolation() == ("vertex" if path == "/a" else "constant")
    assert np.array_equal(UsdGeom.Points(stage.GetPrimAtPath("/a")).GetIdsAttr().Get(2), one[0].ids)


@pytest.mark.parametrize("more, text", [
    ({"which": [0, 1]}, "which goes from 0 to 1"), ({"ids": [3, 3]}, "two of its ids are the same"),
    ({"widths": [0.1, 0.2, 0.3]}, r"widths is of shape \(3,\)"), ({"colors": np.ones((3, 3))}, r"colors is of shape \(3, 3\)"),
])
def test_rows_of_points_are_as_many_as_points(more, text):
    scene = wsim.Scene()
    scene.mpm("/a", points=np.eye(3)[:2], volumes=1e-5, cell=0.05, **more)
    with pytest.raises(wsim.SceneError, match=text):
        wsim.Simulation(scene, device="cpu")
