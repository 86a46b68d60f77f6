"""Wrong particles, pours, drains and clusters: one line each, with the path, what is allowed and how to fix it."""

import re
from dataclasses import replace

import numpy as np
import pytest

import wsim
from wsim import Box, Plane, Scene, SceneError, Simulation, Sphere, Surface
from wsim.physics.position_based.objects import ConstraintFluid, Grains, Pour
from wsim.scene.check.scene import check_scene

NAN, INF = float("nan"), float("inf")
CORNERS = 0.1 * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float)
FACES = np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])
OPEN = Surface(CORNERS, np.full(5, 4), FACES[:5].ravel())
EMPTY = Surface(np.zeros((0, 3)), np.zeros(0, int), np.zeros(0, int))
GRID = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), -1).reshape(-1, 3) * 0.02
DOWN = {"velocity": (0, -1, 0)}


def make_scene(**more):
    scene = Scene(fps=60, frames=4, substeps=4, iterations=2, **more)
    scene.collider("/floor", Plane())
    return scene


def told(make):
    """The line that a call or a check raises."""
    with pytest.raises((SceneError, ValueError)) as error:
        scene = make()
        problems = [problem for problem in check_scene(scene) if problem.fatal]
        if problems:
            raise SceneError(problems[:1])
    line = str(error.value)
    assert line.startswith("/p: ") and "\n" not in line and len(line) <= 300
    return line


@pytest.mark.parametrize(("more", "said"), [
    ({"radius": -0.01}, "radius is -0.01; allowed is one length > 0"),
    ({"radius": NAN}, "radius is nan; allowed is one length > 0"),
    ({"radius": None}, "radius is None; allowed is one length > 0"),
    ({"radius": 0.3}, "its shape holds no particle: its radius is 0.3 m; allowed: a shape"),
    ({"radius": 1e-7}, "places; allowed are 3e.07; fix: give a radius of"),
    ({"shape": None, "points": [[0, 0, 0], [NAN, 0, 0]]}, "1 of 2 points are NaN or infinite, first at index 1"),
    ({"shape": None, "points": [[0, 0, 0], [1, 1]]}, "points: found .* where rows of 3 numbers belong; fix: "),
    ({"shape": None, "points": "all"}, "points: found 'all' where rows of 3 numbers belong"),
    ({"shape": None, "points": [[0, 0]]}, "points: found rows of 2 where rows of 3 belong"),
    ({"shape": None, "points": None}, "neither a shape nor points"),
    ({"shape": None, "points": GRID, "radius": "small"}, "radius: found 'small' where numbers belong"),
    ({"shape": None, "points": GRID, "radius": None}, "radii are NaN or infinite"),
    ({"shape": 3.0}, "shape is 3.0; allowed is a closed shape"), ({"shape": Box}, "allowed is a closed shape"),
    ({"shape": Sphere(NAN)}, "radius is nan; allowed: finite and > 0"),
    ({"shape": Sphere(INF)}, "radius is inf; allowed: finite and > 0"),
    ({"shape": OPEN}, "its mesh is open"), ({"shape": EMPTY}, "a surface needs at least one triangle"),
    ({"material": "sand"}, "material is 'sand'; allowed: one of grains, fluid"),
    ({"material": Grains(density=-1.0)}, "density is -1; allowed: finite and > 0"),
    ({"velocity": (0, 1)}, r"velocity of shape \(2,\)"), ({"velocity": "fast"}, "velocity: found 'fast'"),
    ({"velocity": (0, NAN, 0)}, "velocities are NaN"),
    ({"colors": (NAN, 0, 0)}, r"a colour is \(nan, 0, 0\); allowed: linear RGB"),
    ({"colors": (255, 0, 0)}, "divide parts of 255 by 255"), ({"colors": "red"}, "colors: found 'red'"),
    ({"pour": Pour(rate="much"), **DOWN}, "it pours 'much' kg/s; allowed: a finite rate above 0"),
    ({"pour": Pour("now"), **DOWN}, "start of its pour is 'now'; allowed: finite"),
    ({"pour": Pour(0.0, None), **DOWN}, "end of its pour is None; allowed: finite; fix: give a time"),
    ({"pour": Pour(2.0, 1.0), **DOWN}, "it pours from 2 s to 1 s; allowed: an end after the start"),
    ({"pour": Pour()}, "it pours with the velocity .* not all 0"),
    ({"pour": Pour(), "shape": OPEN, **DOWN}, "its mesh is open"),
    ({"pour": Pour(), "radius": 0.5, **DOWN}, "its shape holds no particle")])
