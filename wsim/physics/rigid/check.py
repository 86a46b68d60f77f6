"""What can be wrong with a rigid body; of joints see wsim/physics/rigid/joints/check.py. NumPy only."""

from collections import Counter
from collections.abc import Iterator
from math import inf

import numpy as np

from wsim.physics.rigid.mass import inertia
from wsim.physics.rigid.objects import Body
from wsim.physics.rigid.solids import CONVEX, as_met, filled
from wsim.scene import Plane, Problem, Scene, Surface
from wsim.scene.check import objects
from wsim.scene.check.objects import error, number, rigid, warning

UNIT = 1e-4                  # departure of |q| from 1 that float32 quaternions keep
SAID = ("convexHull", "boundingCube", "boundingSphere")          # approximations that are what they say, of a body too
TRIANGLE = 1e-4              # of a moment over the sum of the other two


def check(thing, scene: Scene) -> Iterator[Problem]:
    if isinstance(thing, Body):
        yield from _body(thing, scene)
        return
    if type(thing).__name__ == "Joint":
        from wsim.physics.rigid.joints.check import check as joint
        yield from joint(thing, scene)
    else:
        from wsim.physics.rigid.filters.groups import check as filters
        yield from filters(thing, scene)


def _body(body: Body, scene: Scene) -> Iterator[Problem]:
    path = body.path
    for name in ("velocity", "spin", "center", "inertia", "force", "torque", "axes"):
        value = getattr(body, name)
        if value is not None and not np.isfinite(value).all():
            yield error(path, f"{name} is {_words(value)}", "finite numbers", f"author another {name}")
            return
    for name in ("drag", "spin_drag"):
        yield from number(path, name, getattr(body, name), 0.0)
    yield from number(path, "density", body.density, 0.0, True)
    yield from rigid(path, body.motion, "a rigid body has no scale: put it into the sizes of its colliders")
    if body.motion.moves:
        yield error(path, "its motion has several keys", "one, where it starts",
                    "take the keys away, or author physics:kinematicEnabled, where it is animated")
    if body is scene.things("Body")[0]:
        yield from _nested([other.path for other in scene.things("Body")])
    yield from _beside(body, scene)
    wrong = [p for c in body.colliders for p in _collider(path, c)]
    yield from wrong
    if not any(p.fatal for p in wrong):
        yield from _meshes(body, scene)
        yield from _mass(body)


def _nested(paths: list[str]) -> Iterator[Problem]:
    """Bodies within bodies, and a path that two have."""
    counts = Counter(paths)
    for path in paths:
        parts = path.split("/")
        above = ["/".join(parts[:k]) for k in range(2, len(parts))]
        for outer in [path] * (counts[path] > 1) + [p for p in above if p in counts]:
            yield error(path, f"is a rigid body within the rigid body {outer}", "bodies apart in the stage",
                        "move it out of that prim, or take its PhysicsRigidBodyAPI away so that its colliders belong to it")


def _beside(body: Body, scene: Scene) -> Iterator[Problem]:
    if scene.bodies() and body is scene.things("Body")[0]:
        yield warning(body.path, "rigid bodies and cloth, springs or soft bodies pass through each other",
                      "one kind in a scene", "make the bodies kinematic (colliders of the scene), or take one kind out")


def _meshes(body: Body, scene: Scene) -> Iterator[Problem]:
    """Meshes that are met as something else, or not at all."""
    for c in body.colliders:
        if c.meets and isinstance(c.shape, Surface) and as_met(c, True) is None:
            yield warning(c.path, "is a mesh without a volume, which rigid bodies pass through", "a solid",
                          "give it a thickness")
        elif c.meets and isinstance(c.shape, Surface) and c.approximation not in SAID and filled(c.shape) < 1.0 - CONVEX:
            yield warning(c.path, "is a mesh with hollows, or an open one, and meets others as its convex hull",
                          "a convex mesh", "put several convex colliders in its place")
    for c in scene.colliders if body is scene.things("Body")[0] else ():
        if not isinstance(c.shape, Surface) or any(p.fatal for p in objects.collider(c)):
            continue
        if as_met(c, False) is None:
            yield warning(c.path, "is a mesh that moves its points, or has no surface, and rigid bodies pass through it",
                          "a mesh that keeps its shape", "put simple shapes in its place")
        elif c.approximation == "convexDecomposition" and filled(c.shape) < 1.0 - CONVEX:
            yield warning(c.path, "is met as one hull, which fills what is hollow: convexDecomposition makes no parts here",
                          "none: its triangles", "author physics:approximation = none, or several convex colliders")


def _words(value: np.ndarray) -> str:
    return "(" + ", ".join(f"{v:g}" for v in value) + ")"


def _collider(path: str, collider) -> Iterator[Problem]:
    yield from objects.collider(collider)
    if collider.path != path and not collider.path.startswith(path + "/"):
        yield error(collider.path, f"is a collider of the rigid body {path} and no prim of it", "paths below the body's",
                    f"name it {path}/{collider.path.rsplit('/', 1)[-1]}")
    if collider.motion.moves or (isinstance(collider.shape, Surface) and collider.shape.poses is not None):
        yield error(collider.path, f"moves within the rigid body {path}", "colliders that are fixed in their body",
                    "take its animation away, or move it out of the body")
    if isinstance(collider.shape, Plane):
        yield error(collider.path, f"is a plane, which has no end, of the rigid body {path}", "shapes with a volume",
                    "take a box, or move the plane out of the body")


def _mass(body: Body) -> Iterator[Problem]:
    path = body.path
    if body.mass is not None and not 0.0 < body.mass < inf:
        yield error(path, f"mass is {body.mass:g}", "finite and > 0", "author physics:mass, or leave it out for the density; "
                    "to hold a body still, make it kinematic")
        return
    if abs(np.linalg.norm(body.axes) - 1.0) > UNIT:
        yield error(path, f"axes {_words(body.axes)} is a quaternion of length {np.linalg.norm(body.axes):g}",
                    "a unit quaternion (x, y, z, w)", "divide it by its length")
    found = inertia(body)
    if not found.mass > 0.0:
        yield error(path, "has no mass: none is given, and its colliders enclose no volume", "a mass > 0",
                    "author physics:mass and physics:diagonalInertia, or give it a collider that is closed")
        return
    moments = found.moments
    said = f"moments of inertia are {_words(moments)} kg m^2"
    if not (np.isfinite(moments).all() and moments.min() > 0.0):
        yield error(path, said, "three numbers > 0", "author physics:diagonalInertia, or give it a collider with a volume")
    elif 2.0 * moments.max() > moments.sum() * (1.0 + TRIANGLE):
        yield warning(path, f"{said}, which no solid has", "none larger than the other two together",
                      "author physics:diagonalInertia again; the motion is that of these numbers")
