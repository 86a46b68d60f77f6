"""Implicit steps by Newton's method in whole scenes: closed forms, independent integrators, contacts, abuse."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from tests.make.physics.solver.newton import DOUBLE, INTEGRATORS, garment, make
from tools.bench.nets import converged, reference
from wsim.physics.solver import newton
from wsim.scene import Plane, Scene, Sphere, shapes
from wsim.scene.curve import Motion
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation


def net_of_linear_springs(**more) -> tuple[Scene, np.ndarray, np.ndarray]:
    """Springs of (nearly) no length pull linearly: scene, K (the same in x, y, z), masses; point 0 is pinned."""
    points = np.random.default_rng(4).normal(size=(5, 3)).astype(np.float32)
    edges, k, masses = [[0, 1], [1, 2], [2, 3], [3, 4], [0, 4], [1, 3]], 10.0 + 7.0 * np.arange(6), 0.1 + 0.05 * np.arange(5)
    scene = make(**more)
    net = scene.net("/net", points, edges, k, masses, lengths=np.full(6, 1e-12))
    scene.pin("/pin", net, [0])
    K = np.zeros((5, 5))
    for (i, j), c in zip(edges, scene.springs[0].stiffness, strict=True):
        K[[i, j], [i, j]] += c
        K[[i, j], [j, i]] -= c
    return scene, K, scene.springs[0].masses.astype(float)


def test_one_step_of_linear_springs_is_the_linear_solve_of_backward_euler(monkeypatch):
    monkeypatch.setattr(newton, "TOLERANCE", 1e-13)
    scene, K, masses = net_of_linear_springs(substeps=1)
    x, h = scene.springs[0].points.astype(float), 1.0 / 60.0
    A, rhs = np.diag(masses) + h * h * K, h * (masses[:, None] * np.array(scene.gravity) - K @ x)
    sim = Simulation(scene, **DOUBLE)
    sim.step()
    np.testing.assert_allclose(sim.velocities()[1:], np.linalg.solve(A[1:, 1:], rhs[1:]), rtol=1e-10)


def test_midpoint_keeps_the_energy_of_linear_springs(monkeypatch):
    monkeypatch.setattr(newton, "TOLERANCE", 1e-13)
    scene, _, _ = net_of_linear_springs(substeps=1, integrator="implicit_midpoint")
    sim = Simulation(scene, **DOUBLE)
    before = sim.indicators()["energy"]
    sim.run(100)
    after = sim.indicators()
    assert after["energy"] == pytest.approx(before, rel=1e-10) and after["kinetic_energy"] > 0.01 * before


def midpoint(net, times, h):
    """Converged implicit midpoint: backward Euler of half the step, gone on to its end."""
    solve, x, v, found = converged._newton(net), net.points, np.zeros_like(net.points), []
    for steps in reference.steps_between(times, h):
        for _ in range(steps):
            q = 0.5 * h
            d = solve(x, q * (v + q * net.free * np.asarray(net.gravity)), q)
            x, v = x + 2.0 * d, 2.0 * d / q - v
        found.append(x)
    return np.array(found)


def sdirk3(net, times, h):
    """Converged, by the tableau: X_i = x + h sum a_ij V_j, V_i = v + h sum a_ij A_j, x' = x + h sum b_i V_i."""
    g = 0.5 + 3.0**0.5 / 6.0
    solve, x, v, found = converged._newton(net), net.points, np.zeros_like(net.points), []
    for steps in reference.steps_between(times, h):
        for _ in range(steps):
            V, A = [], []
            for before in (0.0, 1.0 - 2.0 * g):
                base, speed = (y + h * before * k[0] if k else y for y, k in ((x, V), (v, A)))
                d = solve(base, g * h * (speed + g * h * net.free * np.asarray(net.gravity)), g * h)
                V.append(d / (g * h))
                A.append((V[-1] - speed) / (g * h))
            x, v = x + 0.5 * h * (V[0] + V[1]), v + 0.5 * h * (A[0] + A[1])
        found.append(x)
    return np.array(found)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_solved_steps_follow_an_independent_solver(integrator):
    pytest.importorskip("scipy")
    scene = replace(reference.spring_cloth(8), solver="implicit", integrator=integrator, substeps=4, iterations=10)
    net, times, h = reference.net(scene), [0.25, 0.5], 1.0 / 240.0
    own = {"implicit_midpoint": midpoint, "sdirk3": sdirk3}
    wanted = own[integrator](net, times, h) if integrator in own else converged.converged(net, times, h, integrator)
    sim = Simulation(scene, **DOUBLE)
    for frames in wanted:
        sim.run(15)
        assert reference.rms(sim.positions() - frames) < 1e-7                 # Newton there stops at a change of 1e-10 m
    assert sim.indicators()["residual"] < 1e-6 and not sim.warnings        # a gain under 1e-15 of Phi is not seen


