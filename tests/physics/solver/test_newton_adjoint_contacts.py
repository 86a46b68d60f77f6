"""Gradients through contacts under Newton's method, solved to a residual: closed forms of sliding and of rest, and differences
of order 8 that cross no kink. Where static friction exceeds dynamic friction what comes to rest has several solutions: so most
have one coefficient."""

import numpy as np
import pytest
import warp as wp

from tests.conftest import first_and_slow
from tests.make.gradient.gradients import Run
from tests.make.physics.contact.project_adjoint import Slid, dropped
from tests.make.physics.solver.newton_adjoint_contacts import NEWTON
from wsim.gradient.recording import Recording
from wsim.kernels.solver.newton_adjoint import falling
from wsim.scene import Plane, Scene, Springs
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation

G = 9.81


def tilted(axis: int, angle: float, height: float) -> Motion:
    """Of a plane, turned about an axis."""
    M = np.eye(4)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    M[i, i] = M[j, j] = np.cos(angle)
    M[j, i], M[i, j] = np.sin(angle), -np.sin(angle)
    M[:3, 3] = M[:3, 2] * height
    return Motion.still(M)


def check(run: Slid, within: float = 3e-9, step: float = 1e-5) -> None:
    """By positions, velocities, gravity and stiffness; the solves were ones."""
    assert run.recording.residuals["forward"] < 1e-12 and run.recording.residuals["adjoint"] < 1e-11
    run.by("positions", 1e-6, within)
    run.by("velocities", step, within)
    g, way = np.asarray(run.scene.gravity), np.array([0.3, -0.5, 0.8])
    run.check(run.gradient.gravity() @ way, lambda s: ("/", "gravity", g + s * way), 1e-4, within)
    run.check(run.gradient.material("stretch"), lambda s: ("/cloth", "stretch", 40.0 + s), 1e-3, 10.0 * within)


@pytest.mark.parametrize("shape, integrator", first_and_slow([("plane", "backward_euler"), ("sphere", "bdf2")]))
def test_a_sheet_that_falls_on_a_turning_collider_and_slides(shape, integrator):
    run = Slid(dropped(shape, friction=(0.4, 0.4), spin=3.0, **NEWTON | {"integrator": integrator}), frames=4)
    check(run)
    for path in ("/cloth", "/floor"):
        run.check(run.gradient.friction(path)[1], lambda s, path=path: (path, "dynamic_friction", 0.4 + s), 1e-6, 3e-8)


def test_a_recording_ends_where_a_simulation_of_many_newton_steps_does():
    scene = dropped(friction=(0.4, 0.4), spin=3.0, **NEWTON)
    recording = Recording(Simulation(scene, device="cpu", precision="float64", gradients=True), 4)
    scene.iterations = 60
    plain = Simulation(scene, device="cpu", precision="float64")
    plain.run(4)
    assert plain.indicators()["contacts"] >= 5
    assert np.abs(plain.positions() - recording.positions(4)).max() < 1e-6             # its residual is 4e-6 at best


def test_a_sheet_that_slides_on_a_floor_along_a_wall():
    """Points of its edge touch both at once, which are not at right angles."""
    scene = dropped("plane", friction=(0.2, 0.2), gap=0.002, **NEWTON)
    scene.gravity = (6.0, 1.0, -9.8)
    scene.collider("/wall", Plane(), motion=tilted(1, -1.25, -0.0985), static_friction=0.3, dynamic_friction=0.3)
    run = Slid(scene, frames=4)
    run.recording.run()
    pushes = run.sim.plan.method("contact").contacts.push.numpy().reshape(2, -1, 3)
    assert ((np.linalg.norm(pushes, axis=-1) > 0).all(axis=0)).sum() >= 2
    check(run, 2e-8, 3e-5)      # that by velocities is a thousandth of the others: in steps of 1e-5 rounding is 2e-8 of it


def test_a_sheet_that_sticks_to_a_turning_plane_is_carried():
    scene = dropped("plane", friction=(1.5, 1.5), spin=3.0, **NEWTON)
    scene.gravity = (0.0, 0.0, -9.8)
    run = Slid(scene, frames=4)
    run.recording.run()
    assert 2 in run.sim.plan.method("implicit").adjoint.contacts.frame.bears.numpy()
    check(run)


def truss(speed: float, friction: float, frames: int, **more) -> Scene:
    """Three springs in an upright triangle that stands on a plane; nothing leaves its plane."""
    points = np.array([[-0.1, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, 0.15]])
    net = Springs("/truss", points, np.array([[0, 1], [1, 2], [2, 0]]), masses=np.array([0.05, 0.1, 0.2]), damping=1e-3,
                  stiffness=np.array([400.0]), velocities=np.tile([speed, 0.0, 0.0], (3, 1)), static_friction=friction,
                  dynamic_friction=friction)
    scene = Scene(objects={"Springs": [net]}, fps=60, frames=frames, gravity=(0.0, 0.0, -G), **NEWTON | more)
    scene.collider("/floor", Plane("Z"), static_friction=friction, dynamic_friction=friction)
    return scene


