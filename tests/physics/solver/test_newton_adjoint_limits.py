"""Gradients through tethers and strain limits under Newton's method: a solve to its residual, one sweep of what is hard, and
among contacts one more pass of those. Against differences of order 8 in float64, of steps so short that what is met stays met;
every scene is one that the limits change by millimetres."""

from dataclasses import replace

import numpy as np
import pytest

import wsim
from tests.conftest import first_and_slow
from tests.make.gradient.gradients import Run, sheet
from tests.make.physics.cloth.rest_shape import by_rest_shape, crooked
from tests.make.physics.contact.project_adjoint import Slid
from tests.make.physics.solver.newton_adjoint_limits import hard, landed, pulled
from wsim.fitting import Settings, Track
from wsim.gradient.recording import Recording
from wsim.gradient.rollout.products import Rollout
from wsim.kernels.contact.coulomb import SLIDES, STICKS
from wsim.scene import Pin, Scene
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation

INTEGRATORS = ("backward_euler", "bdf2", "implicit_midpoint", "sdirk3")


def recorded(scene: Scene, frames: int = 2, **how) -> Recording:
    return Recording(Simulation(scene, device="cpu", precision="float64", gradients=True, **how), frames)


def moved(scene: Scene, free: Scene, frames: int) -> float:
    """By how much what is hard changes where the points end [m]."""
    return float(np.abs(recorded(scene, frames).positions(frames) - recorded(free, frames).positions(frames)).max())


def check(run: Run) -> None:
    """By the start, the material, the masses and the world."""
    assert run.recording.residuals["forward"] < 1e-12 and run.recording.residuals["adjoint"] < 1e-11
    for name, step, within in (("positions", 2e-7, 5e-9), ("velocities", 4e-5, 2e-9)):
        start = getattr(run.recording, name)(0, run.path)
        way = np.random.default_rng(6).normal(size=start.shape)
        found = (getattr(run.gradient, name)(run.path) * way).sum()
        run.check(found, lambda s, name=name, start=start, way=way: (run.path, name, start + s * way), step, within)
    material = run.scene.cloths[0].material
    for name, part in (("stretch", 1e-4), ("bend", 1e-3), ("damping", 1e-3)):
        value = getattr(material, name)
        run.check(run.gradient.material(name), lambda s, n=name, v=value: ("/cloth", n, v + s), part * value, 2e-8)
    run.check(run.gradient.density(), lambda s: ("/cloth", "density", material.density + s), 0.02, 2e-8)
    g, way = np.asarray(run.scene.gravity), np.array([0.3, -0.5, 0.8])
    run.check(run.gradient.gravity() @ way, lambda s: ("/", "gravity", g + s * way), 1e-3, 2e-8)
    run.check(run.gradient.air_drag(), lambda s: ("/", "air_drag", run.scene.air_drag + s), 1e-3, 2e-8)


@pytest.mark.parametrize("integrator, what", first_and_slow([*((name, "both") for name in INTEGRATORS), ("bdf2", "limit"),
                                              ("sdirk3", "tethers")]))
def test_a_sheet_that_is_pulled(integrator, what):
    run = Run(pulled(integrator, what), 2)
    assert moved(run.scene, pulled(integrator, "none"), 2) > 2e-3
    check(run)


def test_triangles_and_a_soft_pin():
    """The membrane with a strain limit; a soft pin holds a corner beside the hard ones."""
    scene = pulled("bdf2", "limit", "membrane")
    scene.pins.append(Pin("/soft", "/cloth", np.array([0]), stiffness=20.0, damping=0.01))
    cloth = scene.cloths[0]
    free = scene.with_objects("Cloth", [replace(cloth, material=replace(cloth.material, strain_limit=np.inf))])
    assert moved(scene, free, 2) > 2e-3
    check(Run(scene, 2))