@pytest.mark.parametrize("integrator, order", [*zip(INTEGRATORS, (1, 2, 2, 3), strict=True)])
def test_the_observed_order_is_the_declared_one(integrator, order):
    scene = replace(reference.spring_cloth(6), solver="implicit", integrator=integrator, iterations=4)
    (where,), _ = reference.exact(reference.net(scene), [0.25], tolerance=1e-8 if order < 3 else 1e-10)
    errors = []
    for substeps in (8, 16, 32) if order < 3 else (4, 8, 16):
        sim = Simulation(replace(scene, substeps=substeps), **DOUBLE)
        sim.run(15)
        errors.append(reference.rms(sim.positions() - where))
    assert -np.polyfit(np.log([1, 2, 4]), np.log(errors), 1)[0] == pytest.approx(order, abs=0.2)


def test_a_free_cloth_keeps_its_momenta(monkeypatch):
    """Midpoint, solved: linear and angular momentum are quadratic invariants."""
    monkeypatch.setattr(newton, "TOLERANCE", 1e-8)
    scene = make(integrator="implicit_midpoint", gravity=(0.0, 0.0, 0.0), substeps=4, iterations=6)
    points, counts, indices = shapes.sheet(1.0, 1.0, 4, 4)
    scene.cloth("/cloth", points, counts, indices, velocities=np.random.default_rng(3).normal(size=points.shape),
                material=Fabric(bend=1e-3))
    sim = Simulation(scene, **DOUBLE)
    masses = sim.model.stack("masses")[sim.model.body("/cloth").index]

    def momenta():
        x, v = sim.positions(), sim.velocities()
        return np.stack([masses @ v, (masses[:, None] * np.cross(x, v)).sum(axis=0)]) / masses.sum()
    before = momenta()
    sim.run(10)
    np.testing.assert_allclose(momenta(), before, atol=1e-9)


@pytest.mark.parametrize("elements", ["springs", "membrane"])
def test_a_free_cloth_keeps_its_momentum_however_little_is_solved(monkeypatch, elements):
    monkeypatch.setattr(newton, "CAP", 2)
    scene = make(gravity=(0.0, 0.0, 0.0), iterations=2)
    points, counts, indices = shapes.sheet(1.0, 1.0, 4, 4)
    scene.cloth("/cloth", points, counts, indices, velocities=100.0 * np.random.default_rng(3).normal(size=points.shape),
                model=elements, material=Fabric(stretch=1e5))
    held = scene.cloth("/held", points + 2.0, counts, indices, velocities=np.ones_like(points), model=elements)
    scene.pin("/pin", held, [0])
    sim = Simulation(scene, **DOUBLE)
    masses = sim.model.stack("masses")[sim.model.body("/cloth").index]
    before, held = masses @ sim.velocities("/cloth"), sim.positions("/held")[0]
    sim.run(10)
    assert sim.indicators()["residual"] > 1e-2                                    # it is far from solved
    np.testing.assert_allclose(masses @ sim.velocities("/cloth"), before, atol=1e-11 * masses.sum() * 100.0)
    np.testing.assert_array_equal(sim.positions("/held")[0], held)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_chain_pressed_together_in_a_line_leaves_it(precision):
    """Two springs of 1 m between pins 1 m apart: straight, they balance; the middle ends sqrt(3) / 2 m beside the line."""
    scene = make(gravity=(0.0, 0.0, 0.0), air_drag=5.0)
    net = scene.net("/net", [[0, 0, 0], [0.5, 0, 0], [1, 0, 0]], [[0, 1], [1, 2]], [1e4, 1e4], [0.1], lengths=[1.0, 1.0])
    scene.pin("/pin", net, [0, 2])
    sim = Simulation(scene, device="cpu", precision=precision)
    sim.run(300)
    x = sim.positions()[1]
    assert x[0] == pytest.approx(0.5, abs=1e-4) and np.hypot(x[1], x[2]) == pytest.approx(0.75**0.5, abs=1e-4)


