"""On a GPU: the same motion as on the CPU, the same bits twice, growth and replay. Skipped where there is no CUDA device."""

import numpy as np
import pytest
import warp as wp

from tests.make.gradient.gradients import bar, sheet
from tests.make.physics.cloth.muscles import SOLVERS as PULLED
from tests.make.physics.cloth.muscles import crawler, muscled
from tests.make.physics.contact.collider_adjoint import slid
from tests.make.physics.contact.project_adjoint import SOLVERS, dropped
from tests.make.physics.contact.restitution import ball
from tests.make.physics.soft.plastic_adjoint import LEAPFROG, NEWTON, yielding
from tests.make.physics.solver.newton_adjoint_contacts import NEWTON as SOLVED
from tests.make.physics.solver.newton_adjoint_limits import landed, pulled
from tests.make.simulation.simulation import chain, drape
from tests.make.simulation.ties import laid
from tools.bench.nets import reference
from wsim.gradient.recording import Recording
from wsim.physics.solver import batch, coarse_space
from wsim.scene import Pin, Plane, Scene, Sphere, shapes
from wsim.scene.curve import Motion
from wsim.scene.fabric import Fabric
from wsim.scene.solid import Bulk
from wsim.simulation.simulation import Simulation

wp.init()
pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")


def hanging(**more) -> Scene:
    """A cloth held by its upper edge with every soft constraint: it does not amplify perturbations."""
    scene = Scene(solver="xpbd", fps=60.0, substeps=8, iterations=4, **more)
    cloth = scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, 20, 20), drag=1.0, lift=0.5,
                        material=Fabric(stretch=800.0, bend=1e-4, damping=1e-3))
    scene.wind = (0.0, 0.0, 2.0)
    scene.pin("/pins", cloth, range(21))
    return scene


def ends(scene, frames, *devices, **options):
    for device in devices:
        sim = Simulation(scene, device=device, **options)
        sim.run(frames)
        yield sim.positions(scene.bodies()[0].path)


def gradients(scene, frames, loss=None, keep="auto", devices=("cpu", "cuda:0")):
    """One after the other, of recordings in float64; loss(recording): derivatives by positions, else at the end those of the
    first body at the start."""
    path = scene.bodies()[0].path
    for device in devices:
        recording = Recording(Simulation(scene, device=device, precision="float64", gradients=True), frames, keep)
        yield recording.backward(loss(recording) if loss else {frames: {path: recording.positions(0, path)}})


@pytest.mark.parametrize("precision, bound", [("float32", 1e-6), ("float64", 1e-13)])
@pytest.mark.parametrize("integrator", ["backward_euler", "bdf2"])
def test_cpu_and_gpu_agree(precision, bound, integrator):
    cpu, gpu = ends(hanging(integrator=integrator), 10, "cpu", "cuda:0", precision=precision)
    assert reference.rms(cpu - gpu) < bound * 1.0                       # the scene is 1 m in size


def test_springs_model_and_large_colours_agree():
    scene = reference.spring_cloth(64)
    scene.solver, scene.substeps, scene.iterations = "xpbd", 8, 2
    cpu, gpu = ends(scene, 10, "cpu", "cuda:0")
    assert reference.rms(cpu - gpu) < 1e-6


@pytest.mark.parametrize("n, cluster", [(8, 16), (16, 16), (32, 16), (64, 16), (80, None)])
def test_explicit_steps_agree_however_they_are_launched(n, cluster):
    """By a cluster of blocks, by launches, and by one CPU thread: three kernels for one law."""
    scene = reference.spring_cloth(n)
    scene.solver = "explicit"
    sim = Simulation(scene, device="cuda:0", precision="float64")
    sim.run(5)
    found = sim.plan.method("explicit").pull.cluster
    assert (found and found.size) == cluster
    (cpu,) = ends(scene, 5, "cpu", precision="float64")
    assert reference.rms(cpu - sim.positions()) < 1e-14


@pytest.mark.parametrize("settings", [{"integrator": "rk4"}, {"integrator": "leapfrog"}, {"integrator": "symplectic_euler"},
                                      {"solver": "implicit", "integrator": "bdf2", "substeps": 4, "iterations": 2}])
def test_membranes_hinges_wind_and_damping_agree_under_every_solver(settings):
    scene = hanging()
    scene.solver, scene.substeps = "auto", 400
    for name, value in settings.items():
        setattr(scene, name, value)
    cpu, gpu, again = ends(scene, 5, "cpu", "cuda:0", "cuda:0", precision="float64")
    assert reference.rms(cpu - gpu) < (1e-7 if scene.solver == "implicit" else 1e-13)      # its solves end at a tolerance
    assert np.array_equal(gpu, again)


