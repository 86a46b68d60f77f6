"""Prims with PhysicsRigidBodyAPI <-> `Body`; the colliders on and below them are theirs.

A kinematic or disabled body is none here: its colliders move as animated and push.
"""

from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics

from wsim.physics.rigid.joints.joint import Joint
from wsim.physics.rigid.joints.moving import moves_by_forces
from wsim.physics.rigid.objects import Body
from wsim.physics.rigid.usd.mass import mass_properties
from wsim.scene import Collider
from wsim.scene.check import objects
from wsim.scene.curve import Motion
from wsim.usd import names
from wsim.usd.attributes import author_attribute as write
from wsim.usd.attributes import read_attribute
from wsim.usd.prims.colliders import author_collider, load_collider, surface_values
from wsim.usd.stage import StageReading, StageUnits, applied_schemas
from wsim.usd.transforms import author_motion, read_placement, split_rotation_scale

OWN = ("force", "torque", "drag", "spin_drag")           # of WsimRigidBodyAPI
LEAF = "collider"


def within(reading: StageReading, prim: Usd.Prim) -> list[Sdf.Path]:
    """Prims that are colliders of the body, and no colliders of the scene."""
    if names.RIGID_BODY not in applied_schemas(prim) or not moves_by_forces(reading, prim):
        return []
    found, prims = [], iter(Usd.PrimRange(prim, Usd.TraverseInstanceProxies()))
    for each in prims:
        if each != prim and names.RIGID_BODY in applied_schemas(each):
            prims.PruneChildren()
        elif names.COLLISION in applied_schemas(each):
            found.append(each.GetPath())
    return found


def author_at(prim: Usd.Prim, joint: Joint, name: str, value, units: StageUnits, code: float) -> list[Usd.Attribute]:
    """Writes a live value of a joint that varies in time, at a time code; the attributes that have it."""
    from wsim.physics.rigid.joints import usd
    return usd.author_at(prim, joint, name, value, units, code)


def load(reading: StageReading, prim: Usd.Prim) -> list:
    apis, found = applied_schemas(prim), list[Any]()
    if names.RIGID_BODY in apis:
        found.append(_read_rigid_body(reading, prim))
    elif prim.GetTypeName() == names.COLLISION_GROUP:
        from wsim.physics.rigid.joints.filters.usd import load_group
        found.append(load_group(reading, prim))
    elif prim.IsA(UsdGeom.PointInstancer):
        from wsim.physics.rigid.joints.instances.usd import load as instances
        return instances(reading, prim, _read_rigid_body)
    elif prim.IsA(UsdPhysics.Joint):
        from wsim.physics.rigid.joints.usd import load as joint
        found.append(joint(reading, prim))
    elif prim.GetTypeName() in names.ACTUATORS:
        from wsim.physics.rigid.joints.actuators.usd import load as actuator
        found.append(actuator(reading, prim))
    if names.FILTERED_PAIRS in apis:
        from wsim.physics.rigid.joints.filters.usd import load_pairs
        found.append(load_pairs(reading, prim))
    return [thing for thing in found if thing is not None]


def _read_rigid_body(reading: StageReading, prim: Usd.Prim) -> Body | None:
    path = str(prim.GetPath())
    if names.BODY in applied_schemas(prim):
        reading.fail(path, f"has {names.RIGID_BODY} and {names.BODY}: a prim is either rigid or deformable; remove one of them")
        return None
    if not moves_by_forces(reading, prim):
        return None
    if prim.IsInstanceProxy():
        reading.fail(path, "is a rigid body in an instance, whose contents cannot be written over; author instanceable = false "
                     "on the instance")
        return None
    place = read_placement(reading, prim)
    if len(place.times) > 1:
        reading.warn(path, "is animated and a dynamic rigid body: it starts where the animation does and then moves by forces")
    try:
        R, S = split_rotation_scale(place.linear[0])
    except ValueError as error:
        reading.fail(path, str(error))
        return None
    M = place.frame[0].copy()
    M[:3, :3] = R
    colliders = [c for each in within(reading, prim)
                 if (c := _load_body_collider(reading, reading.stage.GetPrimAtPath(each), M)) is not None]
    velocity, spin = _read_body_velocity(reading, prim)
    own = {name: value for name in OWN if (value := read_attribute(prim, "RigidBody", name, reading.units)) is not None}
    asleep = bool(UsdPhysics.RigidBodyAPI(prim).GetStartsAsleepAttr().Get(reading.start))
    stretch = None if np.array_equal(S, np.eye(3)) else S
    return Body(path, colliders, Motion.still(M), velocity, spin, asleep=asleep, stretch=stretch,
                **mass_properties(reading, prim, colliders), **own)


