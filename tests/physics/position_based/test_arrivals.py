"""Particles that pour in and that sinks take: masses, places, streams, bits, restarts, results, bad input."""

import numpy as np
import pytest

import wsim
from wsim.physics.position_based.objects import ConstraintFluid, Grains, Pour
from wsim.scene.check.scene import check_scene

RADIUS = 0.005
MASS = {"grains": 2600.0 * 4.0 / 3.0 * np.pi * RADIUS**3, "fluid": 1000.0 * (2.0 * RADIUS)**3}


def make_scene(frames=24, gravity=(0, -9.81, 0), **more):
    return wsim.Scene(fps=60, frames=frames, substeps=8, iterations=4, gravity=gravity, **more)


def pour(scene, material="grains", path="/spout", at=(0, 0.3, 0), velocity=(0, -1, 0), **more):
    given = {"start": 0.0, "end": np.inf, "rate": None} | {k: more.pop(k) for k in ("start", "end", "rate") if k in more}
    return scene.particles(path, wsim.Sphere(0.03), at=at, radius=RADIUS, material=material, velocity=velocity,
                           pour=Pour(**given), **more)


def run(scene, frames=None, **more):
    simulation = wsim.Simulation(scene, device="cpu", **more)
    simulation.run(frames)
    return simulation


@pytest.mark.parametrize("material", ["grains", "fluid"])
def test_a_rate_is_kept_to_a_particle_and_a_substep(material):
    """What has come is rate (t - start), to half a particle and what comes in a substep."""
    scene, m = make_scene(12), MASS[material]
    pour(scene, material, start=0.02, end=0.12, rate=0.15)
    simulation = wsim.Simulation(scene, device="cpu")
    for frame in range(1, 13):
        simulation.step()
        said = simulation.indicators()
        expected = 0.15 * np.clip(frame / 60 - 0.02, 0.0, 0.1)
        assert abs(said["poured_mass"] - expected) <= 0.501 * m + 0.15 / 480
        assert np.isclose(said["particle_mass"], m * said["particles"], rtol=1e-5)
        assert len(simulation.positions("/spout")) == len(simulation.velocities("/spout")) == said["particles"]
    assert abs(said["poured_mass"] - 0.15 * 0.1) <= 0.501 * m and not simulation.warnings


def test_a_stream_falls_as_a_stone_does():
    """Each keeps the velocity that it comes with, and falls by the steps of backward Euler: v = g h n exactly."""
    scene = make_scene()
    pour(scene, rate=0.05)
    simulation = run(scene)
    v, x = simulation.velocities("/spout"), simulation.positions("/spout")
    steps = np.round((-1.0 - v[:, 1]) / (9.81 / 480))
    assert np.allclose(v[:, 1], -1.0 - 9.81 / 480 * steps, atol=1e-4) and np.allclose(v[:, [0, 2]], 0.0, atol=1e-6)
    source = run_source_heights(scene)[:len(x)]
    assert np.abs(source - steps / 480 - 9.81 / 480**2 * 0.5 * steps * (steps + 1) - x[:, 1]).max() < 1.05 / 480
    assert steps.max() > 150


def run_source_heights(scene):
    """Where each particle comes, height [m]."""
    thing = scene.things("Particles")[0]
    return thing.pouring_shape().pour_points(0, 500, 60.0).x[:, 1]


def test_nothing_that_comes_overlaps_what_has_come():
    """At the greatest rate columns and their particles stand a diameter apart, or more."""
    for material in ("grains", "fluid"):
        scene = make_scene(6, gravity=(0, 0, 0))
        pour(scene, material)
        simulation = run(scene)
        x = simulation.positions("/spout")
        apart = np.linalg.norm(x[:, None] - x, axis=2) + np.eye(len(x))
        assert len(x) > 200 and apart.min() > 2.0 * RADIUS * (1.0 - 1e-3)
        assert simulation.indicators()["crowded_particles"] == 0 and not simulation.warnings


