"""Material points and rigid bodies push each other: conservation laws, weight, and no particle within a body."""

import numpy as np
import pytest

import wsim
from wsim.physics.mpm.objects import Granular, Jelly

from .test_method import find_method, total_momentum


def body_state(simulation):
    """The method of rigid bodies, and the centres of mass [m]."""
    rigid = simulation.plan.method("rigid")
    return rigid, rigid.origin + rigid.get("x") + rigid.get("e")


def whole_momentum(simulation):
    """Momentum and angular momentum of particles and bodies."""
    p, spin = total_momentum(simulation)
    rigid, x = body_state(simulation)
    return p + rigid.get("p").sum(axis=0), spin + (np.cross(x, rigid.get("p")) + rigid.get("L")).sum(axis=0)


def whole_energy(simulation):
    """Kinetic and elastic energy of particles and bodies [J], without weight."""
    rigid, _ = body_state(simulation)
    return (simulation.indicators()["mpm_energy"] + 0.5 * float(np.sum(rigid.get("p") * rigid.velocities()))
            + 0.5 * float(np.sum(rigid.get("L") * rigid.spins())))


def make_world(size=1.0, at=(0, 0, 0), **more):
    """A scene with a box to fall on, and far away what the others have: all tests share compiled kernels."""
    scene = wsim.Scene(fps=60 / size**0.5, **more)
    at = np.array(at, float)
    scene.collider("/floor", wsim.Box(np.array([3, 0.5, 3]) * size), at=at - [0, 0.5 * size, 0], static_friction=0.0,
                   dynamic_friction=0.0)
    for k, material in enumerate((Jelly(1e5 * size), Granular(3.5e5 * size))):
        scene.mpm(f"/speck{k}", points=[at + np.array([2.5, 0.02, k]) * size], volumes=(0.025 * size)**3, cell=0.05 * size,
                  material=material)
    return scene


def collision(ratio, size=1.0, at=(0, 0, 0)):
    """A jelly of 8 kg that spins hits a ball of `ratio` times that; size: of a metre [m]."""
    scene = make_world(size, np.array(at) - [0, 2 * size, 0], gravity=(0, 0, 0))
    at, pace = np.array(at, float), size**0.5
    scene.mpm("/jelly", wsim.Box((0.1 * size,) * 3), at=at, cell=0.05 * size, velocity=np.array([1, 0.2, 0]) * pace,
              spin=np.array([0, 3, 5]) / pace, material=Jelly(2e4 * size))
    scene.body("/ball", wsim.Sphere(0.12 * size), at=at + np.array([0.3, 0.06, 0.01]) * size, mass=8.0 * ratio * size**3,
               velocity=np.array([-1, 0, 0.3]) * pace)
    return scene


def bed(material, size=1.0, at=(0, 0, 0), depth=0.1):
    """A tank of 0.6 x 0.6 m, full of a material up to twice `depth`."""
    scene, at = make_world(size, at), np.array(at, float)
    for k, (x, z) in enumerate(((1, 0), (-1, 0), (0, 1), (0, -1))):
        half = np.array([0.5 if x else 1.3, 1.0, 0.5 if z else 1.3]) * size
        scene.collider(f"/wall{k}", wsim.Box(half), at=at + np.array([0.8 * x, 1.0, 0.8 * z]) * size, static_friction=0.0,
                       dynamic_friction=0.0)
    scene.mpm("/bed", wsim.Box(np.array([0.3, depth, 0.3]) * size), at=at + [0, depth * size, 0], cell=0.05 * size,
              material=material)
    return scene