def _load_body_collider(reading: StageReading, prim: Usd.Prim, M: np.ndarray) -> Collider | None:
    enabled = prim.GetAttribute("physics:collisionEnabled")
    found = load_collider(reading, prim)
    wrong = [problem for problem in (objects.check_collider(found) if found else []) if problem.fatal]
    reading.problems += wrong
    if found is None or wrong:                                          # a broken shape has no mass
        return None
    found.motion = Motion(found.motion.times[:1], np.linalg.inv(M) @ found.motion.values[:1])
    found.meets = not enabled or enabled.Get(reading.start) is not False
    return found


def _read_body_velocity(reading: StageReading, prim: Usd.Prim) -> tuple[np.ndarray, np.ndarray]:
    """World [m/s], [rad/s]; authored in the space that the prim's own transform leads to."""
    api, R = UsdPhysics.RigidBodyAPI(prim), _rotation_of_parent_space(prim, reading.start)
    v, w = (np.array(a.Get(reading.start) or (0.0, 0.0, 0.0), np.float64)
            for a in (api.GetVelocityAttr(), api.GetAngularVelocityAttr()))
    return R @ v * reading.units.metres, R @ np.radians(w)


def _rotation_of_parent_space(prim: Usd.Prim, time) -> np.ndarray:
    """Rotation (3, 3) of the space above a prim."""
    if UsdGeom.Xformable(prim).GetResetXformStack():
        return np.eye(3)
    return split_rotation_scale(np.array(UsdGeom.XformCache(time).GetParentToWorldTransform(prim)).T[:3, :3])[0]


def author(stage: Usd.Stage, thing: Any, units: StageUnits) -> None:
    if isinstance(thing, Body):
        _author_body(stage, thing, units)
        return
    if isinstance(thing, Joint):
        from wsim.physics.rigid.joints.usd import author as joint
        joint(stage, thing, units)
        return
    if type(thing).__name__ == "Actuator":
        from wsim.physics.rigid.joints.actuators.usd import author as actuator
        actuator(stage, thing, units)
        return
    from wsim.physics.rigid.joints.filters.usd import author as filters
    filters(stage, thing, units)


def _keep_world_placement(prim: Usd.Prim) -> None:
    """What is below the prim of a body and placed in the world stays where it is: bodies within bodies move by themselves."""
    below = iter(Usd.PrimRange(prim))
    for each in below:
        if each != prim and UsdGeom.Xformable(each) and UsdGeom.Xformable(each).GetOrderedXformOps():
            UsdGeom.Xformable(each).SetResetXformStack(True)
            below.PruneChildren()


def _author_body(stage: Usd.Stage, body: Body, units: StageUnits) -> None:
    prim = UsdGeom.Xform.Define(stage, body.path).GetPrim()
    _keep_world_placement(prim)
    surfaces: dict[tuple, str] = {}
    for collider in body.colliders:                     # their transforms are within the body's
        material = surfaces.setdefault(surface_values(collider), f"{body.path}/Materials/surface{len(surfaces)}")
        path = collider.path if collider.path != body.path else f"{body.path}/{LEAF}"
        author_collider(stage, Collider(**{**vars(collider), "path": path}), material, units, 0)
        UsdGeom.Xformable(stage.GetPrimAtPath(path)).SetResetXformStack(False)
        if not collider.meets:
            UsdPhysics.CollisionAPI(stage.GetPrimAtPath(path)).CreateCollisionEnabledAttr(False)
    author_motion(prim, body.motion, units, 0)
    api, mass, R = (UsdPhysics.RigidBodyAPI.Apply(prim), UsdPhysics.MassAPI.Apply(prim),
                    _rotation_of_parent_space(prim, Usd.TimeCode.Default()).T)
    api.CreateVelocityAttr(Gf.Vec3f(*(R @ body.velocity / units.metres).tolist()))
    api.CreateAngularVelocityAttr(Gf.Vec3f(*np.degrees(R @ body.spin).tolist()))
    if body.asleep:
        api.CreateStartsAsleepAttr(True)
    mass.CreateDensityAttr(body.density / units.factor("kg/m^3"))
    if body.mass is not None:
        mass.CreateMassAttr(body.mass / units.kilograms)
    if body.center is not None:
        mass.CreateCenterOfMassAttr(Gf.Vec3f(*(body.center / units.metres).tolist()))
    if body.inertia is not None:
        mass.CreateDiagonalInertiaAttr(Gf.Vec3f(*(body.inertia / (units.kilograms * units.metres**2)).tolist()))
        mass.CreatePrincipalAxesAttr(Gf.Quatf(float(body.axes[3]), Gf.Vec3f(*body.axes[:3].tolist())))
    for name in OWN:
        value = getattr(body, name)
        if np.any(value):
            prim.AddAppliedSchema(names.WSIM_RIGID)
            write(prim, "RigidBody", name, value, units)