def test_a_cluster_takes_6400_points_in_float32():
    scene = reference.spring_cloth(80)
    scene.solver = "explicit"
    sim = Simulation(scene, device="cuda:0")
    sim.run(5)
    (cpu,) = ends(scene, 5, "cpu")
    assert sim.plan.method("explicit").pull.cluster.threads == 416 and reference.rms(cpu - sim.positions()) < 1e-7


def test_a_moving_pin_takes_its_point_along_in_a_cluster():
    scene = reference.spring_cloth(8)
    matrices = np.tile(np.eye(4), (2, 1, 1))
    matrices[1, 1, 3] = 0.5
    scene.solver, scene.pins[0].motion = "explicit", Motion([0.0, 0.5], matrices)
    cpu, gpu = ends(scene, 6, "cpu", "cuda:0", precision="float64")
    assert reference.rms(cpu - gpu) < 1e-13 and abs(gpu[0, 1] - 0.1) < 1e-12


def test_explicit_steps_and_contacts_agree():
    scene = drape()
    scene.solver, scene.integrator, scene.substeps = "explicit", "leapfrog", 64
    (end,) = ends(scene, 30, "cuda:0")
    assert np.linalg.norm(end - (0.02, -0.27, 0.01), axis=1).min() > 0.25 - 1e-4


def test_two_runs_have_the_same_bits():
    first, second = ends(drape(), 20, "cuda:0", "cuda:0")
    assert np.array_equal(first, second)


def test_a_drape_rests_on_its_ball():
    (end,) = ends(drape(), 40, "cuda:0")
    assert np.linalg.norm(end - (0.02, -0.27, 0.01), axis=1).min() > 0.25 - 1e-4


def test_more_contacts_than_room_repeat_the_frame():
    scene = Scene(solver="xpbd", fps=60.0, substeps=4)
    scene.net("/net", [[0, 0.05, 0], [0.1, 0.05, 0]], [[0, 1]], [100.0], [0.1], radius=0.02)
    for k in range(5):
        scene.collider(f"/ball{k}", Sphere(0.3), at=(0.05, -0.3, 0.0))
    sim = Simulation(scene, device="cuda:0")
    sim.run(5)
    assert any("repeated" in w for w in sim.repeats)


def test_worlds_live_parameters_and_arrays_on_the_device():
    scene = chain(4, substeps=4, iterations=4, air_drag=8.0)
    sim = Simulation(scene, device="cuda:0", worlds=3)
    sim.run(200)
    array, index = sim.positions("/chain", world=2, device=True)
    assert array is sim.state.x and array.device.is_cuda and index.min() == 10
    soft = sim.positions("/chain", world=2)[-1, 1] + 0.4
    sim.set("/chain", "stiffness", 400.0)
    sim.run(200)
    assert sim.positions("/chain", world=1)[-1, 1] + 0.4 == pytest.approx(soft / 2, rel=1e-2)


def test_a_live_rest_shape_does_what_it_does_on_the_cpu():
    """By a cluster of blocks, by sweeps whose compliance was one, by Newton's method."""
    for make, settings in ((sheet, {"model": "springs"}), (sheet, {"model": "membrane", "solver": "xpbd", "substeps": 4}),
                           (bar, {"model": "corotational", "solver": "implicit", "substeps": 2})):
        found = []
        for device in ("cpu", "cuda:0"):
            sim = Simulation(make(**{"integrator": "auto"} | settings), device=device, precision="float64")
            sim.run(1)
            sim.set(sim.scene.bodies()[0].path, "rest_shape", sim.scene.bodies()[0].points * (1.1, 0.95, 1.0))
            sim.run(2)
            found.append(sim.positions())
        assert np.abs(found[0] - found[1]).max() < 1e-7


def test_a_plane_stops_a_cloth():
    scene = Scene(solver="xpbd", fps=60.0, substeps=8, iterations=2)
    scene.cloth("/cloth", *shapes.sheet(0.5, 0.5, 8, 8, horizontal=True))
    turned = np.eye(4)
    turned[:3, :3], turned[1, 3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]], -0.3
    scene.collider("/floor", Plane(), motion=Motion.still(turned))
    (end,) = ends(scene, 60, "cuda:0")
    assert end[:, 1].min() > -0.3