@pytest.mark.parametrize("ratio", [0.01, 1.0, 100.0])
def test_momentum_and_angular_momentum_stay(ratio):
    simulation = wsim.Simulation(collision(ratio), device="cpu", precision="float64")
    p, spin = whole_momentum(simulation)
    before, energy = simulation.plan.method("rigid").velocities()[0], whole_energy(simulation)
    for _ in range(15):
        simulation.step()
        p_now, spin_now = whole_momentum(simulation)
        rigid, x = body_state(simulation)
        assert np.abs(p_now - p).max() < 1e-9 * (8 + 8 * ratio) and np.abs(spin_now - spin).max() < 1e-9 * (8 + 8 * ratio)
        distance = np.linalg.norm(find_method(simulation).read_particles(2)["x"] - x[0], axis=1)
        assert distance.min() > 0.12
    assert np.linalg.norm(rigid.velocities()[0] - before) > 0.01
    assert whole_energy(simulation) < energy and not simulation.warnings


def test_single_precision_keeps_momentum_over_a_thousand_steps():
    """1e-6 of the sum of m |v| of jelly and ball, and 1e-5 of the angular momentum."""
    simulation = wsim.Simulation(collision(1.0), device="cpu")
    m, steps = find_method(simulation), 0
    jelly = m.read_particles(2)
    size = (jelly["m"] * np.linalg.norm(jelly["v"], axis=1)).sum() + 8 * np.sqrt(1.09)
    p, spin = whole_momentum(simulation)
    while steps < 1000:
        simulation.step()
        steps += int(m.status.said("mpm: grid")[3])
    p_end, spin_end = whole_momentum(simulation)
    assert np.abs(p_end - p).max() < 1e-6 * size and np.abs(spin_end - spin).max() < 1e-5 * np.linalg.norm(spin)


@pytest.mark.parametrize(("size", "at"), [(1e-3, (0, 0, 0)), (1.0, (1000, 0, -1000)), (1000.0, (0, 0, 0))])
def test_the_same_at_other_sizes_and_places(size, at):
    """Froude's scaling: lengths by s, times by the root of s, stiffness by s. The ball has the same momentum, scaled."""
    speeds = []
    for scale, place in ((1.0, (0, 0, 0)), (size, at)):
        simulation = wsim.Simulation(collision(1.0, scale, place), device="cpu")
        simulation.run(8)
        speeds.append(simulation.plan.method("rigid").velocities()[0] / scale**0.5)
    assert np.abs(speeds[1] - speeds[0]).max() < 2e-3 and np.abs(speeds[0][0]) < 0.6


def mean_force(simulation, frames):
    """Mean force of particles on the first body over frames [N], world (3,)."""
    found = []
    for _ in range(frames):
        simulation.step()
        found.append(find_method(simulation).exchange.own.given_p.numpy()[0] * simulation.scene.fps)
    return np.mean(found, axis=0)


def test_a_ball_that_rests_on_jelly_presses_with_its_weight():
    scene = bed(Jelly(2e5, viscosity=20.0), depth=0.05)
    scene.body("/ball", wsim.Sphere(0.1), at=(0, 0.203, 0), density=1000.0)
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(50)
    weight = 1000.0 * 4 / 3 * np.pi * 0.1**3 * 9.81
    assert np.abs(mean_force(simulation, 10) / weight - [0, 1, 0]).max() < 2e-3


@pytest.mark.parametrize(("ratio", "depth"), [(0.01, 0.05), (8.0, 0.1)])
def test_light_and_heavy_balls_rest_on_sand(ratio, depth):
    """Added mass: the ball has 1/100 of the sand's density, or sinks in."""
    scene = bed(Granular(friction_angle=0.6), depth=depth)
    scene.body("/ball", wsim.Sphere(0.1), at=(0, 2.0 * depth + 0.103, 0), density=1600.0 * ratio)
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(40)
    weight = 1600.0 * ratio * 4 / 3 * np.pi * 0.1**3 * 9.81
    assert np.abs(mean_force(simulation, 20) / weight - [0, 1, 0]).max() < 0.02
    rigid, x = body_state(simulation)
    particles = find_method(simulation).read_particles(2)["x"]
    assert np.linalg.norm(particles - x[0], axis=1).min() > 0.1
    assert np.abs(rigid.velocities()).max() < 0.2


