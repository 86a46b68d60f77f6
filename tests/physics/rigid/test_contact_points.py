"""`Simulation.contacts`: weights, friction, momentum, worlds, refused arguments."""

import numpy as np
import pytest

from wsim import Box, Cylinder, Motion, Plane, Scene, SceneError, Simulation, Sphere, shapes
from wsim.geometry import rotation

G = 9.81


def stack(count: int = 3, **more) -> Scene:
    scene = Scene(fps=60, substeps=8, iterations=8, **more)
    scene.collider("/floor", Plane())
    for k in range(count):
        scene.body(f"/box{k}", Box((0.1, 0.1, 0.1)), at=(0.0, 0.1 + 0.2 * k, 0.0), density=1000.0)
    return scene


def run(scene: Scene, frames: int, **more) -> Simulation:
    simulation = Simulation(scene, device="cpu", precision="float64", **more)
    simulation.run(frames)
    return simulation


@pytest.mark.parametrize("more", [{}, {"contact_tolerance": 1e-9}])
def test_floor_bears_the_weight_of_a_stack(more):
    simulation = run(stack(**more), 90)
    for k in range(3):
        below = [f"/box{k - 1}" if k else "/floor"]
        found = simulation.contacts(f"/box{k}")
        up = found.rows(np.isin(found.path1, below))
        assert up.normal_force.sum() == pytest.approx((3 - k) * 8.0 * G, rel=1e-6)
        assert np.abs(found.force.sum(0) - (0.0, 8.0 * G, 0.0)).max() < 1e-5
        assert np.abs(up.normal - (0.0, 1.0, 0.0)).max() < 1e-6


def slope(angle: float, friction: float, **more) -> Scene:
    """A box of 8 kg on a floor that leans."""
    scene = Scene(fps=60, substeps=8, iterations=8, gravity=(G * np.sin(angle), -G * np.cos(angle), 0.0), **more)
    scene.collider("/floor", Plane(), static_friction=friction, dynamic_friction=friction)
    scene.body("/box", Box((0.1, 0.1, 0.1)), at=(0.0, 0.1, 0.0), density=1000.0, static_friction=friction,
               dynamic_friction=friction)
    return scene


@pytest.mark.parametrize("friction", [0.2, 0.9])
def test_box_on_a_slope_feels_coulomb_friction(friction):
    """It sticks by m g sin, or slips by mu m g cos."""
    angle = 0.5
    found = run(slope(angle, friction), 30).contacts("/box")
    assert found.normal_force.sum() == pytest.approx(8.0 * G * np.cos(angle), rel=1e-6)
    held = min(8.0 * G * np.sin(angle), friction * 8.0 * G * np.cos(angle))
    assert np.abs(found.friction.sum(0) - (-held, 0.0, 0.0)).max() < 1e-5 * held


def test_wheel_rolls_down_by_a_third_of_the_pull():
    """A cylinder that rolls has a = 2/3 g sin, so that friction is m g sin / 3."""
    angle = 0.2
    scene = Scene(fps=60, substeps=32, iterations=8, gravity=(G * np.sin(angle), -G * np.cos(angle), 0.0))
    scene.collider("/floor", Plane(), static_friction=1.0, dynamic_friction=1.0)
    scene.body("/wheel", Cylinder(0.2, 0.1), at=(0.0, 0.2, 0.0), mass=3.0, static_friction=1.0, dynamic_friction=1.0)
    found = run(scene, 30).contacts("/wheel")
    assert found.normal_force.sum() == pytest.approx(3.0 * G * np.cos(angle), rel=1e-4)
    assert found.friction.sum(0)[0] == pytest.approx(-G * np.sin(angle), rel=1e-3)


def pile(coordinates: str) -> Scene:
    """Bodies that fall on each other, one substep a frame; two are joined."""
    scene = Scene(fps=240, substeps=1, iterations=4, coordinates=coordinates)
    scene.collider("/floor", Plane())
    turn = rotation.quaternion_exponential(np.array([0.3, 0.5, 0.2]))
    bodies = [scene.body(f"/body{k}", Box((0.1, 0.06, 0.08)), density=500.0,
                         motion=Motion.through([0], [(0.05 * k, 0.15 + 0.16 * k, 0.02 * k)], [turn])) for k in range(4)]
    scene.joint("spherical", "/joint", bodies[0], bodies[1], at=(0.025, 0.23, 0.01))
    return scene


