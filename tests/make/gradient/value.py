"""What tests/gradient/test_value.py shares with other tests: flat, recording_of."""

from dataclasses import replace
from functools import cache

import numpy as np

from tests.make.gradient import bodies, paths
from tests.make.gradient.rigid import contacts, joints
from tests.make.physics.animation.gradients import held
from wsim import Bulk, Fabric, Plane, Simulation, Sphere
from wsim.gradient.recording import Recording
from wsim.physics.rigid.objects import Body
from wsim.scene import Scene, shapes
from wsim.scene.curve import Curve, Motion
from wsim.scene.nodal.loads import surface_triangles_among

KINDS = {"keys": "catmull_rom", "tangents": "tangents", "handles": "handles", "turns": "squad"}     # of motions


def everything() -> Scene:
    """A cloth in the wind, a net with muscles and a bar that flows, that slide on a floor which throws them back."""
    scene = Scene(fps=60.0, frames=2, substeps=60, solver="explicit", integrator="leapfrog", air_drag=0.4, wind=(1.0, 0.5, 2.0))
    rng, points = np.random.default_rng(3), shapes.sheet(0.2, 0.2, 3, 3, horizontal=True)
    cloth = scene.cloth("/cloth", points[0] + [0.0, 0.01, 0.0], *points[1:], drag=1.0, lift=0.5, velocities=speeds(rng, 16),
                        material=Fabric(stretch=40.0, weft=25.0, shear=15.0, bend=1e-3, poisson=0.2, damping=1e-3,
                                        density=150.0))
    chain = np.array([[0.1 * k, 0.012 + 0.003 * (k % 2), 1.0] for k in range(5)])
    scene.net("/net", chain, [[k, k + 1] for k in range(4)], [40.0], [0.01], damping=1e-3, lengths=[0.09, 0.1, 0.11, 0.1],
              velocities=speeds(rng, 5), actuation=Curve([0.0, 0.05], np.array([[1.0], [1.1]])))
    block, tets = shapes.block((0.2, 0.1, 0.1), (2, 1, 1))
    scene.soft("/bar", block + [0.0, 0.06, -1.0], tets, pressure=300.0, velocities=speeds(rng, len(block), 3.0),
               material=Bulk(2e4, 0.35, 1e3, damping=1e-3, yield_strain=0.01))
    scene.collider("/floor", Plane(), motion=flat(), restitution=0.4, thickness=0.001, static_friction=0.4,
                   dynamic_friction=0.3)
    scene.collider("/dull", Sphere(0.1), at=(3.0, 0.2, 0.0))
    scene.pin("/pin", "/net", [0])
    scene.add(Body("/thrown", mass=1.0, center=np.zeros(3), inertia=np.ones(3)))
    scene.force("/push", "/net", [3, 4], (0.02, -0.1, 0.03))
    scene.traction("/drag", cloth, surface_triangles_among(cloth, range(8)), (1.0, -2.0, 0.5))
    return scene


def swept() -> Scene:
    """The same by XPBD, without what it has not."""
    scene = replace(everything(), solver="xpbd", integrator="backward_euler", substeps=10, iterations=3)
    scene.softs = []
    scene.cloths[0].material = replace(scene.cloths[0].material, strain_limit=0.01)
    return scene


def speeds(rng, n: int, spin: float = 0.3) -> np.ndarray:
    return np.array([0.6, -0.8, 0.3]) + spin * rng.normal(size=(n, 3))


def flat() -> Motion:
    """Up is +y."""
    matrix = np.eye(4)
    matrix[:3, :3] = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]
    return Motion.still(matrix)


def solved() -> Scene:
    """The same by Newton's method."""
    scene = replace(everything(), solver="implicit", integrator="backward_euler", substeps=8, iterations=40)
    scene.cloths[0].material = replace(scene.cloths[0].material, strain_limit=0.01)
    return scene


MADE = {"explicit": everything, "xpbd": swept, "implicit": solved}


def shaped(column: str) -> Scene:
    """The net has no lengths of its own: they follow from its places at rest."""
    scene = MADE[column]()
    scene.springs[0].lengths = None
    return scene


def recorded(scene: Scene, frames: int = 2) -> Recording:
    return Recording(Simulation(scene, device="cpu", precision="float64", gradients=True), frames)


@cache
def recording_of(key: str) -> Recording:
    """The scene of a key, recorded."""
    kind, _, rest = key.partition("-")
    column, _, name = rest.partition("-")
    if kind in ("Pin", "Collider"):
        how = paths.KINDS[KINDS[name]][1]
        make = paths.pinned(column, how, False) if kind == "Pin" else paths.struck(column, how, name == "turns")
        return recorded(make, 4)
    made = {**MADE, "Skeleton": lambda: held(column), "shaped": lambda: shaped(column),
            "driven": joints.SCENES["driven"], "dynamic_friction": contacts.SCENES["sliding box"],
            "restitution": contacts.SCENES["bouncing ball"]}
    if kind == "free":
        return bodies.both()
    frames = {"driven": 4, "dynamic_friction": 8, "restitution": 8}.get(kind, 2)
    return recorded(made[kind](), frames)