def test_free_fall_is_exact():
    scene = make(substeps=3)
    scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, 3, 3))
    sim = Simulation(scene, **DOUBLE)
    start, h, n = sim.positions(), 1.0 / 180.0, 60
    sim.run(20)
    fallen = [0.0, -9.81 * h * h * n * (n + 1) / 2, 0.0]
    np.testing.assert_allclose(sim.positions() - start, np.tile(fallen, (16, 1)), atol=1e-12)
    assert sim.indicators()["residual"] < 1e-12


def test_pins_stand_and_move_exactly():
    scene = make()
    cloth = scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, 4, 4), material=Fabric(stretch=1e6))
    scene.pin("/still", cloth, [0])
    scene.pin("/moving", cloth, [4])
    sim = Simulation(scene, **DOUBLE)
    first = sim.positions()
    for k in range(5):
        sim.set("/moving", "motion", Motion.at_place((0.01 * k, 0.02 * k, 0.0)))
        sim.step()
        np.testing.assert_allclose(sim.positions()[[0, 4]], first[[0, 4]] + [[0, 0, 0], [0.01 * k, 0.02 * k, 0]], atol=1e-14)


def test_a_damped_spring_follows_the_closed_form_of_backward_euler(monkeypatch):
    monkeypatch.setattr(newton, "TOLERANCE", 1e-13)
    k, m, tau, h = 200.0, 0.5, 0.02, 1.0 / 120.0
    scene = make(gravity=(0.0, 0.0, 0.0))
    net = scene.net("/net", [[0, 0, 0], [1.25, 0, 0]], [[0, 1]], [k], [m], lengths=[1.0], damping=tau)
    scene.pin("/pin", net, [0])
    sim = Simulation(scene, **DOUBLE)
    x, v = 0.25, 0.0
    for _ in range(20):
        sim.step()
        for _ in range(2):
            v = (v - h * k * x / m) / (1.0 + (tau + h) * h * k / m)
            x += h * v
        assert sim.positions()[1, 0] - 1.0 == pytest.approx(x, abs=1e-10)
    assert abs(x) < 0.05


def test_a_soft_pin_sags_by_weight_over_stiffness():
    scene = make(substeps=4)
    net = scene.net("/net", [[0, 0, 0], [1, 0, 0]], [[0, 1]], [100.0], [0.2])
    scene.pin("/a", net, [0, 1], stiffness=150.0, damping=3.0)
    scene.pin("/b", net, [0, 1], stiffness=50.0, damping=1.0)
    sim = Simulation(scene, **DOUBLE)
    sim.run(200)
    np.testing.assert_allclose(sim.positions()[:, 1], -9.81 * np.float32(0.2) / 200.0, rtol=1e-6)


