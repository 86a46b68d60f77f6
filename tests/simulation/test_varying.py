"""Live values that are sampled in time: a run follows them as if they were set by hand before each frame."""

from dataclasses import replace

import numpy as np
import pytest

from tests.make.usd.usda_soft import SOLID, solid, volume
from tests.make.usda import BIND, SHEET, Reader, cloth, errors, fabric, notes
from wsim import Scene, Simulation
from wsim.cli.run import delay_scene_curves
from wsim.fitting.parameter import parameters_of_names
from wsim.gradient.recording import Recording
from wsim.scene import SceneError, Sphere, Varying, shapes
from wsim.scene.check.scene import check_scene
from wsim.scene.curve import Curve
from wsim.scene.fabric import Fabric
from wsim.usd import load, save

WIND = Curve([0.0, 0.5], np.array([[0.0, 0.0, 0.0], [6.0, 0.0, 1.0]]))
RAMP = Curve([0.1, 0.3], np.array([500.0, 8000.0]))
FRAMES = 6


def flag(*varying: Varying, **more) -> Scene:
    scene = Scene(fps=24.0, **more)
    body = scene.cloth("/flag", *shapes.sheet(1.0, 1.0, 6, 6), drag=1.0, material=Fabric(stretch=500.0))
    scene.pin("/pin", body, range(7))
    scene.varying += varying
    return scene


def blown(**more) -> Scene:
    return flag(Varying("/", "wind", WIND), Varying("/flag", "stretch", RAMP), **more)


def by_hand(sim: Simulation, scene: Scene, first: int, last: int) -> np.ndarray:
    for frame in range(first, last):
        for v in scene.varying:
            sim.set(v.path, v.name, v.curve.at((frame + 0.5) / scene.fps))
        sim.step()
    return sim.positions()


@pytest.mark.parametrize("solver", ["explicit", "xpbd"])
def test_a_run_follows_curves_as_if_each_frame_were_set_by_hand(solver):
    scene = blown(solver=solver)
    sim, other = Simulation(scene, device="cpu"), Simulation(flag(solver=solver), device="cpu")
    other.plan.clock.substeps = sim.plan.clock.substeps          # those of the largest stretch, from the first frame on
    sim.run(FRAMES)
    assert np.array_equal(sim.positions(), by_hand(other, scene, 0, FRAMES)) and not sim.changes
    if solver == "explicit":
        assert "stretch was set" in sim.warnings[0] and len(sim.warnings) == 1


def test_worlds_follow_and_what_is_set_by_hand_stays():
    scene = blown(solver="xpbd")
    one, two = Simulation(scene, device="cpu"), Simulation(scene, device="cpu", worlds=2)
    two.set("/", "wind", (0.0, 0.0, 9.0), world=1)
    one.run(FRAMES), two.run(FRAMES)
    assert np.array_equal(one.positions(), two.positions(world=0))
    assert np.abs(two.plan.method("aero").air.wind.numpy()[1] - (0.0, 0.0, 9.0)).max() == 0.0