@pytest.mark.parametrize("model", ["corotational", "neo_hookean"])
@pytest.mark.parametrize("cells, precision, bound", [(4, "float64", 1e-9), (4, "float32", 2e-6), (12, "float32", 2e-6)])
def test_soft_bodies_agree(model, cells, precision, bound):
    """Solved to the end: what conjugate gradients leave depends on the order of sums. 12 cells a side take several blocks."""
    scene = Scene(fps=60.0, substeps=2, iterations=4, solver="implicit")
    points, tets = shapes.block((1.0, 1.0, 1.0), (cells, cells, cells))
    body = scene.soft("/cube", points, tets, material=Bulk(young=2e5, model=model, damping=0.01))
    scene.pin("/wall", body, np.flatnonzero(points[:, 0] < -0.499))
    cpu, gpu = ends(scene, 5, "cpu", "cuda:0", precision=precision)
    assert reference.rms(cpu - gpu) < bound * 1.0
    scene.solver = "explicit"
    cpu, gpu = ends(scene, 5, "cpu", "cuda:0", precision=precision)
    assert reference.rms(cpu - gpu) < bound * 1.0


@pytest.mark.parametrize("settings", [{"solver": "implicit", "integrator": "bdf2", "substeps": 2, "iterations": 4},
                                      {"solver": "explicit", "integrator": "leapfrog", "substeps": 60, "iterations": 1}])
def test_pressure_and_plastic_flow_agree(settings):
    """A bar that bends under its weight beyond its yield, blown up a little."""
    scene = Scene(fps=60.0, **settings)
    points, tets = shapes.block((0.6, 0.2, 0.2), (6, 2, 2))
    soft = scene.soft("/bar", points, tets, material=Bulk(2e4, 0.3, 1e3, yield_strain=0.02))
    soft.pressure = 500.0
    scene.pin("/wall", soft, np.flatnonzero(points[:, 0] < -0.29999))
    sims = [Simulation(scene, device=device, precision="float64") for device in ("cpu", "cuda:0", "cuda:0")]
    for sim in sims:
        sim.run(8)
    cpu, gpu, again = (sim.positions() for sim in sims)
    assert sims[1].indicators()["plastic_strain"] > 0.02
    assert reference.rms(cpu - gpu) < (1e-5 if scene.solver == "implicit" else 1e-12)      # its solves end at a tolerance
    np.testing.assert_allclose(sims[1].stress().strain, sims[0].stress().strain, atol=1e-3)
    assert np.array_equal(gpu, again)


@pytest.mark.parametrize("solver", ["implicit", "explicit"])
@pytest.mark.parametrize("what", ["quadratic", "pressure", "yield", "shared"])
def test_what_soft_bodies_may_have_agrees(what, solver):
    """Middles of edges, pressure, plastic flow, points shared with a cloth."""
    scene = laid(solver=solver, integrator="auto", iterations=4)[0] if what == "shared" else Scene(
        fps=60.0, substeps=2, iterations=4, solver=solver)
    if what != "shared":
        points, tets = shapes.block((1.0, 0.5, 0.5), (4, 2, 2))
        bulk = Bulk(young=2e5, yield_strain=0.01) if what == "yield" else Bulk(young=2e5)
        body = scene.soft("/bar", points, tets, material=bulk, quadratic=what == "quadratic",
                          pressure=2e4 if what == "pressure" else 0.0)
        scene.pin("/wall", body, np.flatnonzero(points[:, 0] < -0.499))
    found = []
    for device in ("cpu", "cuda:0"):
        sim = Simulation(scene, device=device, precision="float64")
        sim.run(6)
        found.append(sim.positions("/bar"))
    assert reference.rms(found[0] - found[1]) < 1e-9


@pytest.mark.parametrize("keep", ["all", "checkpoints"])
@pytest.mark.parametrize("make, settings", [
    (sheet, {"model": "membrane"}), (sheet, {"model": "springs", "solver": "implicit", "integrator": "bdf2", "substeps": 4}),
    (bar, {"model": "corotational"}),
    (bar, {"model": "neo_hookean", "solver": "implicit", "integrator": "implicit_midpoint", "substeps": 4}),
    (bar, {"model": "corotational", "solver": "implicit", "integrator": "sdirk3", "substeps": 2})])