def floor(tilt: float = 0.0) -> Motion:
    """A plane through the origin whose normal is +y, turned by `tilt` [rad] about z."""
    c, s = np.cos(tilt), np.sin(tilt)
    M = np.eye(4)
    M[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    return Motion.still(M)


def lying(tilt: float, friction: float, **more) -> Scene:
    """A sheet that lies on a plane."""
    scene = make(**more)
    points, counts, indices = shapes.sheet(1.0, 1.0, 4, 4, horizontal=True, at=(0.0, 5e-4, 0.0))
    points = points @ np.array([[np.cos(tilt), np.sin(tilt), 0], [-np.sin(tilt), np.cos(tilt), 0], [0, 0, 1]])
    scene.cloth("/cloth", points, counts, indices, material=Fabric(static_friction=friction, dynamic_friction=friction))
    scene.collider("/floor", Plane(), motion=floor(tilt), static_friction=friction, dynamic_friction=friction)
    return scene


@pytest.mark.parametrize("integrator", ["backward_euler", "bdf2"])
@pytest.mark.parametrize("tilt, friction", [(0.0, 0.0), (0.0, 0.5), (0.3, 0.5)])
def test_a_cloth_at_rest_stays_and_does_not_jitter(tilt, friction, integrator):
    sim = Simulation(lying(tilt, friction, integrator=integrator, iterations=1), **DOUBLE)
    start = sim.positions()
    for _ in range(20):
        sim.step()
        assert np.abs(sim.velocities()).max() < 1e-6
    np.testing.assert_allclose(sim.positions(), start, atol=1e-7)             # the scene's points are float32


def test_a_cloth_slides_down_a_slope_at_coulombs_rate():
    tilt, friction = 0.5, 0.2
    sim = Simulation(lying(tilt, friction, iterations=1), **DOUBLE)
    sim.run(30)
    wanted = 9.81 * (np.sin(tilt) - friction * np.cos(tilt)) * 0.5
    np.testing.assert_allclose(np.linalg.norm(sim.velocities(), axis=1), wanted, rtol=1e-6)


def drape(**more) -> Scene:
    scene = make(**{"substeps": 8, "iterations": 2} | more)
    scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, 12, 12, horizontal=True), material=Fabric(stretch=800.0, bend=1e-4))
    scene.collider("/ball", Sphere(0.25), at=(0.02, -0.27, 0.01))
    return scene


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_drape_stays_outside_and_has_the_same_bits_twice(precision):
    ends = []
    for _ in range(2):
        sim = Simulation(drape(), device="cpu", precision=precision)
        sim.run(30)
        ends.append(sim.positions())
    assert np.array_equal(*ends)
    assert np.linalg.norm(ends[0] - (0.02, -0.27, 0.01), axis=1).min() > 0.25 - 1e-4


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("model", ["springs", "membrane"])
def test_a_scrambled_cloth_ends_finite_and_recovers(model, precision):
    """1e9 N/m, frames of 1/10 s, points anywhere in the unit cube."""
    scene = make(fps=10.0, substeps=1, iterations=8, gravity=(0.0, 0.0, 0.0))
    points, counts, indices = shapes.sheet(1.0, 1.0, 8, 8)
    scene.cloth("/cloth", points, counts, indices, model=model, material=Fabric(stretch=1e9, shear=1e9, bend=1e-3))
    sim = Simulation(scene, device="cpu", precision=precision)
    sim.set("/cloth", "positions", np.random.default_rng(5).random((len(points), 3)))
    stored = [sim.indicators()["energy"]]
    for _ in range(40):
        sim.step()
        now = sim.indicators()
        assert np.isfinite(sim.positions()).all() and now["energy"] <= stored[-1] * (1.0 + 1e-5)
        stored.append(now["energy"])
    assert stored[-1] < 1e-4 * stored[0] and all("residual" in w or "as long as at rest" in w for w in sim.warnings)


def test_single_precision_follows_double():
    scene = replace(reference.spring_cloth(12), solver="implicit", integrator="backward_euler", substeps=16, iterations=2)
    ends = []
    for precision in ("float32", "float64"):
        sim = Simulation(scene, device="cpu", precision=precision)
        sim.run(15)
        ends.append(sim.positions())
    assert reference.rms(ends[0] - ends[1]) < 2e-6                            # of the 1 m that it is wide


