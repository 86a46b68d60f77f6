"""Gradients of losses by what pins bear, against differences of order 8 of runs without gradients, and what is refused."""

import numpy as np
import pytest

from tests.conftest import first_and_slow
from tests.make.gradient.gradients import bar, everything_of_a_sheet, net, sheet
from tests.make.gradient.reaction_adjoint import Run
from tests.make.physics.cloth.muscles import FACTORS, SOLVERS, muscled
from tests.make.physics.cloth.rest_shape import by_rest_shape
from tests.make.physics.soft.plastic_adjoint import LEAPFROG, NEWTON, yielding
from tests.make.physics.solver.xpbd_adjoint import SWEEPS, everything_of_wind
from wsim.gradient.recording import Recording
from wsim.scene import SceneError
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation


@pytest.mark.parametrize("how", [{}, {"keep": "checkpoints"}])
def test_a_chain_by_leapfrog(how):
    run = Run(net(integrator="leapfrog"), **how)
    run.material("stiffness", 40.0)
    run.material("damping", 1e-3)
    run.state("positions")
    run.state("velocities")
    run.world()


def test_a_sheet_of_membranes_and_hinges():
    run = Run(sheet("membrane", damping=2e-4))
    for name, value in (("stretch", 40.0), ("bend", 2e-4), ("damping", 2e-4)):
        run.material(name, value)
    run.check(run.gradient.density(run.path), lambda s: (run.path, "density", run.scene.cloths[0].material.density + s), 2.0)
    run.world()


@pytest.mark.parametrize("solver", [{"solver": "implicit", "integrator": "backward_euler", "substeps": 2}, {}])
def test_a_soft_bar(solver):
    run = Run(bar("neo_hookean", **solver))
    run.material("young", 2e4)
    run.material("poisson", 0.35)
    run.state("velocities")


@pytest.mark.parametrize("solver", [{"integrator": "rk4"}, SWEEPS | {"integrator": "backward_euler"},
                                    {"solver": "implicit", "integrator": "backward_euler", "substeps": 2}])
def test_a_soft_pin(solver):
    """Scenes with other stiffness and damping of it: neither is live. (Leapfrog's velocity at the end of a frame has a kink
    where others act: differences across it are 5e-7 off.)"""
    def scene(stiffness=200.0, damping=0.5):
        made = net(**solver)
        made.pins[0].stiffness, made.pins[0].damping = stiffness, damping
        return made
    run = Run(scene())
    run.material("stiffness", 40.0)
    run.state("velocities")
    way = np.array([0.3, -0.5, 0.8])

    def put(s):
        M = np.eye(4)
        M[:3, 3] = s * way
        return "/pin", "motion", M
    run.check(run.gradient.targets("/pin")[0] @ way, put, 5e-4)
    for name, value in (("stiffness", 200.0), ("damping", 0.5)):
        losses = [Run(scene(**{name: value * (1.0 + s)})).loss() for s in (1e-4, -1e-4)]
        assert run.gradient.pin("/pin", name) == pytest.approx((losses[0] - losses[1]) / (2e-4 * value), rel=1e-6)


@pytest.mark.parametrize("integrator, iterations", [("backward_euler", 1), ("backward_euler", 4), ("bdf2", 16),
                                                    ("implicit_midpoint", 16), ("sdirk3", 16)])
def test_a_chain_by_sweeps(integrator, iterations):
    """The law of the material where few sweeps have left it: by alpha = 1 / k of XPBD's tables, lengths too."""
    lengths, way = np.linspace(0.09, 0.11, 11).astype(np.float32), np.random.default_rng(8).normal(size=11)
    run = Run(net(**SWEEPS | {"integrator": integrator, "iterations": iterations, "lengths": lengths}))
    run.material("stiffness", 40.0)
    run.material("damping", 1e-3)
    run.state("positions")
    run.state("velocities")
    run.world()
    run.check(run.gradient.lengths() @ way, lambda s: ("/chain", "lengths", lengths + s * way), 2e-4)


@pytest.mark.parametrize("model, how", [("membrane", {}), ("springs", {"keep": "checkpoints"})])
def test_a_sheet_by_sweeps(model, how):
    """Stretch, weft and shear by the inverse of a matrix; each by all elements, and where they are at rest."""
    run = Run(sheet(model, damping=2e-4, integrator="backward_euler", **SWEEPS), **how)
    everything_of_a_sheet(run)
    rest = run.scene.cloths[0].rest_points.astype(np.float64)
    way = 1e-3 * np.random.default_rng(9).normal(size=rest.shape) * (1.0, 1.0, 0.0)
    run.check((run.gradient.rest_shape() * way).sum(), lambda s: ("/cloth", "rest_shape", rest + s * way), 0.05)