def test_gradients_agree(make, settings, keep):
    cpu, gpu = gradients(make(**settings), 3, lambda r: {3: r.positions(3), 1: r.positions(1)}, keep)
    for name in ("positions", "velocities", "masses", "gravity"):
        a, b = getattr(cpu, name)(), getattr(gpu, name)()
        assert np.abs(b - a).max() < 1e-8 * np.abs(a).max()
    assert np.abs(gpu.rest_shape() - cpu.rest_shape()).max() < 1e-8 * np.abs(cpu.rest_shape()).max()
    name = "stretch" if make is sheet else "young"
    assert gpu.material(name) == pytest.approx(cpu.material(name), rel=1e-8)


def test_a_coarse_space_agrees(monkeypatch):
    """A soft body that is small and forced to have one, of three levels; both solve to a tolerance."""
    monkeypatch.setattr(coarse_space, "PAYS", {"cpu": ((0, 0.0),), "cuda": ((0, 0.0),)})
    monkeypatch.setattr(coarse_space, "CELLS", 1.5)
    points, tets = shapes.block((1.0, 0.4, 0.4), (12, 4, 4))
    scene = Scene(fps=60.0, solver="implicit", substeps=2, iterations=3, integrator="backward_euler")
    body = scene.soft("/bar", points, tets, material=Bulk(1e6, 0.3, 1e3))
    scene.pin("/wall", body, points=np.flatnonzero(points[:, 0] < points[:, 0].min() + 1e-6))
    cpu, gpu = ends(scene, 5, "cpu", "cuda:0", precision="float64")
    assert reference.rms(cpu - gpu) < 1e-7


def test_gradients_of_xpbd_agree_however_colours_are_launched(monkeypatch):
    """One block that takes all colours, a launch a colour, one CPU thread."""
    scene = sheet("membrane", damping=2e-4, solver="xpbd", integrator="backward_euler", substeps=8, iterations=4)
    found = []
    for device, fuse in (("cpu", 512), ("cuda:0", 512), ("cuda:0", 0)):
        monkeypatch.setattr(batch, "FUSE", fuse)
        found += gradients(scene, 3, devices=[device])
    for other in found[1:]:
        for name in ("positions", "velocities", "masses", "rest_shape"):
            a, b = getattr(found[0], name)(), getattr(other, name)()
            assert np.linalg.norm(a - b) < 1e-9 * np.linalg.norm(a)
        for name in ("stretch", "shear", "bend", "damping"):
            assert other.material(name) == pytest.approx(found[0].material(name), rel=1e-8)


def test_gradients_through_contacts_and_wind_agree():
    """A sheet that slides over a turning ball; a list is found again in the backward pass."""
    for solver in SOLVERS.values():
        scene = dropped("sphere", spin=3.0, **solver)
        scene.cloths[0].drag, scene.cloths[0].lift, scene.wind = 1.0, 0.5, (1.0, 0.0, 2.0)
        found = list(gradients(scene, 4))
        for name in ("positions", "velocities", "masses"):
            a, b = (getattr(g, name)() for g in found)
            assert np.linalg.norm(a - b) < 1e-8 * np.linalg.norm(a)
        assert found[1].wind() == pytest.approx(found[0].wind(), rel=1e-8)


@pytest.mark.parametrize("shape", ["solid", "sheet", "deforming"])
def test_gradients_through_meshes_and_by_colliders_agree(shape):
    """A sheet thrown at a mesh that turns, rises and may deform: its motion by graphs, and its gradients."""
    for solver in SOLVERS:
        # at 3 rad/s a point comes to an edge of the sheet, where float32 queries name either face: 3e-9 m
        scene = slid(shape, solver, 2.9 if shape == "sheet" else 3.0)
        cpu, gpu = ends(scene, 4, "cpu", "cuda:0", precision="float64")
        # How far a mesh has gone by its own motion is found in float32, whose roundings of 0.15 m are 9e-9: both are as right
        assert np.abs(cpu - gpu).max() < (2e-8 if shape == "deforming" else 1e-11)
        found = list(gradients(scene, 4))
        for of in (lambda g: g.positions(), lambda g: g.motion("/floor"), lambda g: g.friction("/floor"),
                   lambda g: g.friction("/cloth"), lambda g: g.thickness("/floor")):
            a, b = (np.asarray(of(g)) for g in found)
            # on a CPU, gradients go by up to 4e-4 of themselves where the frames of the mesh go by 2e-8 m at random
            assert np.linalg.norm(a - b) < (4e-4 if shape == "deforming" else 1e-8) * np.linalg.norm(a)