def test_same_bits_twice_and_in_each_world():
    scene = bed(Granular(friction_angle=0.6))
    scene.body("/ball", wsim.Sphere(0.1), at=(0.02, 0.32, 0), density=3000.0, spin=(3, 0, 20))
    one, two = (wsim.Simulation(scene, device="cpu", worlds=worlds) for worlds in (1, 2))
    for simulation in (one, two):
        simulation.run(6)
    for part in ("mpm", "bodies", "mpm bodies"):
        first, other = one.state.parts[part], two.state.parts[part]
        for name, array in first.arrays.items():
            n = first.count
            assert np.array_equal(array.numpy()[:n], other.arrays[name].numpy()[:n]), name
            assert np.array_equal(array.numpy()[:n], other.arrays[name].numpy()[n:2 * n]), name
    spin = one.plan.method("rigid").spins()[0]
    assert np.linalg.norm(spin - [3, 0, 20]) > 0.5             # sand slows it by friction


@pytest.mark.parametrize(("mass", "thickness"), [(0.128, 0.05), (128.0, 0.05), (0.128, 0.1)])
def test_a_plate_on_the_floor_carries_all_of_the_sand_on_it(mass, thickness):
    """The floor bears what the sand presses with, up to 100 times the plate's weight; none of it goes to the floor past the
    plate, though nodes below the thin ones reach the sand. Nothing slides, nor turns."""
    scene = make_world()
    scene.body("/plate", wsim.Box((0.7, 0.5 * thickness, 0.7)), at=(0, 0.5 * thickness, 0), mass=mass)
    scene.mpm("/heap", wsim.Box((0.1, 0.1, 0.1)), at=(0, thickness + 0.1, 0), cell=0.05, material=Granular(friction_angle=0.6))
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(40)
    weight = 1600.0 * 0.008 * 9.81
    assert np.abs(mean_force(simulation, 10) / weight - [0, -1, 0]).max() < 2e-3
    rigid, x = body_state(simulation)
    assert np.abs(x[0] - [0, 0.5 * thickness, 0]).max() < 3e-3 and np.abs(rigid.velocities()).max() < 1e-4
    assert np.abs(find_method(simulation).read_particles(2)["x"][:, [0, 2]]).max() < 0.3


def test_no_particle_goes_into_the_floor_below_a_ball_that_falls_through():
    """The ball has 7 times the density of the sand, and reaches the floor: where it does, there is room for none."""
    scene = bed(Granular(friction_angle=0.6), depth=0.05)
    scene.body("/ball", wsim.Sphere(0.1), at=(0.02, 0.35, 0), density=11000.0, velocity=(-0.5, -5, 0))
    simulation = wsim.Simulation(scene, device="cpu")
    lowest = []
    for _ in range(10):
        simulation.step()
        assert simulation.indicators()["mpm_penetration"] == 0
        lowest.append(body_state(simulation)[1][0, 1])
    assert min(lowest) < 0.102


def test_a_run_with_a_plate_that_a_floor_holds_restarts_to_the_bit(tmp_path):
    """What holds a body is of the state."""
    from dataclasses import replace

    from wsim.cli.run import prepare_recorded_run
    scene = make_world()
    scene.body("/plate", wsim.Box((0.3, 0.025, 0.3)), at=(0, 0.025, 0), mass=0.128)
    scene.mpm("/heap", wsim.Box((0.1, 0.1, 0.1)), at=(0, 0.15, 0), cell=0.05, material=Granular(friction_angle=0.6))

    def run(output, frames, restart=None):
        job = prepare_recorded_run(replace(scene, frames=frames), str(tmp_path / output),
                                   lambda s: wsim.Simulation(s, device="cpu"), restart=restart and str(tmp_path / restart))
        job.frames()
        return job.simulation
    whole, _ = run("o.usdc", 8), run("half.usdc", 4)
    rest = run("rest.usdc", 8, "half.usdc")
    assert np.abs(whole.state.parts["mpm bodies"].arrays["held"].numpy()).max() > 0.5
    for part in ("mpm", "bodies", "mpm bodies"):
        for field in whole.state.parts[part].kept:
            assert np.array_equal(*(s.state.parts[part].arrays[field.name].numpy() for s in (whole, rest))), field.name
