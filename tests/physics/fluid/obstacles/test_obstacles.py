"""Obstacles in a fluid: flow past them with a known answer, walls that hold, bodies that push, regions without a way out."""

import numpy as np
import pytest

from tests.physics.fluid.flows import box, method, places, put
from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.grid.pressure import label_sealed_regions
from wsim.physics.fluid.objects import Fluid, Source
from wsim.scene import Motion, Scene, Surface
from wsim.scene.solids import Box, Cylinder, Sphere
from wsim.simulation.simulation import Simulation


def shift(dx: float, seconds: float) -> Motion:
    """From the origin dx [m] along x in so many seconds."""
    M = np.tile(np.eye(4), (2, 1, 1))
    M[1, 0, 3] = dx
    return Motion(np.array([0.0, seconds]), M)


@pytest.mark.parametrize(("n", "least"), [(32, 2e-3), (64, 1e-3)])
def test_air_slips_past_a_cylinder_as_a_potential_flow(n, least):
    """u = grad (x + R^2 x / r^2) about a cylinder of radius R, given on the sides of a box; over free faces."""
    R, cell = 0.2, 1.0 / n

    def exact(axis, x, y, z):
        x, y = x - 0.5, y - 0.5
        r2 = np.maximum(x * x + y * y, 1e-9)
        return 1.0 - R * R * (x * x - y * y) / r2 ** 2 if axis == 0 else -2.0 * R * R * x * y / r2 ** 2

    scene = box((n, n), size=1.0, sides=("closed",) * 6)
    scene.collider("/cylinder", Cylinder(R, 1.0), at=(0.5, 0.5, 0.0))
    sim = Simulation(scene, device="cpu")
    m = method(sim)
    layout, domain = m.layouts[0], m.domains[0]
    sim.load()
    m.before_frame(0.0, sim.plan.clock)

    def sides(axis, x, y, z):
        rows, outer = places(layout, axis, cell), (0.0, 1.0)
        on = np.isin(rows[axis], outer)
        return np.where(on, exact(axis, *rows), 1.0 - axis)

    put(sim, sides)
    domain.pressure.tolerance = 1e-6
    domain.pressure.solve(domain.u)
    domain.pressure.project(domain.u, domain.u)
    now, openings = m.arrays(0), domain.obstacles.host_openings()
    for a, name in enumerate("uv"):
        free = openings[a].reshape(layout.faces(a)) == 1.0
        wrong = (now[name] - exact(a, *places(layout, a, cell)))[free]
        assert np.sqrt(np.mean(wrong ** 2)) < least
    assert domain.words["solves"].numpy()[1] <= 7