@pytest.mark.parametrize("integrator", ["bdf2", "implicit_midpoint", "sdirk3"])
def test_where_a_moving_pin_puts_its_points(integrator):
    """Tethers hang on it: it is jerked away from them."""
    path = Motion(np.arange(5) / 60, np.stack([np.eye(4)] * 5))
    path.values[:, :3, 3] = np.outer(np.arange(5.0), (0.002, 0.01, 0.001))
    scene = pulled(integrator, "both")
    scene.pins[0] = replace(scene.pins[0], motion=path)
    run, way, grows = Run(scene, 2), np.array([0.02, -0.01, 0.03]), np.linspace(0.0, 1.0, 5)

    def pushed(s: float):
        values = path.values.copy()
        values[:, :3, 3] += s * grows[:, None] * way
        return "/pin", "motion", Motion(path.times, values)
    by, at = run.gradient.targets("/pin"), run.sim.plan.clock.moments(True) * 60.0
    found = (by.sum(axis=2) * ((np.arange(2)[:, None] + at) / 4.0)[:, :, None]).sum(axis=(0, 1)) @ way
    run.check(found, pushed, 1e-5, 2e-8)


@pytest.mark.parametrize("what, integrator", [("limit", "bdf2"), ("tethers", "backward_euler")])
def test_lengths_at_rest_are_what_limits_and_tethers_allow(what, integrator):
    scene = hard(crooked("springs", 0.2, solver="implicit", integrator=integrator, substeps=2), what, strain_limit=(
        0.002 if what == "limit" else np.inf))
    run = Run(scene, 3)
    hard_ones = [by for r, by, *_ in run.gradient.at_rest(run.sim.model.body(None)) if r.kind in ("limit", "tether")]
    assert len(hard_ones) == 1 and np.abs(hard_ones[0]).max() > 1e-3
    by_rest_shape(run, 2e-7, 2e-8)


def cord(integrator: str, what: str, iterations: int) -> Scene:
    """A row of squares that hangs in a plane and is pulled along its springs: tethers keep it straight, limits of its diagonals
    bend it."""
    scene = Scene(fps=60, up="Z", frames=3, solver="implicit", integrator=integrator, substeps=2, iterations=iterations)
    points = np.stack([np.repeat([0.0, 0.125], 5), np.zeros(10), np.tile(-0.125 * np.arange(5), 2)], -1)
    quads = np.array([[k, k + 1, k + 6, k + 5] for k in range(4)])
    cloth = scene.cloth("/cloth", points, np.full(4, 4), quads.ravel(), model="springs")
    cloth.velocities, scene.gravity = np.outer(-points[:, 2], [0.0, 0.0, -2.0]), (0.0, 0.0, -20.0)
    scene.pin("/pin", cloth, [0, 5])
    return hard(scene, what, shear=0.0, bend=0.0, damping=0.0, stretch=20.0)


@pytest.mark.parametrize("integrator, what, iterations", [
    ("bdf2", "limit", 3), ("backward_euler", "tethers", 3), ("sdirk3", "tethers", 3),
    ("implicit_midpoint", "tethers", 3)])
def test_a_recording_ends_where_a_simulation_does(integrator, what, iterations):
    """Both project limits behind the solve, as many sweeps as there are Newton steps; what these leave is the rest."""
    scene = cord(integrator, what, iterations)
    plain = Simulation(scene, device="cpu", precision="float64")
    plain.run(3)
    off = np.abs(plain.positions() - recorded(scene, 3).positions(3)).max()
    effect = moved(scene, cord(integrator, "none", iterations), 3)
    assert effect > 0.03 and off < 1e-6 * effect
    if integrator != "bdf2":                         # whose energy rises by a part of it in two substeps, as is told
        assert not plain.warnings
    assert all("gained energy" in w for w in plain.warnings)


