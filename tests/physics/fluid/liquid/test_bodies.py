"""Rigid bodies in a liquid: the pressure pushes them, and they push it."""

import numpy as np
import pytest

from tests.physics.fluid.liquid.tanks import GRAVITY, particles, tank
from wsim.physics.fluid.liquid.measure import particle_mass
from wsim.physics.rigid.objects import Body
from wsim.scene import Collider, Motion
from wsim.scene.solids import Box, Plane, Sphere
from wsim.simulation.simulation import Simulation

CELL = 1.0 / 32.0


def body(shape, at, **more) -> Body:
    return Body("/body", [Collider("/body/shape", shape)], Motion.at_place(at), **more)


def flat(fill, half, at, n=(32, 32), frames=24, **more):
    """A flat tank with a box as deep as it is."""
    settings = {name: more.pop(name) for name in ("gravity", "velocity") if name in more}
    scene = tank(n, fill, cell=CELL, frames=frames, fps=48.0, **settings)
    scene.add(body(Box((*half, 0.5 * CELL)), (*at, 0.5 * CELL), **more))
    return scene


def run(scene, frames: int):
    """(simulation, method of the bodies) after so many frames."""
    sim = Simulation(scene, device="cpu")
    for _ in range(frames):
        sim.step()
    return sim, sim.plan.method("rigid")


def speed(rigid) -> np.ndarray:
    return rigid.velocities()[0]


@pytest.mark.parametrize(("shape", "size"), [(Sphere(6.3 * CELL), 6.3), (Box((7.8 * CELL,) * 3), 7.8)])
def test_the_buoyancy_of_what_is_as_dense_as_the_liquid_is_its_weight(shape, size):
    """Between the planes of the grid. The liquid goes along with what it lacks, so that the body shows about 1 / 1.6 of it."""
    scene = tank((32, 32, 32), ((0, 0, 0), (1, 0.9, 1)), cell=CELL, fps=96.0, steps=1)
    scene.add(body(shape, (0.51, 0.47, 0.495), density=1000.0))
    _, rigid = run(scene, 1)
    assert abs(speed(rigid)[1]) * 96.0 / 9.81 < 0.02 / 1.6
    assert abs(speed(rigid)[[0, 2]]).max() * 96.0 / 9.81 < 2e-3


def test_a_box_of_half_density_floats_half_out():
    """Twice as wide as high, so that it does not turn over."""
    scene = flat(((0, 0), (1, 0.5)), (0.2, 0.1), (0.5, 0.48), density=500.0, frames=60)
    sim, rigid = run(scene, 20)
    height = []
    for _ in range(40):
        sim.step()
        height.append(rigid.poses()[0][1, 3])
    level = sim.report()["error"]["liquid_volume"] / CELL + 0.5 * 0.4 * 0.2
    assert abs(np.mean(height) - level) < 0.5 * CELL
    assert max(height) - min(height) < 2.0 * CELL
    assert abs(rigid.poses()[0][0, 1]) < np.sin(np.radians(3.0))


@pytest.mark.parametrize("density", [10.0, 100.0])
def test_a_light_body_rises_as_its_added_mass_lets_it(density):
    """A cylinder in a fluid without bounds has the added mass of what it displaces: a = g (1 - s) / (1 + s), s its density over
    the liquid's. The walls are eight radii away, and slow it. A force that comes a step late would grow as (1 / s)^steps."""
    scene = tank((64, 64), ((0, 0), (2, 1.9)), cell=CELL, fps=96.0, steps=1)
    scene.add(body(Sphere(4 * CELL), (1.0, 0.9, 0.5 * CELL), mass=density * np.pi * (4 * CELL) ** 2 * CELL))
    _, rigid = run(scene, 4)
    s = density / 1000.0
    a = speed(rigid)[1] * 96.0 / 4.0
    assert a == pytest.approx(9.81 * (1.0 - s) / (1.0 + s), rel=0.08)
    sim, rigid = run(scene, 40)
    assert 0.0 < speed(rigid)[1] < 3.0 and np.isfinite(particles(sim)["x"]).all()


def test_momentum_goes_from_a_stream_to_a_body():
    """A drop hits a ball at rest, without gravity and walls: what one loses the other has."""
    scene = tank((32, 24, 24), ((0.1, 0.2, 0.2), (0.45, 0.55, 0.55)), cell=CELL, fps=48.0, gravity=(0, 0, 0),
                 velocity=(1.0, 0, 0))
    scene.add(body(Sphere(0.1), (0.57, 0.38, 0.37), density=1000.0))
    before = run(scene, 0)[0]
    start = particles(before)["v"].sum(0) * particle_mass(scene.things("Liquid")[0])
    sim, rigid = run(scene, 10)
    liquid, own = particles(sim)["v"].sum(0) * particle_mass(scene.things("Liquid")[0]), rigid.get("p")[0]
    assert own[0] > 0.02 * start[0]
    assert np.abs(liquid + own - start).max() < 0.01 * start[0]
    assert np.abs(liquid + own - start)[0] < 0.2 * own[0]


def test_a_heavy_body_sinks_and_rests_on_the_floor():
    scene = flat(((0, 0), (1, 0.5)), (0.12, 0.1), (0.5, 0.2), density=3000.0, frames=30)
    scene.colliders.append(Collider("/floor", Plane("Y")))
    _, rigid = run(scene, 30)
    assert rigid.poses()[0][1, 3] == pytest.approx(0.1, abs=2e-3)
    assert np.linalg.norm(speed(rigid)) < 1e-3


def test_a_frame_that_is_repeated_is_the_same_to_the_bit():
    scene = flat(((0, 0), (1, 0.5)), (0.1, 0.1), (0.5, 0.55), density=300.0)
    sim, rigid = run(scene, 3)
    sim.plan.state.take_snapshot()
    sim.plan.before_frame(3 / 48.0)
    found = []
    for _ in range(2):
        sim.plan.state.restore_snapshot()
        sim.plan.frame()
        found.append((particles(sim)["x"], rigid.get("p")))
    assert all(np.array_equal(a, b) for a, b in zip(*found, strict=True))


def test_particles_stay_out_of_a_body_that_falls_among_them():
    scene = flat(((0, 0), (1, 0.5)), (0.15, 0.1), (0.5, 0.7), density=2000.0)
    sim, rigid = run(scene, 20)
    x = (np.linalg.inv(rigid.poses()[0]) @ np.c_[particles(sim)["x"], np.ones(len(particles(sim)["x"]))].T).T
    depth = np.minimum(0.15 - abs(x[:, 0]), 0.1 - abs(x[:, 1]))
    assert GRAVITY[1] < 0.0 and depth.max() < 0.5 * CELL
