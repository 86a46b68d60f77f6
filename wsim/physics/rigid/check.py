"""What can be wrong with a rigid body; of joints see wsim/physics/rigid/joints/check.py. NumPy only."""

from collections.abc import Iterator
from math import inf

import numpy as np

from wsim.physics.rigid.mass import body_inertia
from wsim.physics.rigid.objects import Body
from wsim.physics.rigid.solids import (
    bodies_met_by_strands,
    bodies_touch_points,
    contact_shape_of,
    has_soft_contacts,
    scene_contact_colliders,
)
from wsim.physics.rigid.solids.faults import check_concave_mesh
from wsim.physics.rigid.solids.softness import check_softness
from wsim.scene import Plane, Problem, Scene, Surface
from wsim.scene.check import objects
from wsim.scene.check.objects import check_rigid_motion, object_warning, thing_error

UNIT = 1e-4                  # departure of |q| from 1 that float32 quaternions keep
SAID = ("convexHull", "boundingCube", "boundingSphere")          # approximations that are what they say, of a body too
SMALL, LARGE = 1e-3, 1e3     # [m] a body beyond these is in the wrong unit more often than not
LEAST = 1e-30                # [kg], [kg m^2]; and the inverse of the greatest
HUGE = 1e15                  # [m/s^2], [rad/s^2], [m/s], [rad/s] at the start: beyond, no step follows the motion
TRIANGLE = 1e-4              # of a moment over the sum of the other two


def check(thing, scene: Scene) -> Iterator[Problem]:
    if isinstance(thing, Body):
        yield from _check_rigid_body(thing, scene)
        return
    if type(thing).__name__ == "Joint":
        from wsim.physics.rigid.joints.check import check as joint
        yield from joint(thing, scene)
    elif type(thing).__name__ == "Actuator":
        from wsim.physics.rigid.joints.actuators.check import check as actuator
        yield from actuator(thing, scene)
    else:
        from wsim.physics.rigid.joints.filters.groups import check_collision_filters as filters
        yield from filters(thing, scene)


def _check_rigid_body(body: Body, scene: Scene) -> Iterator[Problem]:
    """Velocities, forces, drags, mass and density are values, and checked as such."""
    path = body.path
    for name in ("center", "inertia", "axes"):
        value = getattr(body, name)
        if value is not None and not np.isfinite(value).all():
            yield thing_error(path, f"{name} is {_format_vector(value)}", "finite numbers", f"author another {name}")
            return
    yield from check_rigid_motion(path, body.motion, "a rigid body has no scale: put it into the sizes of its colliders")
    if body.motion.moves:
        yield thing_error(path, "its motion has several keys", "one, where it starts",
                          "take the keys away; what keys move is a collider: scene.collider(path, shape, motion=...), in USD "
                          "physics:kinematicEnabled")
    if body is scene.things("Body")[0]:
        yield from _check_body_support(body, scene)
    yield from _check_soft_contact_options(body, scene)
    yield from _check_pins_to_body(body, scene)
    wrong = [p for c in body.colliders for p in _check_body_collider(path, c)]
    yield from wrong
    if not any(p.fatal for p in wrong):
        yield from _check_mesh_approximations(body, scene)
    if not any(p.fatal for p in wrong) and all(v is None or 0.0 < v < inf for v in (body.mass, body.density)):
        yield from _check_body_size(body)
        yield from _check_mass_values(body)


def _check_pins_to_body(body: Body, scene: Scene) -> Iterator[Problem]:
    """Pins whose target is the body or lies in it, save in a collider of its own, which is still, animated or kinematic."""
    def is_in_prim(path: str, outer: str) -> bool:
        return path == outer or path.startswith(f"{outer}/")
    apart = [c.path for c in scene.colliders if is_in_prim(c.path, body.path)]
    for pin in scene.all_pins():
        if is_in_prim(pin.target, body.path) and not any(is_in_prim(pin.target, path) for path in apart):
            yield thing_error(pin.path, f"its target is {pin.target}, which moves with the rigid body {body.path}",
                               "what is still, animated or kinematic: a pin would hang where the body starts",
                               f'scene.tie("{pin.path}", "{pin.body}", [points], "{body.path}"), which pulls at the body too')