@pytest.mark.parametrize("shape, integrator, mu", first_and_slow([("sphere", "backward_euler", 0.4), ("plane", "bdf2", 1.5)]))
def test_among_contacts(shape, integrator, mu):
    """What sticks in the solve may slide where a limit pulls at it: the pushes of the solve say how much friction there is."""
    run = Slid(landed(shape, integrator, mu), 4)
    assert moved(run.scene, landed(shape, integrator, mu, "none"), 4) > 3e-4
    assert run.recording.residuals["forward"] < 1e-12 and run.recording.residuals["adjoint"] < 1e-11
    run.recording.run()
    bears = run.sim.plan.method("implicit").adjoint.contacts.frame.bears.numpy()
    assert (bears > 0).sum() >= 4 and (STICKS if mu > 1.0 else SLIDES) in bears
    run.by("positions", 1e-7, 1e-8)
    run.by("velocities", 4e-6, 1e-7)
    g, way = np.asarray(run.scene.gravity), np.array([0.3, -0.5, 0.8])
    run.check(run.gradient.gravity() @ way, lambda s: ("/", "gravity", g + s * way), 1e-4, 1e-7)
    run.check(run.gradient.material("stretch"), lambda s: ("/cloth", "stretch", 4.0 + s), 1e-4, 1e-7)
    run.check(run.gradient.density(), lambda s: ("/cloth", "density", 150.0 + s), 1e-3, 1e-7)
    run.check(run.gradient.thickness("/floor"), lambda s: ("/floor", "thickness", 1e-3 + s), 1e-7, 1e-7)
    for path in ("/cloth", "/floor"):
        run.check(run.gradient.friction(path)[1], lambda s, path=path: (path, "dynamic_friction", mu + s), 1e-5, 1e-7)


def test_what_is_thrown_back():
    """Restitution acts behind the contacts, and those behind the limits."""
    scene = landed("plane", "bdf2", 0.4)
    scene.colliders[0].restitution = 0.5
    scene.cloths[0].velocities = np.tile([0.0, 0.0, -0.8], (25, 1))
    run = Slid(scene, 2)
    assert run.recording.velocities(2)[:, 2].max() > 0.3
    free = landed("plane", "bdf2", 0.4, "none")
    free.colliders[0].restitution, free.cloths[0].velocities = 0.5, scene.cloths[0].velocities
    assert moved(scene, free, 2) > 1e-4
    run.by("positions", 1e-7, 1e-8)
    run.by("velocities", 4e-6, 1e-7)
    run.check(run.gradient.restitution("/floor"), lambda s: ("/floor", "restitution", 0.5 + s), 1e-5, 1e-7)
    run.check(run.gradient.friction("/floor")[1], lambda s: ("/floor", "dynamic_friction", 0.4 + s), 1e-5, 1e-7)


@pytest.mark.parametrize("make", [lambda: pulled("bdf2", "both", substeps=4), lambda: landed("plane", "bdf2", 0.4, substeps=4)])
def test_checkpoints_and_worlds_give_the_same(make):
    """A segment that runs once more; and two worlds of which one is stiffer."""
    scene = make()
    run, again = Run(scene, 3), Run(scene, 3, keep="checkpoints")
    assert again.recording.bytes < 0.8 * run.recording.bytes
    two = Simulation(scene, device="cpu", precision="float64", gradients=True, worlds=2)
    two.set("/cloth", "stretch", 5.0, 0)
    recording = Recording(two, 3)
    gradient = recording.backward({3: {("/cloth", 1): run.x}}, {3: {("/cloth", 1): run.v}})
    for name in ("positions", "velocities", "masses"):
        a, *others = (getattr(g, name)(*at) for g, at in ((run.gradient, ()), (again.gradient, ()), (gradient, ("/cloth", 1))))
        for b in others:
            assert np.abs(a - b).max() < 1e-9 * np.abs(a).max()
        assert not np.abs(getattr(gradient, name)("/cloth", 0)).max()
    assert np.array_equal(run.gradient.positions(), again.gradient.positions())