def test_worlds_and_repeated_frames_do_what_a_single_run_does():
    scene = garment(damping=1e-3)
    scene.pin("/pin", "/cloth", [0])
    alone, many = Simulation(scene, **DOUBLE), Simulation(scene, worlds=3, **DOUBLE)
    for frame in range(6):
        alone.step()
        many.step()
        if frame == 3:
            many.state.restore_snapshot()                                     # as a frame that is repeated
            many.frame -= 1
            many.step()
    for path in ("/cloth", "/springs"):
        assert np.array_equal(alone.positions(path), many.positions(path, world=2))


def test_bdf2_gives_way_where_its_steps_are_not_solved():
    scene = replace(reference.spring_cloth(12, stretch=1e5, diagonal=1e5), solver="implicit", integrator="bdf2", substeps=1)
    poor, good = (Simulation(replace(scene, iterations=n), **DOUBLE) for n in (1, 30))
    poor.run(20)
    good.run(4)
    assert poor.plan.integrator == "backward_euler" and any("residual" in w for w in poor.warnings)
    assert good.plan.integrator == "bdf2"


def test_stiffness_and_damping_are_live():
    scene = make(substeps=4)
    net = scene.net("/net", [[0, 0, 0], [0, -1, 0]], [[0, 1]], [100.0], [0.5])
    scene.pin("/pin", net, [0])
    sim = Simulation(scene, **DOUBLE)
    sim.set("/net", "damping", 0.2)
    sim.set("/net", "stiffness", 400.0)
    sim.run(200)
    assert sim.positions()[1, 1] == pytest.approx(-1.0 - 0.5 * 9.81 / 400.0, rel=1e-6)


def test_a_shipped_scene_runs():
    import wsim
    scene = replace(wsim.load("scenes/hanging_cloth.usda"), solver="implicit", integrator="backward_euler", iterations=1)
    sim = Simulation(scene, device="cpu")
    sim.run(3)
    assert np.isfinite(sim.positions()).all() and "pcg_iterations" in sim.indicators() and not sim.warnings


@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")
@pytest.mark.parametrize("scene, bound", [(garment(damping=1e-3, iterations=6), 1e-9), (drape(iterations=30), 1e-6)],
                         ids=["garment", "drape"])
def test_cpu_and_gpu_agree_and_the_gpu_has_the_same_bits_twice(scene, bound, monkeypatch):
    """Solved to the end; contacts amplify what is left: the drape differs by 3e-8 m so, by 7e-5 m with 2 steps to 1e-2."""
    monkeypatch.setattr(newton, "TOLERANCE", 1e-13)
    ends = []
    for device in ("cpu", "cuda:0", "cuda:0"):
        sim = Simulation(scene, device=device, precision="float64")
        sim.run(8)
        ends.append(sim.positions("/cloth"))
    assert reference.rms(ends[0] - ends[1]) < bound and np.array_equal(ends[1], ends[2])


def test_a_sheet_shrunk_to_one_place_opens_in_float32():
    """Hinges of triangles too small for an angle pull at nothing; their gradient left the range of float32 before."""
    scene = Scene(fps=60.0, substeps=10, iterations=4, solver="implicit", integrator="backward_euler", air_drag=1.0)
    scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, 4, 4), material=Fabric(stretch=1e3, shear=300.0, bend=1e-4))
    sim = Simulation(scene, device="cpu")
    sim.set("/cloth", "positions", np.full((25, 3), 0.2))
    sim.run(6)
    assert sim.indicators()["rms_strain"] < 0.05


def test_newtons_method_falls_into_few_subjects():
    """At most 20 attributes each, of the method and of its system; 53 stood in one class."""
    method = Simulation(garment(), **DOUBLE).plan.method("implicit")
    assert len(vars(method)) <= 20 and len(vars(method.assembly)) <= 20