def _check_body_support(first: Body, scene: Scene) -> Iterator[Problem]:
    """Bodies under gravity in a scene that has nothing else to land on or to hang from: one warning, at the first of them."""
    bodies = scene.things("Body")
    paths = {body.path for body in bodies}
    hangs = any(j.enabled and not {j.body0, j.body1} <= paths for j in scene.things("Joint"))
    pushed = any(body.force.any() for body in bodies)
    if np.any(scene.gravity) and not (hangs or pushed or scene.colliders or scene.bodies() or scene.things("Rods")
                                         or scene.things("Liquid") or scene.things("MaterialPoints")):
        what = "it falls" if len(bodies) == 1 else f"the {len(bodies)} rigid bodies fall"
        yield object_warning(first.path, f"no joint holds it and nothing lies below: {what} for ever",
                             "a collider or a joint to the world",
                             'scene.collider("/floor", Plane()), or gravity=(0, 0, 0) of the scene; in USD, apply '
                             "PhysicsCollisionAPI to what it should land on, such as a Plane, or author "
                             "physics:gravityMagnitude = 0")


def bodies_touched_by_points(scene: Scene) -> list[Body]:
    """Bodies that points can touch."""
    return [body for body in scene.things("Body") if any(c.meets for c in body.colliders)]


def _check_soft_contact_options(body: Body, scene: Scene) -> Iterator[Problem]:
    if scene.bodies() and scene.contact_width > 0.0 and body is next(iter(bodies_touched_by_points(scene)), None):
        yield object_warning(body.path, f"is a rigid body that cloth, springs or soft bodies touch, and contact_width is "
                             f"{scene.contact_width:g} m: a potential before a contact knows no body that gives way, and all "
                             "contacts of this scene are hard", "0", "leave out wsim:contactWidth, or make the body kinematic")
    if body is scene.things("Body")[0] and scene.contact_tolerance > 0.0 and (
            bodies_touch_points(scene) or bodies_met_by_strands(scene)):
        yield object_warning("/", f"contact_tolerance is {scene.contact_tolerance:g} m/s, and sweeps are counted where "
                             "bodies touch cloth, springs, soft bodies or rods", "0",
                             "leave it out, and give iterations")
    if has_soft_contacts(scene):
        others = scene_contact_colliders(scene.colliders) if body is scene.things("Body")[0] else []
        for collider in (*body.colliders, *others):
            yield from check_softness(collider)


def _check_mesh_approximations(body: Body, scene: Scene) -> Iterator[Problem]:
    """Meshes that are met as something else than their `approximation` says, or not at all."""
    for c in body.colliders:
        if c.meets and isinstance(c.shape, Surface) and contact_shape_of(c, True) is None:
            yield object_warning(c.path, "is a mesh without a volume, which rigid bodies pass through", "a solid",
                                 "give it a thickness")
        elif c.meets and isinstance(c.shape, Surface) and c.approximation not in SAID:
            yield from check_concave_mesh(c, True)
    for c in scene.colliders if body is scene.things("Body")[0] else ():
        if not isinstance(c.shape, Surface) or any(p.fatal for p in objects.check_collider(c)):
            continue
        if contact_shape_of(c, False) is None:
            yield object_warning(c.path, "is a mesh that moves its points, or has no surface, and rigid bodies pass through it",
                                 "a mesh that keeps its shape", "put simple shapes in its place")
        elif c.approximation == "convexDecomposition":
            yield from check_concave_mesh(c, False)


def _format_vector(value: np.ndarray) -> str:
    return "(" + ", ".join(f"{v:g}" for v in value) + ")"