def momentum_misses(coordinates: str) -> tuple[np.ndarray, Simulation]:
    """Error (2,) [kg m/s] of the momentum that forces give in a substep: to all bodies, and to one without joints."""
    simulation = Simulation(pile(coordinates), device="cpu", precision="float64")
    rigid, worst, touched, h = simulation.plan.ports.bodies, np.zeros(2), 0, 1.0 / 240.0
    weight = np.array([[0.0, m.mass * G, 0.0] for m in rigid.masses])
    before = rigid.read("p")
    for _ in range(120):
        simulation.step()
        now = rigid.read("p")
        gain, floor, own = now - before + h * weight, simulation.contacts("/floor"), simulation.contacts("/body3")
        worst = np.maximum(worst, [np.abs(gain.sum(0) + h * floor.force.sum(0)).max(),
                                   np.abs(gain[3] - h * own.force.sum(0)).max()])
        touched, before = touched + len(simulation.contacts()), now
    assert touched > 200
    return worst, simulation


def test_forces_are_the_change_of_momentum():
    """dp = h (contact forces + weight): of one body, and of all with the floor's alone, as their own forces cancel."""
    assert momentum_misses("maximal")[0].max() < 1e-13


def test_forces_on_links_are_the_change_of_momentum():
    """A body without joints gets it to rounding; at rest the floor bears all."""
    worst, simulation = momentum_misses("reduced")
    assert worst[1] < 1e-13
    simulation.run(360)
    weight = sum(m.mass for m in simulation.plan.ports.bodies.masses) * G
    assert simulation.contacts("/floor").force.sum(0) == pytest.approx([0.0, -weight, 0.0], abs=1e-3 * weight)


def test_worlds_have_their_own_contacts():
    simulation = Simulation(stack(1), device="cpu", precision="float64", worlds=3)
    simulation.set("/box0", "mass", [4.0, 8.0, 12.0], world=[0, 1, 2])
    simulation.run(60)
    every = simulation.contacts()
    for world, mass in enumerate((4.0, 8.0, 12.0)):
        found = simulation.contacts("/box0", world)
        assert found.normal_force.sum() == pytest.approx(mass * G, rel=1e-6)
        assert len(found) == 4 and set(found.world) == {world}
    assert len(every) == 12 and every.normal_force.sum() == pytest.approx(24.0 * G, rel=1e-6)


@pytest.mark.parametrize("solver", ["xpbd", pytest.param("implicit", marks=pytest.mark.slow), "explicit"])
def test_floor_bears_a_cloth_and_a_ball_on_it(solver):
    scene = Scene(fps=60, solver=solver)
    scene.collider("/floor", Plane())
    points, counts, indices = shapes.sheet(0.4, 0.4, 8, 8, horizontal=True)
    scene.cloth("/cloth", points + [0.0, 0.002, 0.0], counts, indices)
    scene.body("/ball", Sphere(0.05), at=(0.0, 0.06, 0.0))
    simulation = run(scene, 160)
    cloth, ball = simulation.model.bodies[0].masses.sum() * G, 4.0 / 3.0 * np.pi * 0.05**3 * 1000.0 * G
    assert simulation.contacts("/floor").force.sum(0)[1] == pytest.approx(-cloth - ball, rel=2e-3)
    on_ball = simulation.contacts("/ball")
    assert on_ball.force.sum(0)[1] == pytest.approx(ball, rel=2e-3)
    assert set(on_ball.path1) <= {"/cloth", "/floor"}
    rows = simulation.contacts("/cloth")
    near = rows.point - simulation.positions("/cloth")[rows.element]
    assert np.abs(near).max() < 1e-6


def test_contacts_have_places_and_gaps_and_none_before_the_first_frame():
    simulation = Simulation(stack(1), device="cpu", precision="float64")
    assert len(simulation.contacts()) == 0
    simulation.run(60)
    found = simulation.contacts("/box0")
    corners = np.array([[x, 0.0, z] for x in (-0.1, 0.1) for z in (-0.1, 0.1)])
    assert np.abs(np.sort(found.point, axis=0) - np.sort(corners, axis=0)).max() < 2e-3
    depth = simulation.poses("/box0")["/box0"][1, 3] - 0.1
    assert np.abs(found.gap - depth).max() < 1e-6


@pytest.mark.parametrize(("path", "world", "said"), [("/nothing", None, "/nothing: is no body"),
                                                     (None, 2, "no world 2"), (None, True, "no world True")])
def test_unknown_paths_and_worlds_are_refused(path, world, said):
    with pytest.raises(SceneError, match=said):
        Simulation(stack(1), device="cpu").contacts(path, world)