def test_wrong_particles_get_a_line(more, said):
    given = {"shape": Box((0.02, 0.02, 0.02)), "at": (0, 0.1, 0), "radius": 0.01} | more
    shape = given.pop("shape")

    def make():
        scene = make_scene()
        scene.particles("/p", shape, **given)
        return scene
    assert re.search(said, told(make))


@pytest.mark.parametrize(("more", "said"), [
    ({"mass": "heavy"}, "it has a mass of 'heavy' kg"), ({"mass": 0.0}, "it has a mass of 0"),
    ({"points": "all"}, "points: found 'all' where rows of 3 numbers belong"), ({"points": []}, "it has no points"),
    ({"stiffness": NAN}, "stiffness is nan"), ({"sizes": [3], "members": [0, 1, 99]}, "is 99; allowed: 0 to 26"),
    ({"at": (0, 1, 0)}, r"at is no argument of scene.clusters; allowed: .*fix: shift its points, or give motion=")])
def test_wrong_clusters_get_a_line(more, said):
    given = {"points": GRID, "mass": 1.0} | more

    def make():
        scene = make_scene()
        scene.clusters("/p", given.pop("points"), **given)
        return scene
    assert re.search(said, told(make))


@pytest.mark.parametrize(("args", "said"), [
    ((None,), "its shape is a NoneType; allowed: a Plane, a closed shape"), ((OPEN,), "its mesh is open"),
    ((Sphere(-1.0),), "radius is -1; allowed: finite and > 0"), ((Sphere(0.1), (0, NAN, 0)), "holds NaN or infinity")])
def test_wrong_drains_get_a_line(args, said):
    def make():
        scene = make_scene()
        scene.particles("/grains", Box((0.02, 0.02, 0.02)), at=(0, 0.1, 0))
        scene.sink("/p", *args)
        return scene
    assert said in told(make)


@pytest.mark.parametrize("more", [{"substeps": None}, {"substeps": "many"}, {"iterations": None}])
def test_counts_of_a_scene_that_are_no_numbers_get_a_line(more):
    scene = replace(make_scene(), **more)
    scene.particles("/p", Box((0.02, 0.02, 0.02)), at=(0, 0.1, 0))
    (name,) = more
    with pytest.raises(SceneError, match=f"^/: {name} is .*; allowed: finite and >= 1; fix: "):
        Simulation(scene, device="cpu")


def test_a_path_that_is_no_text_gets_a_line():
    scene = make_scene()
    scene.particles(3, Box((0.02, 0.02, 0.02)), at=(0, 0.1, 0))
    with pytest.raises(SceneError, match="^/: a path is 3; allowed: an absolute path such as /World/cloth; fix: give a string"):
        Simulation(scene, device="cpu")


def test_more_particles_than_fit_are_refused_before_memory_is_taken(monkeypatch):
    """20 000 grains take 40 MB, of which 10 are free here: at a radius twice as large an eighth comes."""
    from wsim.simulation import simulation
    from wsim.simulation.measure import memory
    monkeypatch.setattr(memory, "free_bytes", lambda device: 1e7)
    monkeypatch.setattr(simulation, "MUCH", 1e6)
    poured = {"pour": Pour(), "velocity": (0, -1, 0)}
    for more in ({}, poured):
        scene = replace(make_scene(), frames=20)
        scene.particles("/p", Box((0.06, 0.06, 0.06)), at=(0, 0.1, 0), radius=0.002, **more)
        with pytest.raises(SceneError, match="^/p: has .* particles, with which the scene takes some .* allowed: 9.537 MiB, "
                                             "which are free on cpu; fix: give particles .* times as large"):
            Simulation(scene, device="cpu")


