"""Scenes of trees that cloth, soft bodies and nets push: two links in free flight, a hinged rod, a bar of welded parts."""

import numpy as np

from wsim import Box, Bulk, Fabric, Scene, Simulation, shapes

SPIN = np.array([0.0, 1.0, 2.0])


def links(scene: Scene, spin=SPIN) -> list:
    """Two rods of 32 cm on a hinge, along x, that turn about the origin."""
    found = [scene.body(f"/l{k}", Box((0.15, 0.03, 0.03)), at=(x, 0.0, 0.0), mass=m, velocity=np.cross(spin, (x, 0.0, 0.0)),
                        spin=spin) for k, (x, m) in enumerate(((-0.16, 0.5), (0.16, 0.3)))]
    scene.joint("revolute", "/hinge", *found, axis=(0, 0, 1))
    return found


def cube_on_link(coordinates: str, tied: bool, gravity=(0.0, 0.0, 0.0), **more) -> Scene:
    """A soft cube of 10 cm on the second rod, in flight."""
    scene = Scene(fps=60, gravity=gravity, coordinates=coordinates, **more)
    last = links(scene)[1]
    x, tets = shapes.block((0.1, 0.1, 0.1), (2, 2, 2))
    x = x - x.mean(axis=0) + np.array([0.2, 0.08, 0.0])
    soft = scene.soft("/cube", x, tets, material=Bulk(young=1e5, poisson=0.3, density=500.0), velocities=np.cross(SPIN, x))
    if tied:
        scene.tie("/tie", soft, np.flatnonzero(x[:, 1] < 0.0301).tolist(), last)
    return scene


def sheet_on_links(coordinates: str, **more) -> Scene:
    """A sheet that hits two rods in flight."""
    scene = Scene(fps=60, gravity=(0.0, 0.0, 0.0), coordinates=coordinates, **more)
    links(scene, (0.0, 0.5, 0.3))
    x, counts, indices = shapes.sheet(0.8, 0.4, 16, 8, horizontal=True)
    scene.cloth("/sheet", x + (0.1, 0.06, 0.0), counts, indices, velocities=np.tile((0.0, -2.0, 0.0), (len(x), 1)))
    return scene


def momenta(simulation: Simulation, path: str) -> tuple[np.ndarray, np.ndarray]:
    """Linear and angular momentum about the origin of points and bodies."""
    rigid, m = simulation.plan.method("rigid"), simulation.plan.model.body(path).point_masses
    x, v = simulation.positions(path), simulation.velocities(path)
    p, c = rigid.read("p"), rigid.origin + rigid.get("x") + rigid.get("e")
    return m @ v + p.sum(0), (m[:, None] * np.cross(x, v)).sum(0) + (rigid.read("L") + np.cross(c, p)).sum(0)


def struck_rod(reach: float, restitution: float = 0.0, **more) -> Scene:
    """A hinged rod of 40 cm along x, and two points above it that fall onto it at 1 m/s, `reach` from the hinge."""
    scene = Scene(fps=60, gravity=(0.0, 0.0, 0.0), coordinates="reduced", **{"solver": "xpbd", "substeps": 20} | more)
    rod = scene.body("/rod", Box((0.2, 0.02, 0.05)), at=(0.2, 0.0, 0.0), mass=0.3, restitution=restitution)
    scene.joint("revolute", "/hinge", None, rod, axis=(0, 0, 1))
    x = np.array([(reach, 0.03, -0.03), (reach, 0.03, 0.03)])
    scene.net("/points", x, [[0, 1]], [100.0], [0.05, 0.05], velocities=np.tile((0.0, -1.0, 0.0), (2, 1)))
    return scene


def loaded_bar(parts: int, welded: bool) -> Scene:
    """A heavy sheet on a bar that turns about its middle, of welded parts or of one body."""
    scene = Scene(fps=60, solver="xpbd", substeps=10, iterations=8, coordinates="reduced")
    half = 0.3 / parts
    places = [(2 * half * (k + 0.5) - 0.3, 0.0, 0.0) for k in range(parts)]
    if welded:
        bodies = [scene.body(f"/part{k}", Box((half, 0.03, 0.03)), at=at, mass=0.6 / parts) for k, at in enumerate(places)]
        for k in range(1, parts):
            scene.joint("fixed", f"/weld{k}", bodies[k - 1], bodies[k], at=(2 * half * k - 0.3, 0, 0))
        scene.joint("revolute", "/axle", None, bodies[0], at=(0, 0, 0), axis=(0, 0, 1))
    else:
        bar = scene.body("/part0", Box((0.3, 0.03, 0.03)), mass=0.6)
        scene.joint("revolute", "/axle", None, bar, axis=(0, 0, 1))
    x, counts, indices = shapes.sheet(0.7, 0.06, 28, 2, horizontal=True)
    scene.cloth("/sheet", x + (0.1, 0.035, 0.0), counts, indices, material=Fabric(density=2000.0, thickness=0.01, stretch=1e4))
    return scene