@pytest.mark.parametrize("angle", [0.0, 0.5, np.pi / 4])
def test_a_wall_thinner_than_a_cell_does_not_leak(angle):
    """Wind of 1 m/s on one side of a thin wall across the whole box: the other side stays at rest."""
    M = np.eye(4)
    M[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    M[:2, 3] = 0.5
    scene = box((32, 32), size=1.0, sides=("open",) * 4 + ("closed",) * 2, seconds=0.1, steps=2,
                tolerance=1e-6)
    scene.collider("/wall", Box((0.002, 2.0, 1.0)), motion=Motion.still(M))
    scene.add(Source("/jet", Sphere(0.1), fluid="/fluid", velocity=(1.0, 0.0, 0.0), smoke=1.0,
                     motion=Motion.at_place((0.2, 0.5, 0.015))))
    sim = Simulation(scene, device="cpu")
    sim.step()
    m = method(sim)
    now = m.arrays(0)
    x, y, _ = places(m.layouts[0], 0, 1.0 / 32)
    beyond = (x - 0.5) * np.cos(angle) + (y - 0.5) * np.sin(angle) > 0.06
    assert np.abs(now["u"]).max() > 0.5
    assert np.abs(now["u"][beyond]).max() < 1e-5


def test_a_moving_wall_pushes_the_air_before_it():
    """A piston across a channel, 1 m/s: what is before it moves at its speed, and leaves by the open side."""
    n, size = 32, 1.0
    scene = box((n, 8), size=size, sides=("open", "open", *("closed",) * 4), seconds=0.1, steps=4)
    start = Motion.at_place((0.3, 0.125, 0.0)).values[0]
    motion = shift(0.1, 0.1)
    motion.values[:, :3, 3] += start[:3, 3]
    scene.collider("/piston", Box((0.05, 1.0, 1.0)), motion=Motion(motion.times, motion.values))
    sim = Simulation(scene, device="cpu")
    sim.step()
    u = method(sim).arrays(0)["u"][:, :, 0]
    assert np.abs(u[20:] - 1.0).max() < 1e-3


def test_a_turning_wall_has_the_speed_of_its_turn():
    """A cross in a closed round box of air: at each of its faces the velocity across is that of the turn."""
    n, size, omega = 32, 1.0, 2.0
    turns = np.tile(np.eye(4), (2, 1, 1))
    turns[:, :2, 3] = 0.5
    c, s = np.cos(omega * 0.1), np.sin(omega * 0.1)
    turns[1, :2, :2] = [[c, -s], [s, c]]
    scene = box((n, n), size=size, sides=("closed",) * 6, seconds=0.1, steps=1)
    scene.collider("/bar", Box((0.3, 0.1, 1.0)), motion=Motion(np.array([0.0, 0.1]), turns))
    sim = Simulation(scene, device="cpu")
    sim.step()
    m = method(sim)
    openings, now = m.domains[0].obstacles.host_openings(), m.arrays(0)
    inside = openings[1].reshape(m.layouts[0].faces(1)) == 0.0
    x, _, _ = places(m.layouts[0], 1, size / n)
    assert inside.sum() > 20
    assert np.abs(now["v"] - omega * (x - 0.5))[inside].max() < 1e-4


def test_regions_without_an_outlet_are_told_apart():
    layout = Layout.of(Fluid("/f", (0, 0, 0), (8, 4, 1), 1.0, sides=("open", *("closed",) * 5)))
    x, y = np.ones(layout.faces(0)), np.ones(layout.faces(1))
    x[3] = x[5] = 0.0
    region, count = label_sealed_regions(layout, [x.ravel(), y.ravel()])
    region = region.reshape(8, 4)
    assert count == 2
    assert (region[:3] == -1).all() and (region[3:5] == region[3, 0]).all() and (region[5:] == region[5, 0]).all()
    assert {int(region[3, 0]), int(region[5, 0])} == {0, 1}


def test_a_source_of_air_in_a_sealed_room_leaves_the_rest_alone():
    """What cannot come out is spread over its room: the pressure is solved, and nothing grows."""
    scene = box((32, 16), size=1.0, sides=("open", *("closed",) * 5), seconds=0.5, steps=4)
    scene.collider("/wall", Box((0.05, 1.0, 1.0)), at=(0.5, 0.25, 0.0))
    scene.add(Source("/air", Sphere(0.1), expansion=2.0, smoke=1.0, motion=Motion.at_place((0.75, 0.25, 0.015))))
    sim = Simulation(scene, device="cpu")
    sim.step()
    u = method(sim).arrays(0)["u"]
    assert not [w for w in sim.warnings if "missed" in w]
    assert np.abs(u[:14]).max() < 1e-5 and 1e-3 < np.abs(u[18:]).max() < 0.5


def test_a_mesh_is_an_obstacle_as_its_shape_is():
    """A box as a shape and as a mesh: the same openings to rounding."""
    half = np.array([0.21, 0.17, 0.13])
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    faces = [0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3]
    found = []
    for shape in (Box(tuple(half)), Surface(corners, [4] * 6, faces)):
        scene = Scene(gravity=(0.0, 0.0, 0.0), wind=(1.0, 0.0, 0.0))
        scene.add(Fluid("/f", (0, 0, 0), (1, 1, 1), 1.0 / 16))
        scene.collider("/thing", shape, at=(0.5, 0.5, 0.5))
        sim = Simulation(scene, device="cpu")
        sim.load()
        method(sim).before_frame(0.0, sim.plan.clock)
        found.append(np.concatenate(method(sim).domains[0].obstacles.host_openings()))
    assert (found[0] < 1.0).sum() > 100
    assert np.abs(found[0] - found[1]).max() < 1e-4