def test_a_run_that_goes_on_and_one_after_a_reset_are_the_same_to_the_bit():
    scene = blown(solver="explicit")
    whole, half = (Simulation(scene, device="cpu") for _ in range(2))
    whole.run(FRAMES)
    half.run(FRAMES // 2)
    later_half = Simulation(scene, device="cpu")
    later_half.restart(FRAMES // 2, {"/flag": half.fields("/flag")})
    later_half.run(FRAMES - FRAMES // 2)
    half.reset()
    half.run(FRAMES)
    assert np.array_equal(whole.positions(), later_half.positions()) and np.array_equal(whole.positions(), half.positions())


def test_frames_before_the_start_move_curves_of_values_and_muscles_later():
    scene = blown()
    scene.net("/net", np.eye(3), [[0, 1], [1, 2]], [10.0], [1.0], actuation=RAMP)
    moved = delay_scene_curves(scene, 0.25)
    assert np.array_equal(moved.varying[0].curve.times, WIND.times + 0.25)
    assert np.array_equal(moved.springs[0].actuation.times, RAMP.times + 0.25)


def test_a_recording_refuses_what_varies():
    with pytest.raises(SceneError, match="/: wind varies in time, and a recording has one value"):
        Recording(Simulation(blown(), device="cpu", gradients=True), 2)


@pytest.mark.parametrize(("thing", "said"), [
    (Varying("/", "wind", Curve([0.0], [[np.nan, 0.0, 0.0]])), "/: wind has keys of shape (3,) that are not all finite"),
    (Varying("/", "wind", RAMP), "/: wind has keys of shape ()"),
    (Varying("/flag", "stretch", Curve([0.0, 1.0], [1.0, -1.0])), "/flag: stretch is -1; allowed is a finite number > 0"),
    (Varying("/flag", "thickness", RAMP), "/flag: thickness varies in time, and it is fixed while a scene runs"),
    (Varying("/flag", "damping", RAMP), "it is 0 at the start"), (Varying("/gone", "stretch", RAMP), "nothing of that path"),
    (Varying("/flag", "dynamic_friction", RAMP), "there is no collider")])
def test_what_cannot_vary_is_an_error(thing, said):
    found = [str(p) for p in check_scene(flag(thing)) if p.fatal]
    assert len(found) == 1 and said in found[0]


# From a stage --------------------------------------------------------------------------------------------------------

@pytest.fixture
def read(tmp_path):
    return Reader(tmp_path)


def settings(values: str) -> str:
    return f'def PhysicsScene "p" (prepend apiSchemas = ["WsimSceneAPI"]) {{\n{values}\n}}\n'


HEADER = 'metersPerUnit = 0.01\ntimeCodesPerSecond = 10\nstartTimeCode = 5\nendTimeCode = 25\nupAxis = "Y"'
DRAG = "double wsim:drag = 1"


def test_samples_of_wind_and_gravity_are_curves_in_si_units(read):
    text = cloth(DRAG) + settings("vector3d wsim:wind.timeSamples = {0: (100, 0, 0), 10: (200, 0, 0), 20: (0, 0, 0)}\n"
                                  "float physics:gravityMagnitude.timeSamples = {5: 981, 15: 0}")
    scene = read(text, header=HEADER)
    gravity, wind = scene.varying
    assert (wind.path, wind.name) == ("/", "wind") and wind.curve.times.tolist() == [-0.5, 0.0, 0.5, 1.0, 1.5]
    assert wind.curve.values[:, 0].tolist() == [1.0, 1.5, 2.0, 1.0, 0.0] and scene.wind == (1.5, 0.0, 0.0)
    assert gravity.name == "gravity" and gravity.curve.at(0.5).tolist() == pytest.approx([0.0, -4.905, 0.0])
    assert scene.gravity == pytest.approx((0.0, -9.81, 0.0))


def test_samples_of_a_material_are_curves_of_what_follows_from_them(read):
    text = cloth(BIND) + fabric("float physics:youngsModulus.timeSamples = {0: 1e6, 24: 2e6}\nfloat physics:poissonsRatio = 0")
    scene = read(text)
    assert {v.name for v in scene.varying} == {"stretch", "shear", "bend"} and scene.cloths[0].material.stretch == 1e3
    assert next(v for v in scene.varying if v.name == "stretch").curve.values.tolist() == [1e3, 2e3]
    soft = read(volume(f"{SOLID}\ndouble wsim:pressure.timeSamples = {{0: 10, 24: 20}}")
                + solid("float physics:youngsModulus.timeSamples = {0: 1e5, 24: 2e5}"))
    assert [(v.path, v.name, v.curve.values.tolist()) for v in soft.varying] == [
        ("/ball", "young", [1e5, 2e5]), ("/ball", "pressure", [10.0, 20.0])]


def test_samples_of_a_net_and_of_a_collider_are_curves(read):
    net = ('def BasisCurves "net" (prepend apiSchemas = ["PhysicsDeformableBodyAPI", "WsimSpringsAPI"]) {\n'
           'uniform token type = "linear"\npoint3f[] points = [(0, 0, 0), (1, 0, 0)]\nint[] curveVertexCounts = [2]\n'
           "float[] wsim:masses = [1]\nfloat[] wsim:stiffness.timeSamples = {0: [100], 24: [300]}\n}\n")
    ball = ('def Sphere "ball" (prepend apiSchemas = ["PhysicsCollisionAPI", "WsimColliderAPI", "MaterialBindingAPI"]) {\n'
            f"{BIND}\ndouble wsim:thickness.timeSamples = {{0: 0.1, 24: 0.2}}\n}}\n")
    slip = ('def Material "mat" (prepend apiSchemas = ["PhysicsMaterialAPI"]) {\n'
            "float physics:dynamicFriction.timeSamples = {0: 0.5, 24: 0}\n}\n")
    found = {(v.path, v.name): v.curve.values.ravel().tolist() for v in read(net + ball + slip).varying}
    assert found == {("/net", "stiffness"): [100.0, 300.0], ("/ball", "dynamic_friction"): [0.5, 0.0],
                     ("/ball", "thickness"): [0.1, 0.2]}


@pytest.mark.parametrize(("text", "said"), [
    (cloth(DRAG) + settings("double wsim:airDensity.timeSamples = {0: 1, 24: 2}"), "/p.wsim:airDensity: is sampled in time, "
     "and air_density is fixed while a scene runs: its value at startTimeCode counts"),
    (cloth() + settings("vector3d wsim:wind.timeSamples = {0: (0, 0, 0), 24: (1, 0, 0)}"), "no cloth has drag or lift"),
    (cloth("float physics:mass.timeSamples = {0: 1, 24: 2}"), "/cloth.physics:mass: is sampled in time, and it is fixed"),
    (cloth(BIND) + fabric("double wsim:thickness.timeSamples = {0: 0.001, 24: 0.002}"), "thickness is fixed while a scene"),
    (cloth(BIND) + fabric("double wsim:damping.timeSamples = {0: 0, 24: 0.002}"), "it is 0 at the start")])
def test_samples_of_what_is_fixed_are_noted_and_the_start_counts(read, text, said):
    scene = read(text)
    assert said in notes(scene) and not [v for v in scene.varying if v.name not in ("stretch", "shear", "bend")]
    assert scene.air_density == 1.0 or "airDensity" not in text
    assert scene.cloths[0].mass == 1.0 or "mass" not in text


def test_a_sample_out_of_range_is_an_error(read):
    text = cloth(BIND) + fabric("float physics:surfaceStretchStiffness.timeSamples = {0: 100, 24: -5}")
    assert "/mat: physics:surfaceStretchStiffness is -5" in errors(read, text)


def test_one_sample_counts_where_there_is_no_default_value(read):
    text = cloth(f"{BIND}\nfloat[] physics:masses.timeSamples = {{0: [1, 2, 3, 4]}}", geometry=SHEET)
    scene = read(text + fabric("float physics:surfaceShearStiffness.timeSamples = {3: 7}"))
    assert scene.cloths[0].material.shear == 7.0 and scene.cloths[0].masses.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert not scene.varying and "sampled" not in notes(scene)


def test_two_scenes_are_the_same_only_if_they_vary_alike():
    assert blown() == blown() and blown() != flag() and blown() != replace(blown(), varying=blown().varying[:1])


def test_what_varies_is_saved_and_loaded_again(tmp_path):
    scene = flag(Varying("/", "gravity", Curve([0.0, 0.5], np.array([[0.0, -9.5, 0.0], [0.0, 0.0, 2.0]]))),
                 Varying("/", "wind", WIND), Varying("/flag", "poisson", Curve([0.0, 1.0], np.array([0.0, 0.25]))),
                 Varying("/flag", "stretch", RAMP), gravity=(0.0, -9.5, 0.0))
    scene.cloth("/other", *shapes.sheet(1.0, 1.0, 2, 2), material=scene.cloths[0].material)      # the same, and it stays
    ball = scene.collider("/ball", Sphere(0.1), at=(0.0, -3.0, 0.0))
    scene.varying.append(Varying(ball.path, "thickness", Curve([0.25, 0.5], np.array([0.0, 0.5]))))
    save(scene, tmp_path / "s.usda")
    again = load(tmp_path / "s.usda")
    key = {(v.path, v.name): v.curve for v in again.varying}
    assert set(key) == {(v.path, v.name) for v in scene.varying}
    for v in scene.varying:
        for t in (0.0, *v.curve.times):
            assert key[v.path, v.name].at(t) == pytest.approx(v.curve.at(t), rel=1e-6, abs=1e-6)


def test_a_fit_of_what_varies_is_refused():
    for name, said in (("stretch", "/flag: stretch varies in time"), ("wind_x", "/: wind varies in time")):
        with pytest.raises(SceneError, match=said):
            parameters_of_names(name, [blown()])
