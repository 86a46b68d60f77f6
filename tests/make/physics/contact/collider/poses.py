"""What tests/physics/contact/collider/test_poses.py shares with other tests: crowd, met, mixed, table, tried."""

import numpy as np
import warp as wp

from wsim.geometry.rotation import axis_rotation_matrix
from wsim.kernels.contact.search import MOST, ROOM
from wsim.physics.contact import CollidablePoints, ColliderContacts
from wsim.scene import Box, Capsule, Collider, Plane, Scene, Sphere, Surface, shapes
from wsim.scene.curve import Curve, Motion
from wsim.simulation.simulation import Simulation


def unit(rng):
    n = rng.normal(size=3)
    return n / np.linalg.norm(n)


def motion(rng, count=6, angles=None, size=1.0) -> Motion:
    """Keys at uneven times in -1 .. 2 s, turned by random angles up to pi from one to the next."""
    times = np.sort(rng.uniform(-1.0, 2.0, count))
    M = np.tile(np.eye(4), (count, 1, 1))
    M[:, :3, 3] = rng.uniform(-size, size, (count, 3))
    angles = rng.uniform(0.0, np.pi, count) if angles is None else angles
    for k in range(1, count):
        M[k, :3, :3] = M[k - 1, :3, :3] @ axis_rotation_matrix(unit(rng), angles[k % len(angles)])
    return Motion(times, M)


def tried(colliders, origins=((0.0, 0.0, 0.0),), real=wp.float64, device="cpu", dt=0.5) -> ColliderContacts:
    n = len(origins)
    bodies = CollidablePoints([list(colliders)] * n, np.array(origins, float), np.zeros(1, np.int32), np.ones(1), np.zeros(1),
                              np.zeros((1, 2)), np.zeros((0, 3)), np.zeros(n), np.zeros(n))
    return ColliderContacts(bodies, device=device, real=real, substeps=7, dt=dt)


def table(of: ColliderContacts) -> list[np.ndarray]:
    c = of.table
    return [array.numpy().astype(np.float64) for array in (c.of.pose, c.of.step, c.ball, c.stride)]


def mixed(rng, count=12) -> list[Collider]:
    """Moving and still shapes, a rigid mesh whose centre is not its origin, one that deforms, a plane."""
    points, counts, indices = shapes.sphere(0.1, 8)
    shift = np.array((0.3, 0.1, 0.0), np.float32)
    swell = Curve(np.array([-1.0, 2.0]), np.stack([points, 1.5 * points]))
    kinds = [Sphere(0.1), Box((0.1, 0.2, 0.1)), Capsule(0.1, 0.1), Surface(points + shift, counts, indices)]
    found = [Collider(f"/c{k}", kinds[k % 4], motion(rng), thickness=0.001 * k) for k in range(count)]
    return [*found, Collider("/still", Sphere(0.2), Motion.at_place((0.1, 0.2, 0.3))), Collider("/floor", Plane(), motion(rng)),
            Collider("/swelling", Surface(points, counts, indices, swell), motion(rng), thickness=0.0)]


def crowd(seed: int, count=80) -> Scene:
    """Two sheets of loose points that fall among moving and still colliders; of some, many are in one place."""
    rng = np.random.default_rng(seed)
    scene = Scene(solver="xpbd", gravity=(0.0, 0.0, -9.81), up="Z", fps=60.0, substeps=4, iterations=2)
    x = np.linspace(-0.5, 0.5, 10)
    for k in range(2):
        points = np.stack(np.meshgrid(x + 0.1 * k, x, [0.02 * k]), axis=-1).reshape(-1, 3)
        scene.net(f"/net{k}", points, np.arange(100).reshape(-1, 2), np.full(50, 1e-3), np.full(100, 1e-3),
                  velocities=rng.uniform(-1.0, 1.0, (len(points), 3)))
    mesh = Surface(*shapes.sphere(0.08, 8))
    sizes = np.stack([shapes.sphere(r, 8)[0] for r in (0.06, 0.1)])
    swelling = Surface(*shapes.sphere(0.06, 8), Curve(np.array([0.0, 0.1]), sizes))
    kinds = [Sphere(0.05), Box((0.05, 0.03, 0.04)), Sphere(0.02), mesh]
    scene.collider("/slope", Plane("Z"), (0.0, 0.0, -0.1))
    for k in range(count):
        own = motion(rng, 6, [0.5], 0.6) if k % 3 else Motion.at_place(rng.uniform(-0.6, 0.6, 3))
        own.values[:, 2, 3] *= 0.1
        scene.collider(f"/c{k}", kinds[k % 4], motion=own)
    scene.collider("/swelling", swelling, (0.1, 0.0, -0.05))
    for count, x in ((ROOM + 4, 0.35), (MOST + 8, -0.35)):
        for k in range(count):
            scene.collider(f"/heap{count}_{k}", Box((0.15, 0.15, 0.05)), (x, 0.3, -0.05 - 0.0001 * k))
    scene.collider("/floor", Plane(), motion=motion(rng, 3, [0.02], 0.02))
    return scene


def met(scene: Scene, frames=4, device="cpu", **more):
    """State and contacts after some frames, and the contacts themselves."""
    sim = Simulation(scene, device=device, **more)
    sim.run(frames)
    c = sim.plan.method("contact").contacts
    slots = c.slots
    held = np.arange(slots.capacity)[:, None] < slots.count.numpy()
    found = [sim.state.x.numpy(), sim.state.v.numpy(), slots.count.numpy(),
             *(a.numpy().reshape(slots.capacity, c.count, -1)[held] for a in (slots.row, slots.n, slots.b, slots.u))]
    return found, c