def test_a_pour_that_began_before_the_scene_brings_what_comes_in_it():
    """From 1 s before the start at 1 kg/s: in 4 frames comes 4/60 kg, to half a particle, and not 1 kg in the first."""
    scene = replace(make_scene(), substeps=8)
    grains = scene.particles("/p", Box((0.03, 0.03, 0.03)), at=(0, 0.5, 0), radius=0.005, velocity=(0, -3, 0),
                             pour=Pour(start=-1.0, rate=1.0))
    simulation = Simulation(scene, device="cpu")
    simulation.run(4)
    m = grains.material.particle_mass(np.array([0.005]))[0]
    assert abs(simulation.indicators()["poured_mass"] - 4 / 60) <= 0.501 * m + 1 / 480
    assert not any("appeared where others were" in warning for warning in simulation.warnings)


def test_fluids_of_two_radii_and_a_viscosity_beyond_reach_are_told():
    scene = make_scene()
    for path, y, radius in (("/q", 0.1, 0.01), ("/p", 0.3, 0.008)):
        scene.particles(path, Box((0.03, 0.03, 0.03)), at=(0, y, 0), radius=radius, material=ConstraintFluid(viscosity=1e9))
    assert "one radius for all fluids of a scene" in told(lambda: scene)
    assert any("give larger particles, or less viscosity" in str(problem) for problem in check_scene(scene))


STAGE = """#usda 1.0
(
    metersPerUnit = 0.01
    upAxis = "Z"
    startTimeCode = {start}
    endTimeCode = {end}
    timeCodesPerSecond = 24
)
def {kind} "p" (prepend apiSchemas = ["WsimParticlesAPI"{beside}])
{{
    double3 xformOp:translate = (0, 0, 20)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    {text}
}}
"""
CUBE = "double size = 10\n double wsim:particles:radius = 1\n"
POURS = CUBE + "double wsim:particles:pourStart = {}\n vector3d wsim:particles:velocity = (0, 0, -100)\n"


def load_stage(tmp_path, text, kind="Cube", beside="", start=0, end=2):
    file = tmp_path / "p.usda"
    file.write_text(STAGE.format(kind=kind, beside=beside, text=text, start=start, end=end))
    return wsim.load(file)


@pytest.mark.parametrize(("text", "more", "said"), [
    ("double size = 10", {}, "has no wsim:particles:radius"),
    ("double size = 10\n double wsim:particles:radius = nan", {}, "wsim:particles:radius is nan"),
    ("double size = 10\n double wsim:particles:radius = 50", {}, "its shape holds no particle: its radius is 0.5 m"),
    ('double size = 10\n string wsim:particles:radius = "1"', {}, "is of type string; allowed is double"),
    (CUBE + 'uniform token wsim:particles:material = "sand"', {}, "wsim:particles:material is 'sand'; allowed is one of"),
    (CUBE + "double wsim:particles:density = -5", {}, "density is -5"),
    (CUBE + "color3f[] primvars:displayColor = [(nan, 0, 0)]", {}, "a colour is (nan, 0, 0)"),
    (CUBE, {"beside": ', "WsimMaterialPointsAPI"'}, "has WsimParticlesAPI and WsimMaterialPointsAPI; allowed is one"),
    (CUBE, {"beside": ', "WsimMaterialSinkAPI"'}, "has WsimParticlesAPI and WsimMaterialSinkAPI; allowed is one"),
    (CUBE, {"beside": ', "PhysicsRigidBodyAPI"'}, "has WsimParticlesAPI and PhysicsRigidBodyAPI; allowed is one"),
    (CUBE, {"kind": "Xform"}, "is a Xform with WsimParticlesAPI; author it on Points"),
    (CUBE, {"kind": "Plane"}, "a Plane has no end to fill"),
    ("point3f[] points = []\n float[] widths = [1]", {"kind": "Points"}, "no particles; allowed: one at least"),
    ("point3f[] points = [(0, 0, 0)]\n float[] widths = [1, 1]", {"kind": "Points"}, "has 2 widths and 1 points"),
    ("point3f[] points = [(0, 0, 0)]\n float[] widths = [-1]", {"kind": "Points"}, "radii are too small, first -0.005"),
    ("point3f[] points = [(0, 0, nan)]\n float[] widths = [1]", {"kind": "Points"}, "points are NaN or infinite"),
    ("point3f[] points = [(0, 0, 0)]", {"kind": "Points"}, "has neither widths nor wsim:particles:radius"),
    (POURS.format("nan"), {}, "start of its pour is nan"),
    (POURS.format("5\n double wsim:particles:pourEnd = 2"), {}, "allowed: an end after the start"),
    (POURS.format("0\n double wsim:particles:pourRate = -1"), {}, "it pours -1 kg/s; allowed: a finite rate above 0"),
    (POURS.format("0").replace("(0, 0, -100)", "(0, 0, 0)"), {}, "not all 0")])
