"""Joint coordinates, links, contact forces and inertial units against closed forms."""

import numpy as np
import pytest

from wsim import Box, Plane, Scene, SceneError, Simulation, Sphere
from wsim.geometry import rotation

G = 9.81


def run(scene: Scene, frames: int, **more) -> Simulation:
    simulation = Simulation(scene, device="cpu", precision="float64", **more)
    simulation.run(frames)
    return simulation


def pendulum(coordinates: str, angle: float = 0.0, **more) -> Scene:
    """A rod of 1 m that hangs from /hinge, a box of 0.04 m across, turned by an angle from the level."""
    scene = Scene(fps=240, substeps=4, coordinates=coordinates, **more)
    rod = scene.body("/rod", Box((0.5, 0.02, 0.02)), at=(0.5, 0.0, 0.0), density=1000.0)
    rod.colliders[0].meets = False
    scene.joint("revolute", "/hinge", None, rod, axis=(0, 0, 1))
    return scene


@pytest.mark.parametrize("coordinates", ["maximal", "reduced"])
def test_joint_and_link_of_a_pendulum_agree(coordinates):
    simulation = run(pendulum(coordinates), 60)
    joints, links = simulation.joints(), simulation.links()
    assert joints.paths == ("/hinge",) and joints.axes == ("rotX",) and links.paths == ("/rod",)
    angle, rate = joints.position[0, 0], joints.velocity[0, 0]
    inertia, mass = (1.0 + 0.04**2) / 12.0 + 0.25, 1.0             # per mass
    assert 0.5 * inertia * rate**2 == pytest.approx(-mass * G * 0.5 * np.sin(angle), rel=1e-4)          # energy
    assert links.place[0, 0] == pytest.approx([0.5 * np.cos(angle), 0.5 * np.sin(angle), 0.0], abs=1e-5)
    assert links.velocity[0, 0] == pytest.approx(0.5 * rate * np.array([-np.sin(angle), np.cos(angle), 0.0]), abs=1e-4)
    assert links.spin[0, 0] == pytest.approx([0.0, 0.0, rate], abs=1e-9)
    R = simulation.poses("/rod")["/rod"]
    assert rotation.quaternion_to_matrix(links.rotation[0, 0]) == pytest.approx(R[:3, :3], abs=1e-12)
    assert np.array_equal(simulation.joints(device=True).position.numpy(), joints.position)
    assert np.array_equal(simulation.links(device=True).velocity.numpy(), links.velocity)


@pytest.mark.parametrize("coordinates", ["maximal", "reduced"])
def test_unit_on_a_pendulum_reads_the_closed_form(coordinates):
    """At the free end, along the rod and across it: f = L (-omega^2, alpha) - g in its axes, in the middle of the frame."""
    simulation = Simulation(pendulum(coordinates), device="cpu", precision="float64")
    simulation.run(40)
    before = simulation.joints()
    simulation.step()
    after, read = simulation.joints(), simulation.imu("/rod", at=(0.5, 0.0, 0.0))
    angle, rate = (0.5 * (getattr(before, name) + getattr(after, name))[0, 0] for name in ("position", "velocity"))
    alpha = -G * 0.5 * np.cos(angle) / ((1.0 + 0.04**2) / 12.0 + 0.25)
    g = -G * np.array([np.sin(angle), np.cos(angle), 0.0])
    assert read.force[0] == pytest.approx(np.array([-rate**2, alpha, 0.0]) - g, abs=2e-3)
    assert read.spin[0] == pytest.approx([0.0, 0.0, rate], abs=1e-6)


def test_unit_reads_nothing_in_free_fall_and_g_up_at_rest():
    scene = Scene(fps=60, substeps=8)
    scene.collider("/floor", Plane())
    scene.body("/falling", Sphere(0.1), at=(3.0, 30.0, 0.0), spin=(0.0, 3.0, 0.0))
    scene.body("/resting", Box((0.1, 0.1, 0.1)), at=(0.0, 0.1, 0.0))
    simulation = run(scene, 60, worlds=2)
    assert np.abs(simulation.imu("/falling").force).max() < 1e-9
    half = np.sqrt(0.5)                                             # the unit's x points up
    assert simulation.imu("/resting", turn=(0.0, 0.0, half, half)).force == pytest.approx(np.tile([G, 0.0, 0.0], (2, 1)),
                                                                                         abs=1e-5)
    links = simulation.links()
    assert links.contact_force[:, 1] == pytest.approx(np.tile([0.0, 8.0 * G, 0.0], (2, 1)), abs=1e-4)
    assert np.abs(links.contact_force[:, 0]).max() == 0.0
    assert links.contact_force[0, 1] == pytest.approx(simulation.contacts("/resting", 0).force.sum(0), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("coordinates", ["maximal", "reduced"])
def test_unit_on_a_turntable_reads_the_centripetal_acceleration(coordinates):
    """3 rad/s at 0.4 m from the axis: 3.6 m/s^2 towards it, g up, and the spin."""
    scene = Scene(fps=240, substeps=4, coordinates=coordinates)
    table = scene.body("/table", Box((0.5, 0.02, 0.5)), spin=(0.0, 3.0, 0.0))
    table.colliders[0].meets = False
    scene.joint("revolute", "/axle", None, table, axis=(0, 1, 0))
    read = run(scene, 30).imu("/table", at=(0.4, 0.0, 0.0))
    assert read.force[0] == pytest.approx([-9.0 * 0.4, G, 0.0], abs=1e-6)
    assert read.spin[0] == pytest.approx([0.0, 3.0, 0.0], abs=1e-9)


def test_readings_change_nothing():
    """What is read between frames leaves the next ones to the bit."""
    for coordinates in ("maximal", "reduced"):
        read, unread = (Simulation(pendulum(coordinates), device="cpu") for _ in range(2))
        for _ in range(10):
            read.step()
            unread.step()
            read.joints(), read.links(), read.imu("/rod")
        assert np.array_equal(read.poses("/rod")["/rod"], unread.poses("/rod")["/rod"])


def test_what_is_not_there_is_refused():
    simulation = Simulation(pendulum("auto"), device="cpu")
    with pytest.raises(SceneError, match="step first"):
        simulation.imu("/rod")
    with pytest.raises(SceneError, match="is no rigid body that moves; there are /rod"):
        simulation.imu("/none")
    with pytest.raises(SceneError, match="the scene has no actuator"):
        simulation.controls()
    lone = Scene()
    lone.body("/ball", Sphere(0.1))
    with pytest.raises(SceneError, match="the scene has no joint that is enabled"):
        Simulation(lone, device="cpu").joints()