def test_what_comes_into_others_is_counted():
    scene = make_scene(30)
    scene.collider("/floor", wsim.Plane())
    scene.particles("/heap", wsim.Box((0.04, 0.04, 0.04)), at=(0, 0.04, 0), radius=RADIUS)
    pour(scene, at=(0, 0.05, 0), rate=0.05)
    simulation = run(scene)
    assert simulation.indicators()["crowded_particles"] > 0
    assert any("appeared where others were" in each for each in simulation.warnings)


@pytest.mark.parametrize("material", ["grains", "fluid"])
def test_poured_less_taken_is_there(material):
    """A sink takes what falls into it, and nothing beside it; the balance holds in each frame, to the particle."""
    scene = make_scene(40)
    scene.collider("/floor", wsim.Plane())
    pour(scene, material, rate=0.1)
    scene.particles("/still", points=[(0.5, RADIUS, 0), (0.5, RADIUS, 0.1)], radius=RADIUS, material=material)
    scene.sink("/drain", wsim.Box((0.2, 0.02, 0.2)), at=(0, 0.1, 0))
    simulation = wsim.Simulation(scene, device="cpu")
    for _ in range(40):
        simulation.step()
        said = simulation.indicators()
        assert said["particles"] == 2 + said["poured_particles"] - said["taken_particles"]
        x = simulation.positions("/spout")
        assert len(x) + len(simulation.positions("/still")) == said["particles"]
        assert not len(x) or x[:, 1].min() > 0.12 - 0.02                     # at most a substep's way deep
    assert said["taken_particles"] > 20 and len(simulation.positions("/still")) == 2


def test_what_has_not_come_and_what_is_gone_meets_nothing():
    """A grain flies through the places where others will come, and a body through those of what is gone."""
    scene = make_scene(20, gravity=(0, 0, 0))
    pour(scene, at=(0, 0, 0), velocity=(0, 1, 0), start=0.3, rate=0.05)
    scene.particles("/fly", points=[(-0.1, 0, 0)], radius=RADIUS, velocities=[(1.0, 0, 0)])
    scene.body("/brick", wsim.Box((0.02, 0.02, 0.02)), at=(0, 0, -0.15), velocity=(0, 0, 1.0))
    simulation = run(scene, 17)
    assert np.allclose(simulation.positions("/fly"), [[-0.1 + 17 / 60, 0, 0]], atol=1e-5)
    assert np.allclose(simulation.poses("/brick")["/brick"][:3, 3], [0, 0, -0.15 + 17 / 60], atol=1e-5)


def test_two_runs_and_one_that_goes_on_have_the_same_bits():
    def make():
        scene = make_scene(24)
        scene.collider("/floor", wsim.Plane(), static_friction=0.5, dynamic_friction=0.5)
        pour(scene, rate=0.2)
        pour(scene, "fluid", "/water", at=(0.1, 0.2, 0), rate=0.1)
        scene.sink("/drain", wsim.Box((0.01, 0.02, 0.05)), at=(0.02, 0.02, 0))
        return scene
    whole, other = run(make()), run(make(), 12)
    again = wsim.Simulation(make(), device="cpu")
    again.restart(12, {path: other.fields(path) for path in other.state.paths()})
    again.run(12)
    other.run(12)
    for path in ("/spout", "/water"):
        assert len(whole.positions(path)) > 10
        for each in (other, again):
            assert np.array_equal(whole.positions(path), each.positions(path))
            assert np.array_equal(whole.velocities(path), each.velocities(path))


def test_a_run_longer_than_the_scene_says_that_nothing_comes_any_more():
    scene = make_scene(6)
    pour(scene, rate=0.2)
    simulation = run(scene, 12)
    assert len(simulation.positions("/spout")) - len(run(scene, 6).positions("/spout")) in (0, 1)       # of the last substep
    assert any("nothing comes after frame 6" in each for each in simulation.warnings)


