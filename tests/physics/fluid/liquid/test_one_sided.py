"""Walls at the rim of a domain have one side, and part nothing; walls inside have two. Particles slide along shapes."""

import numpy as np
import pytest

from tests.physics.fluid.liquid.tanks import method, tank
from wsim.physics.fluid.grid.shapes import one_sided
from wsim.scene import Box, Collider, Motion
from wsim.scene.solids import Sphere
from wsim.simulation.simulation import Simulation

LOW, HIGH, CELL = np.zeros(3), np.array([1.0, 0.5, 1.0]), 0.05
TURNED = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])


def wall(at: tuple, half: tuple = (0.05, 1.0, 1.0), turn: np.ndarray | None = None, moves: bool = False) -> Collider:
    M = np.eye(4)
    M[:3, 3] = at
    M[:3, :3] = np.eye(3) if turn is None else turn
    motion = Motion(np.array([0.0, 1.0]), np.stack([M, M + np.eye(4, k=3)])) if moves else Motion.still(M)
    return Collider("/wall", Box(half), motion=motion)


@pytest.mark.parametrize("thing, rim", [
    (wall((-0.05, 0.25, 0.5)), True), (wall((0.06, 0.25, 0.5)), False), (wall((0.05, 0.25, 0.5)), True),
    (wall((1.02, 0.25, 0.5)), True), (wall((0.5, 0.25, 0.5)), False), (wall((-0.05, 0.25, 0.5), moves=True), False),
    (wall((0.5, 0.25, 0.5), turn=TURNED), False), (wall((-1.0, 0.25, 0.5), turn=TURNED), True),
    (wall((0.5, -0.05, 0.5), (0.05, 0.05, 1.0)), False)])
def test_a_wall_at_the_rim_has_one_side(thing, rim):
    """The last is a bar below the domain's middle: it is thin along x, too, and both its ends lie within the domain."""
    assert one_sided(thing, LOW, HIGH, CELL) == rim


def test_a_particle_slides_along_a_ball_whatever_is_rounded():
    """Where ways end is continuous: ends that are 1e-13 m apart stay so. (What rounding stops is up to 0.02 m short.)"""
    scene = tank((16, 16, 16), [(0, 0, 0), (0.5, 0.5, 0.5)], frames=1)
    M = np.eye(4)
    M[:3, 3] = 0.25
    scene.collider("/ball", Sphere(0.08), motion=Motion.still(M))
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.step()
    domain, rng, ends = method(sim).domains[0], np.random.default_rng(3), []
    out = rng.normal(size=domain.particles.x.shape + (3,))
    start = 0.25 + out / np.linalg.norm(out, axis=1)[:, None] * (0.082 + 0.01 * rng.random((len(out), 1)))
    to = start + 0.01 * rng.normal(size=out.shape)
    for apart in (0.0, 1e-13):
        domain.order.aside.x.assign(start)
        domain.particles.x.assign(to + apart * rng.normal(size=out.shape))
        domain.walls.keep(domain.particles, domain.order, domain.clock)
        ends.append(domain.particles.x.numpy().copy())
    assert (np.abs(ends[0] - to).max(axis=1) > 1e-6).sum() > 5000
    assert np.abs(ends[0] - ends[1]).max() < 1e-11
    assert np.linalg.norm(ends[0] - 0.25, axis=1).min() > 0.08
