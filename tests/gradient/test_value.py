"""`Gradient.value` of every entry of the table of what has gradients (`wsim.scene.values.coverage`), value by value and solver
by solver, against differences of runs in float64."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.gradient import test_bodies, test_fluids, test_paths
from tests.gradient.rigid import test_contacts, test_joints
from tests.physics.animation.test_gradients import held
from wsim import Bulk, Fabric, Plane, Simulation, Sphere
from wsim.gradient.inputs.by_name import inputs_by_name
from wsim.gradient.recording import Recording
from wsim.physics.rigid.objects import Body
from wsim.scene import Scene, shapes
from wsim.scene.curve import Curve, Motion
from wsim.scene.nodal.loads import surface_triangles_among
from wsim.scene.values.coverage import BY, COVERED

PATHS = {"Cloth": "/cloth", "Springs": "/net", "Soft": "/bar", "Collider": "/floor", "Pin": "/pin", "Scene": "/",
         "Body": "/given", "Joint": "/first", "Fluid": "/air", "Source": "/fire"}
KINDS = {"keys": "catmull_rom", "tangents": "tangents", "handles": "handles", "turns": "squad"}     # of motions
IDLE = ("static_friction",)                  # what slides does not know it


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
    scene = replace(everything(), solver="xpbd", integrator="backward_euler", substeps=10, iterations=3, softs=[])
    scene.cloths[0].material = replace(scene.cloths[0].material, strain_limit=0.01)
    return scene


SCENES = {"explicit": everything, "xpbd": swept}


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


def scene_of(column: str, owner: str, name: str) -> tuple[str, str]:
    """Key of the scene that holds a value, and the path of its owner there."""
    if column == "fluid":
        return "turning" if name == "surface" else "air", PATHS[owner] if owner != "Collider" else "/ball"
    if owner in ("Pin", "Collider") and name in KINDS:
        return f"{owner}-{column}-{name}", "/pin" if owner == "Pin" else "/ball"
    if owner == "Skeleton":
        return f"Skeleton-{column}", "/man/bones"
    if owner == "Load":
        return column, {"force": "/push", "traction": "/drag"}[name]
    if owner == "Body" and name in ("dynamic_friction", "restitution"):
        return name, "/a"
    if (owner, name) == ("Springs", "rest_shape"):
        return f"shaped-{column}", PATHS[owner]
    return {"Body": "free", "Joint": "driven"}.get(owner, column), PATHS[owner]


@cache
def recording_of(key: str) -> Recording:
    """The scene of a key, recorded."""
    kind, _, rest = key.partition("-")
    column, _, name = rest.partition("-")
    if kind in ("Pin", "Collider"):
        how = test_paths.KINDS[KINDS[name]][1]
        make = test_paths.pinned(column, how, False) if kind == "Pin" else test_paths.struck(column, how, name == "turns")
        return recorded(make, 4)
    made = {**MADE, "Skeleton": lambda: held(column), "shaped": lambda: shaped(column),
            "driven": test_joints.SCENES["driven"], "dynamic_friction": test_contacts.SCENES["sliding box"],
            "restitution": test_contacts.SCENES["bouncing ball"]}
    if kind == "free":
        return test_bodies.both()
    frames = {"driven": 4, "dynamic_friction": 8, "restitution": 8}.get(kind, 2)
    return recorded(made[kind](), frames)


def seen(r: Recording) -> dict[str, dict]:
    """All that a loss can be of, by the keyword of `Recording.backward` and the path, after the last frame."""
    F, scene = r.frames, r.sim.scene
    found: dict[str, dict] = {"positions": {}, "velocities": {}, "poses": {}, "twists": {}}
    for body in scene.bodies():
        found["positions"][body.path] = r.positions(F, body.path)
        found["velocities"][body.path] = r.velocities(F, body.path)
    for body in scene.things("Body"):
        found["poses"][body.path], found["twists"][body.path] = r.poses(F, body.path), r.twists(F, body.path)
    return {what: each for what, each in found.items() if each}


def weights(r: Recording) -> dict[str, dict]:
    rng, size = np.random.default_rng(5), {"velocities": 0.01, "twists": 0.1}
    return {what: {path: size.get(what, 1.0) * rng.normal(size=v.shape) for path, v in each.items()}
            for what, each in seen(r).items()}


def loss(r: Recording, by: dict[str, dict]) -> float:
    r.run()
    now = seen(r)
    return float(sum((now[what][path] * w).sum() for what, each in by.items() for path, w in each.items()))


def step_of(value, key: str) -> float:
    """Largest change of a value: a thousandth of what may change, less where that changes which points touch."""
    if key.startswith(("Pin", "Collider", "Skeleton")):
        return 2e-7 if key.startswith("Collider-explicit") else 2e-6
    near = key in ("free", "driven", "dynamic_friction", "restitution") or key == "implicit" and value.what == "positions"
    return 1e-3 * value.scale() * (0.1 if near else 1.0)


def rows() -> list:
    """(column, owner, name) of every entry; by default those whose scenes are cheap, with the others slow."""
    cheap = {("xpbd", "Pin", "handles"), ("xpbd", "Skeleton", "turns"), ("xpbd", "Skeleton", "weights"),
             ("rigid", "Body", "velocity"), ("rigid", "Body", "inertia"), ("rigid", "Joint", "damping")}
    found = []
    for column, owner, name in [(column, *pair) for row in COVERED if row.kind == BY for pair in row.names()
                                for column in row.tests]:
        plain = column in ("explicit", "xpbd") and name not in {*KINDS, "weights", "rest_shape"}
        marks = () if plain or (column, owner, name) in cheap else pytest.mark.slow
        found.append(pytest.param(column, owner, name, id=f"{column}-{owner}.{name}", marks=marks))
    return found


@pytest.mark.parametrize("column, owner, name", rows())
def test_every_value_has_the_slope_of_differences(column, owner, name):
    """Of order 4; losses have a few units of rounding, and by Newton's method what its residuals leave. Fluids have kinks,
    which their own differences look for."""
    key, path = scene_of(column, owner, name)
    if key == "air":
        return test_fluids.compared(*test_fluids.one(test_fluids.stirred), f"{path}:{name}")
    if key == "turning":
        return test_fluids.test_by_the_turning_of_an_obstacle()
    r = recording_of(key)
    r.run()
    by = weights(r)
    found = np.asarray(r.backward(**{what: {r.frames: each} for what, each in by.items()}).value(path, name))
    name_ = f"{path}:{name}".removeprefix("/:")
    value = inputs_by_name(r, [name_])[name_]
    base, losses = value.read(), {}
    way = np.random.default_rng(8).normal(size=base.shape) if base.ndim else np.ones(())
    step = step_of(value, key) / float(np.abs(way).max())
    for k in (-2, -1, 1, 2):
        value.write(base + k * step * way)
        losses[k] = loss(r, by)
    value.write(base)
    expected = (8.0 * (losses[1] - losses[-1]) - (losses[2] - losses[-2])) / (12.0 * step)
    assert abs(expected) > 0.0 or name in IDLE
    rel = 5e-8 if key in ("explicit", "xpbd") else 5e-6 if key == "implicit" else 1e-6
    assert float((found.reshape(base.shape) * way).sum()) == pytest.approx(expected, rel=rel, abs=4e-15 * abs(losses[1]) / step)