def test_what_slides_loses_momentum_by_coulombs_law():
    """P_x + mu P_z changes by -mu m g T whatever the springs do, which gives every derivative of it."""
    mu, T, m = 0.25, 10 / 60, np.array([0.05, 0.1, 0.2])
    recording = Recording(Simulation(truss(2.0, mu, 10), device="cpu", precision="float64", gradients=True), 10)
    way = np.array([1.0, 0.0, mu])
    gradient, v0, v = recording.backward(velocities={10: m[:, None] * way}), recording.velocities(0), recording.velocities(10)
    assert v[:, 0].min() > 1.0 and np.ptp(v[:, 2]) > 1e-3
    assert m @ (v - v0) @ way == pytest.approx(-mu * m.sum() * G * T, rel=1e-12)
    assert np.abs(gradient.velocities() - m[:, None] * way).max() < 1e-12
    assert np.abs(gradient.positions()).max() < 1e-10
    assert gradient.gravity() == pytest.approx(m.sum() * T * way, abs=1e-12)
    assert abs(gradient.material("stiffness")) < 1e-14
    assert gradient.masses() == pytest.approx((v0 - v) @ way - mu * G * T, rel=1e-10)
    lost = -(m.sum() * G * T + m @ (v - v0)[:, 2])
    assert gradient.friction() == pytest.approx([0.0, 0.5 * lost], rel=1e-10)          # the mean of both is mu


def test_what_stands_on_its_feet_gives_way_by_statics():
    """2 k (L / l - 1) z = m g at rest, with feet that stick: z by k, m and g."""
    frames, k, m = 120, 400.0, 0.2
    recording = Recording(Simulation(truss(0.0, 1.5, frames), device="cpu", precision="float64", gradients=True), frames)
    seed = np.zeros((3, 3))
    seed[2, 2] = 1.0
    gradient, x = recording.backward({frames: seed}), recording.positions(frames)
    c, z = x[1, 0], x[2, 2]                                                            # points are float32 at the start
    rest, now = np.hypot(*recording.positions(0)[2, ::2] - recording.positions(0)[1, ::2]), np.hypot(c, z)
    assert 2.0 * k * (rest / now - 1.0) * z == pytest.approx(m * G, rel=1e-9)
    slope = 2.0 * k * (rest / now - 1.0 - rest * z**2 / now**3)
    assert gradient.material("stiffness") == pytest.approx(-m * G / k / slope, rel=1e-8)
    assert gradient.gravity()[2] == pytest.approx(-m / slope, rel=1e-8)
    assert gradient.masses()[2] == pytest.approx(G / slope, rel=1e-8)
    assert np.abs(gradient.velocities()).max() < 1e-9


def test_what_is_thrown_back():
    """A truss that lands askew, by BDF2, by restitution too."""
    scene = truss(1.0, 0.25, 3, integrator="bdf2")
    scene.springs[0].velocities = np.tile([1.0, 0.1, -1.0], (3, 1)).astype(np.float32)
    scene.springs[0].points += np.array([[0.0, 0.0, 0.011], [0.0, 0.01, 0.004], [0.01, 0.0, 0.005]], np.float32)
    scene.colliders[0].restitution = 0.5
    run = Run(scene)
    assert run.recording.velocities(1)[0, 2] > 0.4
    run.state("positions", 1e-6)
    run.check(run.gradient.friction("/floor")[1], lambda s: ("/floor", "dynamic_friction", 0.25 + s), 1e-5)
    run.check(run.gradient.restitution("/floor"), lambda s: ("/floor", "restitution", 0.5 + s), 1e-3)


def test_a_solve_ends_where_rounding_keeps_it():
    """Ten steps after its squared residual last fell by a fifth; not before, however slowly it falls."""
    kernel = falling(wp.float64, "unique")
    for residuals, steps in (([0.9**k for k in range(9)] + [0.4] * 90, 19), ([0.75**k for k in range(80)], 60)):
        count, going = (wp.zeros(1, dtype=int, device="cpu") for _ in range(2))
        best, least = wp.zeros(2, dtype=wp.float64, device="cpu"), wp.ones(1, dtype=wp.float64, device="cpu")
        for residual in residuals:
            now = wp.array([residual], dtype=wp.float64, device="cpu")
            wp.launch(kernel, 1, [now, least, 1e-13, 60, count, best], [going], device="cpu")
            if not going.numpy()[0]:
                break
        assert int(count.numpy()[0]) - 1 == steps
