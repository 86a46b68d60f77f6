"""What tests/physics/rods/test_with_surfaces.py shares with other tests: crossed, thrown."""

import numpy as np

from wsim.physics.contact.selfcontact.crossings import crossed_triangles
from wsim.physics.rods.objects import Rods, segment_ends
from wsim.scene import Pin, Scene, shapes
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation

THICK, MU, G = 8e-3, 0.5, 9.81
CLOTH = Fabric(stretch=500.0, shear=100.0, bend=1e-6, thickness=4e-3, density=300.0, static_friction=MU, dynamic_friction=MU)


def rope(scene: Scene, x: np.ndarray, on: bool = True, **more) -> Rods:
    given = dict(diameters=THICK, young=1e6, static_friction=MU, dynamic_friction=MU, self_collision=on) | more
    return scene.add(Rods("/rope", x, [len(x)], **given))


def sheet(scene: Scene, side: float = 0.4, count: int = 12, held: bool = True, **more) -> np.ndarray:
    """A level cloth about the origin; held: by its four corners."""
    points, counts, indices = shapes.sheet(side, side, count, count, horizontal=True)
    points = np.array(points, np.float64)
    points -= points.mean(axis=0)
    scene.cloth("/cloth", points, counts, indices, material=CLOTH, self_collision=True, **more)
    if held:
        n = count + 1
        scene.pins.append(Pin("/corners", "/cloth", [0, n - 1, n * n - n, n * n - 1]))
    return points


def crossed(sim: Simulation) -> int:
    """Number of (edge of a rod, triangle) that have a point in common, by rational arithmetic, in what a file would hold."""
    rods = sim.plan.method("rods")
    points, triangles, edges, count = [], [], [], 0
    for k, (each, world) in enumerate(rods.table.pairs):
        if world == 0:
            edges.append(count + segment_ends(each)[:, [0, 1, 1]])
            points.append(rods.points(k)[0])
            count += len(each.points)
    for body in (b for b in sim.model.bodies if b.world == 0):
        triangles.append(body.triangles - body.first + count)
        points.append(sim.positions(body.path))
        count += len(points[-1])
    edges = np.concatenate(edges)
    return len(crossed_triangles(np.concatenate(points).astype(np.float32), np.concatenate([edges, *triangles]),
                                 neighbours=False, own=len(edges)))


def thrown(seed: int, speed: float, on: bool = True, **solver) -> Scene:
    """A rope that is thrown at a held cloth from above, across it. seed: turns, tilts, spins."""
    rng = np.random.default_rng(seed)
    scene = Scene(gravity=(0.0, -G, 0.0), **({"fps": 60.0} | solver))
    sheet(scene)
    t, turn = np.linspace(-0.25, 0.25, 21), rng.uniform(0.0, np.pi)
    x = np.stack([t * np.cos(turn), 0.05 + 0.0 * t, t * np.sin(turn)], axis=1) + rng.uniform(-0.05, 0.05, 3) * (1.0, 0.0, 1.0)
    v = np.array([0.2, -1.0, 0.1]) * speed + np.cross(rng.normal(size=3) * 0.5 * speed * (0.2, 1.0, 0.2), x - x.mean(axis=0))
    rope(scene, x, on, velocities=v)
    return scene