@pytest.mark.parametrize("solver", ["leapfrog", "rk4", "xpbd", "midpoint", "newton", "sdirk3"])
def test_muscles(solver):
    """By their factors, at keys between frames too, and by what these multiply."""
    scene, lengths = muscled(**SOLVERS[solver]), np.linspace(0.09, 0.11, 11).astype(np.float32)
    scene.springs[0].lengths = lengths
    run, way = Run(scene), np.random.default_rng(3).normal(size=FACTORS.shape)
    run.check((run.gradient.actuation() * way).sum(), lambda s: ("/chain", "actuation", FACTORS + s * way), 0.01)
    run.material("stiffness", 40.0)
    run.state("positions")
    each = np.random.default_rng(8).normal(size=11)
    run.check(run.gradient.lengths() @ each, lambda s: ("/chain", "lengths", lengths + s * each), 2e-4)
    kept = Run(scene, keep="checkpoints").gradient.actuation()
    assert np.abs(kept - run.gradient.actuation()).max() < 1e-12 * np.abs(kept).max()


@pytest.mark.parametrize("scene", [bar("corotational"), yielding(**LEAPFROG), net(**SWEEPS), muscled(integrator="rk4")])
def test_looking_changes_nothing_and_gradients_repeat_to_the_bit(scene):
    recording = Recording(Simulation(scene, device="cpu", gradients=True), 3)
    path, n = scene.pins[0].path, len(scene.pins[0].points)
    alone = recording.backward({3: recording.positions(0)}).positions()
    seen = [recording.reactions(f) for f in (3, 1, 3)]
    assert np.array_equal(seen[0], seen[2]) and not np.array_equal(seen[0], seen[1])
    assert np.array_equal(recording.backward({3: recording.positions(0)}).positions(), alone)
    both = [recording.backward({3: recording.positions(0)}, reactions={1: {path: np.ones((n, 3))}}) for _ in range(2)]
    assert np.array_equal(both[0].positions(), both[1].positions()) and not np.array_equal(both[0].positions(), alone)
    recording.run()
    assert np.array_equal(recording.reactions(3), seen[0])


@pytest.mark.parametrize("model, more, step", first_and_slow([("corotational", LEAPFROG, 1e-7), ("neo_hookean", NEWTON, 2e-6),
                                               ("corotational", {"integrator": "rk4", "substeps": 60}, 1e-7)]))
def test_a_bar_that_flows(model, more, step):
    """Its tets have the shapes at rest of that frame, and do not flow because one looks (after rk4's last stage)."""
    run = Run(yielding(model, **more))
    assert run.sim.indicators()["plastic_strain"] > 0.03
    for name, value in (("young", 2e4), ("yield_strain", 0.02)):
        run.check(value * run.gradient.material(name), lambda s, n=name, v=value: (run.path, n, v * (1.0 + s)),
                  1e-4 if more is NEWTON else 1e-5, 2e-8)
    run.state("positions", step)
    by_rest_shape(run, step, 2e-9)
    kept = Run(run.scene, keep="checkpoints").gradient.positions()
    assert np.abs(kept - run.gradient.positions()).max() < 1e-12 * np.abs(kept).max()


@pytest.mark.parametrize("more", [SWEEPS | {"integrator": "backward_euler"}, {"integrator": "rk4"},
                                  {"solver": "implicit", "integrator": "bdf2", "substeps": 2}])
def test_wind(more):
    everything_of_wind(Run, **more).state("velocities", 5e-6)


@pytest.mark.parametrize("more", [{"integrator": "leapfrog"}, SWEEPS | {"integrator": "bdf2"}])
def test_a_recording_knows_the_reactions_of_a_simulation(more):
    scene = net(**more)
    sim = Simulation(scene, device="cpu", precision="float64")
    recording = Recording(Simulation(scene, device="cpu", precision="float64", gradients=True), 2)
    assert recording.reactions(0) == pytest.approx(sim.reactions(), abs=1e-12)
    sim.run(2)
    assert recording.reactions(2, "/pin") == pytest.approx(sim.reactions(), abs=1e-10)


def moving(scene):
    values = np.tile(np.eye(4), (2, 1, 1))
    values[1, 0, 3] = 0.1
    scene.pins[0].motion = Motion([0.0, 1.0], values)
    return scene


def tethered(scene):
    scene.cloths[0].tethers = True
    return scene


@pytest.mark.parametrize("scene, use, words", [
    (tethered(sheet("springs", **SWEEPS, integrator="bdf2")), lambda r: r.backward(reactions={1: {"/pin": np.ones((2, 3))}}),
     "/cloth: has tethers or a strain limit, which pull at pins without a law of force"),
    (net(integrator="leapfrog"), lambda r: r.backward(reactions={1: {"/nail": np.zeros((1, 3))}}), "/nail: in world 0 is no"),
    (net(integrator="leapfrog"), lambda r: r.backward(reactions={9: {"/pin": np.zeros((1, 3))}}), "allowed are 0 to 1"),
    (net(integrator="leapfrog"), lambda r: r.backward(reactions={1: {"/pin": np.zeros((2, 3))}}), r"with shape \(1, 3\)"),
    (moving(net(integrator="leapfrog")), lambda r: r.backward(reactions={1: {"/pin": np.ones((1, 3))}}).targets("/pin"),
     "/pin: moves, and what it bears")])
def test_what_is_not_covered_is_said(scene, use, words):
    with pytest.raises(SceneError, match=words):
        use(Recording(Simulation(scene, device="cpu", precision="float64", gradients=True), 1))