def test_gradients_of_quadratic_tets_under_pressure_agree():
    scene = bar("neo_hookean", damping=1e-4, solver="implicit", integrator="bdf2", substeps=2)
    scene.softs[0].quadratic, scene.softs[0].pressure = True, 400.0
    found = list(gradients(scene, 2))
    for name in ("young", "poisson", "damping", "pressure"):
        assert found[1].material(name) == pytest.approx(found[0].material(name), rel=1e-8)
    assert np.abs(found[1].rest_shape() - found[0].rest_shape()).max() < 1e-8 * np.abs(found[0].rest_shape()).max()


@pytest.mark.parametrize("settings", [{"solver": "explicit", "integrator": "leapfrog", "substeps": 40},
                                      {"solver": "xpbd", "substeps": 8, "iterations": 4}])
def test_reactions_agree(settings):
    """Springs with several threads a point, and a membrane with hinges and wind."""
    for scene in (reference.spring_cloth(16), hanging()):
        found = []
        for name, value in settings.items():
            setattr(scene, name, value if scene.springs or name != "substeps" else 10 * value)
        for device in ("cpu", "cuda:0"):
            sim = Simulation(scene, device=device, precision="float64", worlds=2)
            sim.run(2)
            found.append(sim.reactions(scene.pins[0].path, 1))
        assert found[1] == pytest.approx(found[0], rel=1e-9, abs=1e-9)


def test_gradients_by_soft_pins_under_newtons_method_agree():
    scene = sheet("springs", damping=2e-4, solver="implicit", integrator="bdf2", substeps=2)
    scene.pins = [Pin("/soft", "/cloth", np.array([20, 24]), stiffness=50.0, damping=0.01)]
    found = list(gradients(scene, 2))
    for name in ("stiffness", "damping"):
        assert found[1].pin("/soft", name) == pytest.approx(found[0].pin("/soft", name), rel=1e-8)
    assert found[1].targets("/soft") == pytest.approx(found[0].targets("/soft"), rel=1e-8, abs=1e-10)


@pytest.mark.parametrize("make", [
    *(lambda name=name: dropped("sphere", friction=(0.4, 0.4), spin=3.0, **SOLVED | {"integrator": name})
      for name in ("backward_euler", "bdf2")), lambda: landed("plane", "bdf2", 1.5), lambda: pulled("sdirk3", "both")])
def test_gradients_through_contacts_and_limits_under_newtons_method_agree(make):
    found = list(gradients(make(), 4))
    for name in ("positions", "velocities", "masses"):
        a, b = (getattr(g, name)() for g in found)
        assert np.linalg.norm(a - b) < 1e-8 * np.linalg.norm(a)


def test_gradients_through_plastic_flow_agree():
    for more in (LEAPFROG, NEWTON):
        found = list(gradients(yielding("neo_hookean" if more is NEWTON else "corotational", **more), 2))
        for name in ("positions", "rest_shape"):
            a, b = (getattr(g, name)() for g in found)
            assert np.abs(a - b).max() < 1e-7 * np.abs(a).max()
        assert found[1].material("yield_strain") == pytest.approx(found[0].material("yield_strain"), rel=1e-7)


def test_a_ball_bounces_and_has_the_gradients_of_its_motion():
    """Three bounces, against the closed form on the CPU's own test, and a sheet thrown at a ball against the CPU."""
    sims = [Simulation(ball(v=(0.3, 0.25, 0.0)), device=device, precision="float64") for device in ("cpu", "cuda:0")]
    for sim in sims:
        sim.run(118)
    assert np.abs(sims[0].positions() - sims[1].positions()).max() < 1e-12
    found = list(gradients(ball(v=(0.3, 0.25, 0.0)), 118, lambda r: {118: np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]])}))
    assert found[1].positions() == pytest.approx(found[0].positions(), rel=1e-9, abs=1e-12)
    assert found[1].gravity() == pytest.approx(found[0].gravity(), rel=1e-9, abs=1e-12)
    assert found[1].restitution("/floor") == pytest.approx(found[0].restitution("/floor"), rel=1e-9)


def test_muscles_and_their_gradients_agree():
    """By every solver, and of a soft body that they move over the ground."""
    for scene in (*(muscled(**settings) for settings in PULLED.values()), crawler()):
        a, b = (g.actuation(scene.springs[0].path) for g in gradients(scene, 3))
        assert np.abs(b - a).max() < 1e-7 * np.abs(a).max()
        sims = ends(scene, 3, "cpu", "cuda:0", precision="float64")
        assert reference.rms(next(sims) - next(sims)) < 1e-9