@pytest.mark.parametrize("make", [lambda: pulled("sdirk3", "limit"), lambda: landed("sphere", "bdf2", 0.4)])
def test_float32_is_near_float64(make):
    found = []
    for precision in ("float32", "float64"):
        recording = Recording(Simulation(make(), device="cpu", precision=precision, gradients=True), 2)
        found.append(recording.backward({2: np.random.default_rng(5).normal(size=(25, 3))}))
    for name in ("positions", "velocities"):
        a, b = (getattr(g, name)() for g in found)
        assert np.linalg.norm(a - b) < 1e-3 * np.linalg.norm(b)


def test_products_of_a_rollout():
    """J^T s is exact; J d is extrapolated, and says how well."""
    names, rng = ["/cloth:stretch", "/cloth:velocities"], np.random.default_rng(5)
    rollout = Rollout(recorded(pulled("bdf2", "both")), names, [2])
    s, d = rng.normal(size=rollout.run().shape), {"/cloth:stretch": 0.01, "/cloth:velocities": 1e-4 * rng.normal(size=(25, 3))}
    product, by = rollout.jvp(d, 1.0), rollout.vjp(s)
    assert product.error.max() < 1e-7
    assert sum((by[name] * way).sum() for name, way in d.items()) == pytest.approx((product.value * s).sum(), rel=1e-7)


def blown(speed: float) -> Scene:
    """A sheet that hangs, soft but for limits and tethers, and is thrown out of its plane."""
    scene = hard(sheet("springs", damping=2e-4, integrator="backward_euler", solver="implicit", substeps=2), "both")
    x, y = scene.cloths[0].points[:, :2].T
    scene.gravity = (0.0, -9.8, 0.0)
    scene.cloths[0].velocities = np.outer(np.cos(9.0 * x) * (y.max() - y) / 0.2, [0.0, 0.0, speed])
    return scene


def test_a_throw_is_found_again():
    """By the adjoint: the speeds of all points, as far as three frames tell them."""
    seen, start = recorded(blown(0.3), 3), recorded(blown(0.0), 3)
    track = Track("/cloth", [1, 2, 3], np.stack([seen.positions(f) for f in (1, 2, 3)]), sigma=1e-5)
    found = recorded(wsim.fit(blown(0.0), [track], "velocities[]", settings=Settings(device="cpu", limit=60.0)).scene, 3)
    before, after = (np.abs(r.positions(3) - seen.positions(3)).max() for r in (start, found))
    assert before > 5e-3 and after < 0.01 * before


@pytest.mark.parametrize("mu, solver, few, more", [
    (0.0, "implicit", 1e-5, 1e-8), (0.4, "implicit", 0.2, 0.02), (0.4, "auto", 0, 0)])
def test_a_recording_says_how_far_it_is_from_a_simulation(mu, solver, few, more):
    """Auto takes what it takes without gradients; limits and restitution act alike; what Newton steps leave is told. few, more:
    parts of the way that 2 and 6 of them leave; of a sheet that slides much, since the bound of friction is that of the step
    before (measured: 0.11 and 0.007; without friction 1.6e-6 and 2.4e-9)."""
    scene = landed("plane", "backward_euler", mu, solver=solver)
    scene.colliders[0].restitution = 0.5
    for iterations in (2, 6):
        plain = Simulation(replace(scene, iterations=iterations), device="cpu", precision="float64")
        plain.run(3)
        found = recorded(replace(scene, iterations=iterations), 3)
        x, here = plain.positions(), found.positions(3)
        off, way = (float(np.linalg.norm(x - y, axis=1).max()) for y in (here, found.positions(0)))
        assert found.plan.choice.solver == plain.plan.choice.solver
        if scene.solver == "implicit":
            assert found.apart.places == pytest.approx(off, rel=1e-6, abs=1e-12)
            assert off < (few if iterations == 2 else more) * way
            assert any("a simulation of these frames ends up to" in w for w in found.sim.warnings) == (off > 1e-3 * way)
        else:
            assert found.apart is None and off < 1e-12