def _check_body_collider(path: str, collider) -> Iterator[Problem]:
    yield from objects.check_collider(collider)
    if collider.path != path and not collider.path.startswith(path + "/"):
        yield thing_error(collider.path, f"is a collider of the rigid body {path} and no prim of it", "paths below the body's",
                           f"name it {path}/{collider.path.rsplit('/', 1)[-1]}")
    if collider.motion.moves or (isinstance(collider.shape, Surface) and collider.shape.poses is not None):
        yield thing_error(collider.path, f"moves within the rigid body {path}", "colliders that are fixed in their body",
                           "take its animation away, or move it out of the body")
    if isinstance(collider.shape, Plane):
        yield thing_error(collider.path, f"is a plane, which has no end, of the rigid body {path}", "shapes with a volume",
                           "take a box, or move the plane out of the body")


def _check_body_size(body: Body) -> Iterator[Problem]:
    """Bounds of the colliders, and how far from them the centre of mass is."""
    balls = [(c.motion.at(0.0)[:3, 3], met.ball) for c in body.colliders if (met := contact_shape_of(c, True)) is not None]
    if not balls:
        return
    low, high = np.min([x - r for x, r in balls], axis=0), np.max([x + r for x, r in balls], axis=0)
    extent = float((high - low).max())
    if not SMALL <= extent <= LARGE:
        yield object_warning(body.path, f"it is {extent:.3g} m {'large' if extent > LARGE else 'small'}",
                             f"{SMALL:g} m to {LARGE:g} m", "author metersPerUnit on the stage: "
                             "1 if its numbers are metres, 0.01 if they are centimetres")
    center = body.center
    away = 0.0 if center is None else float(np.linalg.norm(center - np.clip(center, low, high)))
    if center is not None and away > extent:
        yield object_warning(body.path,
                             f"its centre of mass {_format_vector(center)} is {away:.3g} m from its colliders, which are "
                             f"{extent:.3g} m large", "a place within or near them", "author physics:centerOfMass again")


def _check_mass_values(body: Body) -> Iterator[Problem]:
    path = body.path
    if abs(np.linalg.norm(body.axes) - 1.0) > UNIT:
        yield thing_error(path, f"axes {_format_vector(body.axes)} is a quaternion of length {np.linalg.norm(body.axes):g}",
                           "a unit quaternion (x, y, z, w)", "divide it by its length")
    found = body_inertia(body)
    if not found.mass > 0.0:
        yield thing_error(path, "has no mass: none is given, and its colliders enclose no volume", "a mass > 0",
                           "author physics:mass and physics:diagonalInertia, or give it a collider that is closed", lacks=True)
        return
    moments = found.moments
    said = f"moments of inertia are {_format_vector(moments)} kg m^2"
    if not (np.isfinite(moments).all() and moments.min() > 0.0):
        yield thing_error(path, said, "three numbers > 0",
                           "author physics:diagonalInertia, or give it a collider with a volume")
        return
    if not (min(moments.min(), found.mass) > LEAST and max(moments.max(), found.mass) < 1.0 / LEAST):
        yield thing_error(path, f"{said}, of {found.mass:g} kg",
                           f"{LEAST:g} to {1.0 / LEAST:g}, of which float32 holds the inverse",
                           "author metersPerUnit and kilogramsPerUnit on the stage, or another mass")
        return
    yield from _check_start_rates(body, found.mass, moments.min())
    if 2.0 * moments.max() > moments.sum() * (1.0 + TRIANGLE):
        yield object_warning(path, f"{said}, which no solid has", "none larger than the other two together",
                             "author physics:diagonalInertia again; the motion is that of these numbers")


def _check_start_rates(body: Body, mass: float, moment: float) -> Iterator[Problem]:
    """Velocities and accelerations [m/s], [rad/s], [m/s^2], [rad/s^2] at the start that are finite, and that nothing has."""
    for name, unit, own in (("velocity", "m/s", 1.0), ("spin", "rad/s", 1.0), ("force", "m/s^2", mass),
                            ("torque", "rad/s^2", moment)):
        value = np.asarray(getattr(body, name), np.float64)
        rate = float(np.abs(value).max()) / own
        if rate > HUGE and np.isfinite(value).all():
            of = "" if own == 1.0 else f", and makes {rate:g} {unit}"
            yield thing_error(body.path, f"{name} is {_format_vector(value)}{of}", f"up to {HUGE:g} {unit}",
                              f"author a smaller {name}, or check the units of the stage")