def test_a_source_that_moves_adds_its_velocity():
    turned = np.eye(4)
    turned[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    values = np.array([turned, turned])
    values[1, 2, 3] = 2.0
    scene = make_scene(gravity=(0, 0, 0))
    scene.particles("/spout", wsim.Sphere(0.03), motion=wsim.Motion(np.array([0.0, 1.0]), values), radius=RADIUS,
                    velocity=(3, 0, 0), pour=Pour(end=0.05))
    simulation = run(scene, 4)
    assert np.allclose(simulation.velocities("/spout"), [0, 3, 2], atol=1e-3)


def test_results_hold_what_is_there_with_its_ids(tmp_path):
    from pxr import Usd, UsdGeom
    scene = make_scene(20)
    scene.collider("/floor", wsim.Plane())
    pour(scene, rate=0.1)
    scene.particles("/heap", points=[(0, 0.01, 0), (0.3, 0.005, 0)], radius=RADIUS)
    scene.sink("/drain", wsim.Box((0.1, 0.02, 0.1)))
    wsim.save(scene, tmp_path / "scene.usda")
    loaded = wsim.load(tmp_path / "scene.usda", frames=20)
    assert loaded.things("Particles")[0].pour == Pour(rate=0.1) and not loaded.notes
    simulation = wsim.Simulation(loaded, device="cpu")
    with simulation.record(tmp_path / "out.usdc"):
        simulation.run(20)
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    spout, heap = (UsdGeom.Points(stage.GetPrimAtPath(path)) for path in ("/spout_drops", "/heap"))
    assert [len(heap.GetPointsAttr().Get(t)) for t in (0, 1, 20)] == [2, 1, 1] and list(heap.GetIdsAttr().Get(20)) == [1]
    for t in (0, 4, 20):
        assert len({len(a.Get(t)) for a in (spout.GetPointsAttr(), spout.GetIdsAttr(), spout.GetVelocitiesAttr(),
                                            spout.GetWidthsAttr())}) == 1
    assert np.allclose(np.array(spout.GetPointsAttr().Get(20)), simulation.positions("/spout"), atol=1e-6)
    assert not stage.GetPrimAtPath("/spout").HasAttribute("points")


def test_a_closed_shape_in_usd_is_filled(tmp_path):
    from pxr import Usd, UsdGeom
    (tmp_path / "cube.usda").write_text("""#usda 1.0
        (metersPerUnit = 0.01
         upAxis = "Y")
        def Cube "Block" (prepend apiSchemas = ["WsimParticlesAPI"])
        {
            double size = 6
            double3 xformOp:translate = (0, 3, 0)
            uniform token[] xformOpOrder = ["xformOp:translate"]
            double wsim:particles:radius = 0.5
            vector3d wsim:particles:velocity = (0, 0, 20)
        }
        def Plane "Floor" (prepend apiSchemas = ["PhysicsCollisionAPI"])
        {
            uniform token axis = "Y"
        }
        """)
    scene = wsim.load(tmp_path / "cube.usda", frames=2)
    block = scene.things("Particles")[0]
    assert len(block.points) == 128 and np.abs(block.points).max() <= 0.025 and np.allclose(block.velocities, (0, 0, 0.2))
    simulation = wsim.Simulation(scene, device="cpu")
    with simulation.record(tmp_path / "out.usdc"):
        simulation.run(2)
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    points = UsdGeom.Points(stage.GetPrimAtPath("/Block_drops"))
    assert len(points.GetPointsAttr().Get(1)) == 128
    wsim.save(scene, tmp_path / "again.usda")
    assert wsim.load(tmp_path / "again.usda", frames=2).things("Particles")[0] == block


@pytest.mark.parametrize(("more", "said"), [
    ({"velocity": (0, 0, 0)}, "velocity [0.0, 0.0, 0.0]"), ({"velocity": None}, "velocity [0.0, 0.0, 0.0]"),
    ({"velocity": (0, np.nan, 0)}, "three numbers"), ({"rate": 0.0}, "pours 0 kg/s"), ({"rate": -1.0}, "a finite rate above 0"),
    ({"rate": 1e6}, "carries"), ({"end": -1.0}, "an end after the start"), ({"start": np.nan}, "start of its pour"),
    ({"at": (0, -0.05, 0)}, "it pours into /floor")])
def test_bad_pours_are_refused_in_a_line(more, said):
    scene = make_scene(6)
    scene.collider("/floor", wsim.Plane())
    pour(scene, **more)
    found = [problem for problem in check_scene(scene) if problem.fatal]
    assert len(found) == 1 and said in str(found[0]) and len(str(found[0])) < 300


def test_shapes_that_cannot_pour_are_refused():
    scene = make_scene(6)
    for k, (shape, more) in enumerate([(wsim.Plane(), {}), (wsim.Sphere(0.002), {}),
                                       (wsim.Sphere(0.03), {"radius": [0.01, 0.02]}), (wsim.Sphere(0.03), {"radius": np.nan}),
                                       (wsim.Sphere(0.03), {"radius": -1.0}),
                                       (wsim.Sphere(5.0), {"radius": 1e-4, "velocity": (100, 0, 0)})]):
        given = {"radius": RADIUS, "velocity": (0, 1, 0), "pour": Pour()} | more
        scene.particles(f"/bad{k}", shape, **given)
    found = [problem for problem in check_scene(scene) if problem.fatal]
    assert {problem.path for problem in found} == {f"/bad{k}" for k in range(6)}
    with pytest.raises(wsim.SceneError, match="neither a shape nor points"):
        scene.particles("/worse", radius=0.01, pour=Pour())
    with pytest.raises(ValueError, match="allowed is a Pour"):
        scene.particles("/worst", wsim.Sphere(0.03), radius=0.01, pour=3.0)


@pytest.mark.parametrize(("kind", "body", "api", "said"), [
    ("Mesh", "point3f[] points = [(0,0,0),(1,0,0),(0,1,0)]\nint[] faceVertexCounts = [3]\nint[] faceVertexIndices = [0,1,2]",
     "", "its mesh is open"),
    ("Sphere", "double radius = -1", "", "-1"), ("Cube", "", '"PhysicsRigidBodyAPI", ', "allowed is one of them"),
    ("Plane", "", "", "has no end to fill"), ("Xform", "", "", "is a Xform")])
def test_prims_that_cannot_be_filled_are_refused_in_a_line(tmp_path, kind, body, api, said):
    file = tmp_path / "bad.usda"
    file.write_text(f"""#usda 1.0
(metersPerUnit = 1)
def {kind} "P" (prepend apiSchemas = [{api}"WsimParticlesAPI"])
{{
{body}
double wsim:particles:radius = 0.05
}}
""")
    with pytest.raises(wsim.SceneError) as refused:
        wsim.Simulation(wsim.load(file), device="cpu")
    lines = str(refused.value).splitlines()
    assert len(lines) == 1 and said in lines[0] and len(lines[0]) < 300


def test_particles_that_are_colliders_too_are_particles(tmp_path):
    """Files of PhysX have PhysicsCollisionAPI on particles."""
    file = tmp_path / "both.usda"
    file.write_text("""#usda 1.0
(metersPerUnit = 1)
def Sphere "P" (prepend apiSchemas = ["WsimParticlesAPI", "PhysicsCollisionAPI"])
{
    double radius = 0.1
    double wsim:particles:radius = 0.02
}
""")
    scene = wsim.load(file)
    assert len(scene.things("Particles")) == 1 and not scene.colliders


def test_a_sink_where_nothing_can_vanish_is_warned_of():
    scene = make_scene(2)
    scene.cloth("/cloth", [(0, 0, 0), (1, 0, 0), (0, 0, 1)], [3], [0, 1, 2])
    scene.sink("/drain", wsim.Box((0.1, 0.1, 0.1)))
    assert any("there are no particles" in str(problem) for problem in check_scene(scene))


@pytest.mark.parametrize(("more", "said"), [
    ({"start": 0.2}, "behind the last frame"), ({"start": -1.0, "end": -0.5}, "before the first frame"),
    ({"start": -0.1}, "--preroll 6"), ({"rate": 1e-4}, "nothing comes: it pours 0.0001 kg/s for 0.1 s")])
def test_a_pour_that_brings_nothing_or_begins_early_is_warned_of(more, said):
    scene = make_scene(6)
    pour(scene, **more)
    found = [str(problem) for problem in check_scene(scene)]
    assert len(found) == 1 and said in found[0] and "fix:" in found[0] and len(found[0]) < 300


def test_a_sink_that_took_nothing_is_named_with_the_nearest_particle():
    """The lowest of the stream tells how far away it is; a sink below it, half of all space, takes some, and is not named."""
    scene = make_scene(12)
    pour(scene, rate=0.05)
    scene.sink("/drain", wsim.Box((0.01, 0.01, 0.01)), at=(0, -1, 0))
    scene.sink("/below", wsim.Plane(), at=(0, 0.2, 0))
    simulation = run(scene)
    x = simulation.positions("/spout")
    away = np.linalg.norm(np.maximum(np.abs(x - [0, -1, 0]) - 0.01, 0.0), axis=1).min()
    assert len(simulation.warnings) == 1
    assert f"/drain: it has taken nothing in 12 frames, and the nearest particle is {away:.3g} m" in simulation.warnings[0]


@pytest.mark.parametrize(("fps", "start", "preroll"), [(24, 0, 0), (30, 101, 0), (30, 101, 10)])
def test_pours_of_a_stage_begin_at_their_time_code(tmp_path, fps, start, preroll):
    """Nothing is there up to the code where a pour begins, whatever the frame rate, the first code and the preroll; then rate
    times time."""
    from pxr import Usd, UsdGeom

    from tests.make.cli.cli import run as run_command
    (tmp_path / "pour.usda").write_text(f"""#usda 1.0
        (metersPerUnit = 0.01
         upAxis = "Y"
         startTimeCode = {start}
         endTimeCode = {start + 8}
         timeCodesPerSecond = {fps})
        def PhysicsScene "Physics" (prepend apiSchemas = ["WsimSceneAPI"])
        {{
            uniform int wsim:substeps = 8
        }}
        def Sphere "Spout" (prepend apiSchemas = ["WsimParticlesAPI"])
        {{
            double radius = 3
            double wsim:particles:radius = 0.5
            vector3d wsim:particles:velocity = (0, -100, 0)
            double wsim:particles:pourStart = {start + 3}
            double wsim:particles:pourEnd = {start + 6}
            double wsim:particles:pourRate = 1.5
        }}
        """)
    out = str(tmp_path / "out.usdc")
    assert run_command(str(tmp_path / "pour.usda"), out, *["--preroll", str(preroll)] * (preroll > 0)) == 0
    stage = Usd.Stage.Open(out)
    points = UsdGeom.Points(stage.GetPrimAtPath("/Spout_drops")).GetPointsAttr()
    for code in range(9):
        came = 1.5 * np.clip(code - 3, 0, 3) / fps / MASS["grains"]
        assert abs(len(points.Get(start + code)) - came) <= 0.501 + 1.5 / (8 * fps) / MASS["grains"]


def test_during_a_preroll_only_what_starts_before_comes():
    from wsim.cli.run import delay_scene_curves
    for begin, came in ((0.0, 0.0), (-0.05, 0.15 * 0.05)):
        scene = make_scene(6)
        pour(scene, start=begin, rate=0.15)
        simulation = run(delay_scene_curves(scene, 0.1), 6)
        assert abs(simulation.indicators()["poured_mass"] - came) <= 0.501 * MASS["grains"] + 0.15 / 480
        simulation.run(6)
        assert abs(simulation.indicators()["poured_mass"] - came - 0.15 * 0.1) <= 1.001 * MASS["grains"] + 0.15 / 480


def test_masses_of_materials_pour():
    for material in (Grains(density=1000.0), ConstraintFluid(density=500.0)):
        scene = make_scene(8)
        thing = pour(scene, material, rate=0.02)
        m = thing.material.particle_mass(np.array([RADIUS]))[0]
        assert np.isclose(run(scene).indicators()["poured_mass"], 0.02 * 8 / 60, atol=0.501 * m + 0.02 / 480)
