"""Membranes and hinges in packets on a CPU, against the same scenes launch by launch; laws that need no other path."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from wsim.kernels.motion.fast_paths.threads import FORMED
from wsim.physics.motion import forces
from wsim.physics.motion.fast_paths import simd_sheets
from wsim.physics.motion.fast_paths import threads as abreast
from wsim.scene import Motion, Scene, Sphere, shapes
from wsim.scene.fabric import Fabric
from wsim.simulation import plan
from wsim.simulation.simulation import Simulation

DOUBLE = {"device": "cpu", "precision": "float64"}
WOVEN = Fabric(stretch=40.0, weft=25.0, poisson=0.3, shear=6.0, bend=2e-3)
DAMPED = replace(WOVEN, damping=2e-3)
FABRICS = {"woven": WOVEN, "damped": DAMPED, "soft": Fabric(stretch=20.0, shear=1e-3, bend=1e-4, damping=1e-3)}


def crumpled(fabric: Fabric, size: float = 0.2, **settings) -> Scene:
    """A sheet of 7 x 6 points with random places off its mesh, crossed edges, and velocities; the rest shape is flat."""
    rng = np.random.default_rng(3)
    rest, counts, indices = shapes.sheet(1.0, 0.8, 6, 5)
    rest = rest + rng.uniform(-0.03, 0.03, rest.shape) * [1.0, 1.0, 0.0]
    moved = (rest + size * rng.normal(size=rest.shape) * [0.2, 0.2, 0.6]).astype(np.float32)
    scene = Scene(fps=60.0, integrator="leapfrog", **({"substeps": 24} | settings))
    scene.cloth("/cloth", moved, counts, indices, material=fabric, rest_points=rest.astype(np.float32),
                masses=rng.uniform(1e-3, 2e-3, len(rest)), velocities=rng.normal(size=rest.shape).astype(np.float32))
    return scene


def held(fabric: Fabric, **settings) -> Scene:
    """The same, pinned by a pin that moves."""
    scene = crumpled(fabric, **settings)
    matrices = np.tile(np.eye(4), (2, 1, 1))
    matrices[1, 0, 3] = 0.5
    scene.pin("/pin", scene.cloths[0], [0, 6], motion=Motion([0.0, 1.0], matrices))
    return scene


@pytest.fixture
def both(monkeypatch) -> Callable:
    """Function: a simulation in packets, and the same launch by launch."""
    def make(scene: Scene, **settings) -> tuple[Simulation, Simulation]:
        one = Simulation(replace(scene), **settings)
        with monkeypatch.context() as m:
            m.setattr(forces.ForceGather, "why_unpacked", lambda self: "not asked for")
            m.setattr(plan, "module_name", lambda b, name=plan.module_name: f"{name(b)}_apart")       # each is compiled once
            two = Simulation(replace(scene), **settings)
        assert one.plan.method("explicit").pull.sheets and not two.plan.method("explicit").pull.sheets
        return one, two
    return make


def apart(sims: tuple[Simulation, Simulation], frames: int) -> tuple[float, float]:
    """Largest differences of positions [m] and velocities [m/s]."""
    for sim in sims:
        sim.run(frames)
    one, two = sims
    return np.abs(one.positions() - two.positions()).max(), np.abs(one.velocities() - two.velocities()).max()


@pytest.mark.parametrize("name, precision, rounding", [
    *((name, "float64", 1e-15) for name in FABRICS), ("damped", "float32", 6e-8), ("soft", "float32", 6e-8)])
def test_forces_are_those_of_the_kernels_of_elements(both, name, precision, rounding):
    """Steps so short that nothing moves: the change of velocity is that of all forces. Each is the difference of terms of up to
    a hundred times its size."""
    sims = both(crumpled(FABRICS[name]), device="cpu", precision=precision)
    before = sims[0].velocities()
    for sim in sims:
        sim.plan.clock.dt = 1e-5
    _, v = apart(sims, 1)
    size = np.abs(sims[1].velocities() - before).max()
    assert size > 1e-3 and v < 100.0 * rounding * size + 4.0 * rounding * np.abs(before).max()


@pytest.mark.parametrize("name", FABRICS)
def test_frames_are_those_of_launch_by_launch(both, name):
    x, v = apart(both(crumpled(FABRICS[name], air_drag=0.7), **DOUBLE), 3)
    assert x < 1e-11 and v < 1e-8


def test_membranes_alone_on_a_pin_that_moves(both):
    x, v = apart(both(held(replace(DAMPED, bend=0.0)), **DOUBLE), 3)
    assert x < 1e-11 and v < 1e-8


def test_float32_is_as_near_to_float64_as_launch_by_launch(both):
    scene = crumpled(DAMPED)
    true = Simulation(replace(scene), **DOUBLE)
    sims = both(scene, device="cpu")
    for sim in (true, *sims):
        sim.run(2)
    one, two = (np.sqrt(np.mean((sim.positions() - true.positions())**2)) for sim in sims)
    assert one < 1e-5 and one < 3.0 * two


def test_others_act_between_substeps(both):
    """A collider that is met, soft pins and strain limits: forces are taken in packets, the rest as ever."""
    scene = held(replace(WOVEN, strain_limit=0.5))
    scene.pin("/soft", scene.cloths[0], [20, 21], stiffness=50.0)
    scene.collider("/ball", Sphere(0.2), at=(0.3, -0.25, 0.0))
    x, v = apart(both(scene, **DOUBLE), 3)
    assert x < 1e-10 and v < 1e-7


def test_frames_out_of_reach_of_a_collider_are_one_launch(both):
    scene = crumpled(WOVEN)
    scene.collider("/far", Sphere(0.1), at=(0.0, 100.0, 0.0))
    sims = both(scene, **DOUBLE)
    x, _ = apart(sims, 2)
    assert x < 1e-12 and sims[0].forms == sims[1].forms
    (stage,) = sims[0].plan.stages("predict", "frame", "without contacts")
    assert stage.launches == 1 and "in packets" in stage.what


def square() -> Scene:
    """A flat unit square of two triangles."""
    rest = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]], np.float32)
    scene = Scene(fps=60.0, substeps=8, integrator="leapfrog", gravity=(0.0, 0.0, 0.0))
    scene.cloth("/cloth", rest, [3, 3], [0, 1, 2, 1, 3, 2], material=DAMPED)
    return scene


@pytest.mark.parametrize("points", [
    [[0, 0, 0], [1, 0, 0], [0.5, 0, 0], [1, 1, 0]],                      # a triangle on a line
    [[0, 0, 0], [0, 1, 0], [0, 0.5, 0], [1, 1, 0]],
    [[0, 0, 0], [0, 0, 0], [0, 0, 0], [1, 1, 0]],                        # in a point: both on a line
    [[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]],
    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1e-4]],                     # folded onto itself
    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.1, -0.3]]])
def test_flat_and_folded_elements_are_those_of_launch_by_launch(both, points):
    """The plans are run as they are: `Simulation` would have moved coincident points apart."""
    plans = []
    for sim in both(square(), **DOUBLE):
        state = sim.plan.state
        state.x.assign(np.array(points, np.float64)[sim.model.bodies[0].index])
        sim.plan.before_frame(0.0)
        sim.plan.frame()
        plans.append(state.x.numpy() + state.e.numpy())
    assert np.isfinite(plans[0]).all()
    np.testing.assert_allclose(plans[0], plans[1], rtol=0, atol=1e-12)


@pytest.mark.parametrize("precision, rounding", [("float32", 6e-8), ("float64", 1.2e-16)])
def test_a_free_sheet_keeps_its_momentum(precision, rounding):
    """Corner forces sum to zero but for rounding, 24 substeps a frame, of random signs."""
    sim = Simulation(crumpled(DAMPED, gravity=(0.0, 0.0, 0.0)), device="cpu", precision=precision)
    m, before = sim.model.scene.cloths[0].masses[:, None], sim.velocities()
    sim.run(3)
    size = np.abs(m * sim.velocities()).sum()
    assert np.abs((m * (sim.velocities() - before)).sum(0)).max() < 30.0 * rounding * size


def test_energy_errs_by_the_square_of_the_step():
    """Leapfrog, undamped and free: halving the step leaves a fourth of the error of the energy."""
    errors = []
    for substeps in (48, 96):
        sim = Simulation(crumpled(WOVEN, gravity=(0.0, 0.0, 0.0), size=0.05, substeps=substeps), **DOUBLE)
        m = sim.model.scene.cloths[0].masses[:, None]

        def energy(sim=sim, m=m) -> float:
            return sim.plan.method("explicit").indicators(None, None)["elastic_energy"] + 0.5 * (m * sim.velocities()**2).sum()
        start = energy()
        sim.run(2)
        errors.append(abs(energy() / start - 1.0))
    assert errors[0] < 1e-3 and 3.0 < errors[0] / errors[1] < 5.5


def test_live_values_are_seen(both):
    """Among them a rest shape that gives hinges other curvatures, and what is written into the arrays themselves."""
    scene = crumpled(DAMPED)
    sims = both(scene, **DOUBLE)
    rest = scene.cloths[0].rest_points * np.float32(1.02)
    rest[5, 2] += 0.05
    for sim in sims:
        sim.step()
        for name, value in (("stretch", 30.0), ("bend", 4e-3), ("damping", 1e-3), ("rest_shape", rest)):
            sim.set("/cloth", name, value)
        sim.step()
        (kept,) = [e for e in sim.plan.method("explicit").pull.elements if e.kind == "membrane"]
        kept.data.stiffness.assign(kept.data.stiffness.numpy() * 0.9)
    x, _ = apart(sims, 1)
    assert x < 1e-11


def test_worlds_have_the_bits_of_one():
    one, three = (Simulation(crumpled(DAMPED), device="cpu", worlds=worlds) for worlds in (1, 3))
    one.run(2)
    three.run(2)
    assert all(np.array_equal(one.positions(), three.positions(world=w)) for w in range(3))


def test_a_frame_remembers_nothing_of_the_one_before():
    sims = [Simulation(crumpled(DAMPED), device="cpu") for _ in range(2)]
    sims[1].plan.method("explicit").pull.space.fill_(np.nan)
    for sim in sims:
        sim.run(1)
    assert np.array_equal(sims[0].positions(), sims[1].positions())


@pytest.mark.skipif(abreast.count_cores() < 2, reason="a helper has no core to come to")
@pytest.mark.parametrize("count", [2, 3])
def test_any_number_of_threads_gives_the_same_bits(monkeypatch, count):
    made, frames = [], 0
    monkeypatch.setattr(simd_sheets, "LEAST", 10)
    for number in (1, count):
        monkeypatch.setattr(forces, "count_cores", lambda number=number: number)
        made.append(Simulation(crumpled(DAMPED, substeps=400), device="cpu"))
        assert made[-1].plan.method("explicit").pull.abreast.count == number
    team = made[1].plan.method("explicit").pull.abreast
    for _ in range(8):
        for sim in made:
            sim.step()
        frames += team.words[FORMED] > 0 and team.words[FORMED] == team.words[0] >> 6
        assert np.array_equal(made[0].positions(), made[1].positions())
        assert np.array_equal(made[0].velocities(), made[1].velocities())
    assert frames > 0


@pytest.mark.parametrize("settings, why", [({"integrator": "rk4"}, "stages"), ({}, "springs beside them")])
def test_what_packets_do_not_know_goes_on_launch_by_launch(settings, why):
    scene = crumpled(WOVEN)
    scene.integrator = settings.get("integrator", scene.integrator)
    if not settings:
        scene.net("/net", [[0.0, 3.0, 0.0], [1.0, 3.0, 0.0]], [[0, 1]], 100.0, 1.0)
    made = plan.build_plan(scene, device=wp.get_device("cpu"), real=wp.float64)
    assert made.method("explicit").pull.sheets is None and f"no packets: {why}" in made.describe()