def test_wrong_stages_get_a_line(tmp_path, text, more, said):
    with pytest.raises(SceneError) as error:
        Simulation(load_stage(tmp_path, text, **more), device="cpu")
    lines = [line for line in str(error.value).splitlines() if said in line]
    assert len(lines) == 1 and lines[0].startswith("/p") and len(lines[0]) <= 300


def test_points_under_a_scale_are_told(tmp_path):
    points = "point3f[] points = [(0, 0, 0)]\n float[] widths = [1]\n double3 xformOp:scale = (2, 2, 2)\n"
    text = STAGE.format(kind="Points", beside="", text=points, start=0, end=2)
    file = tmp_path / "p.usda"
    file.write_text(text.replace('["xformOp:translate"]', '["xformOp:translate", "xformOp:scale"]'))
    assert any("scales by 2, and the radii" in note for note in map(str, wsim.load(file).notes))


def test_a_bound_physics_material_says_what_own_attributes_do_not(tmp_path):
    """The stage is in centimetres and kilograms; a density of 0 says nothing in UsdPhysics."""
    bound = CUBE + """rel material:binding:physics = </p/stuff>
        double wsim:particles:staticFriction = 0.9
        def Material "stuff" (prepend apiSchemas = ["PhysicsMaterialAPI"])
        {{
            float physics:staticFriction = 0.1
            float physics:dynamicFriction = 0
            float physics:density = {}
        }}
    """
    heavy, plain = (load_stage(tmp_path, bound.format(density), beside=', "MaterialBindingAPI"').things("Particles")[0].material
                    for density in ("0.004", "0"))
    assert (heavy.static_friction, heavy.dynamic_friction, heavy.density) == (0.9, 0.0, pytest.approx(4000.0))
    assert plain.density == Grains().density


def test_a_stage_in_centimetres_with_z_up_falls_as_one_in_metres(tmp_path):
    """A cube of 10 cm of grains of 1 cm, 20 cm high; time codes that run backward are told, and frames are simulated."""
    scene = load_stage(tmp_path, CUBE, start=48, end=0)
    assert any("endTimeCode 0 comes before startTimeCode 48" in str(note) for note in scene.notes)
    simulation = Simulation(scene, device="cpu")
    x = simulation.positions("/p").copy()
    assert np.abs(x - [0, 0, 0.2]).max() < 0.05 and len(x) == 2 * 3**3
    simulation.step()
    fallen = simulation.positions("/p") - x
    assert np.allclose(fallen[:, :2], 0.0, atol=1e-6) and fallen[:, 2].mean() < -0.5 * 9.81 / 24**2
