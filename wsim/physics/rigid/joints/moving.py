"""Which prims are bodies that move by forces, and what else belongs to them."""

from pxr import Sdf, Usd, UsdPhysics

from wsim.usd import names
from wsim.usd.stage import StageReading, applied_schemas


def moves_by_forces(reading: StageReading, prim: Usd.Prim) -> bool:
    """True if a body moves by forces: it is enabled and not kinematic, and no frame without mass that fixed joints hold."""
    api, start = UsdPhysics.RigidBodyAPI(prim), reading.start
    if api.GetRigidBodyEnabledAttr().Get(start) is False or api.GetKinematicEnabledAttr().Get(start):
        return False
    return prim.GetPath() not in _held_massless_frames(reading)


def _held_massless_frames(reading: StageReading) -> dict[Sdf.Path, Usd.Prim | None]:
    """Bodies without mass and colliders that a fixed joint holds to the world (None), or to a body that they lie in: converters
    of robots write such anchors and frames. They stand still, or belong to that body."""
    if reading.held is None:
        reading.held = {}
        joined = [_joint_body_prims(reading, prim) for prim in _enabled_fixed_joints(reading)]
        size = -1
        while size < len(reading.held):                         # an anchor may hold another one
            size = len(reading.held)
            for ends in joined:
                for prim, other in (ends, ends[::-1]):
                    root = _holding_body(reading, other)
                    if prim and prim.GetPath() not in reading.held and _has_no_mass(reading, prim) and (
                            root is None or root != prim and prim.GetPath().HasPrefix(root.GetPath())):
                        reading.held[prim.GetPath()] = root
    return reading.held


def _holding_body(reading: StageReading, prim: Usd.Prim | None) -> Usd.Prim | None:
    """What holds a frame in the end, a body or the world; any other body itself."""
    held = reading.held or {}
    return held[prim.GetPath()] if prim and prim.GetPath() in held else prim


def _enabled_fixed_joints(reading: StageReading) -> list[Usd.Prim]:
    prims = Usd.PrimRange(reading.stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
    return [prim for prim in prims if prim.GetTypeName() == names.FIXED_JOINT
            and UsdPhysics.Joint(prim).GetJointEnabledAttr().Get(reading.start) is not False]


def _joint_body_prims(reading: StageReading, joint: Usd.Prim) -> tuple[Usd.Prim | None, Usd.Prim | None]:
    """The prims with PhysicsRigidBodyAPI on both sides of a joint; None: the world."""
    api, found = UsdPhysics.Joint(joint), []
    for rel in (api.GetBody0Rel(), api.GetBody1Rel()):
        targets = rel.GetTargets()
        prim = reading.stage.GetPrimAtPath(targets[0]) if targets else None
        while prim and not prim.IsPseudoRoot() and names.RIGID_BODY not in applied_schemas(prim):
            prim = prim.GetParent()
        found.append(prim if prim and not prim.IsPseudoRoot() else None)
    return found[0], found[1]


def _has_no_mass(reading: StageReading, prim: Usd.Prim) -> bool:
    """True of a body without an authored mass and without colliders."""
    mass = UsdPhysics.MassAPI(prim).GetMassAttr() if names.MASS in applied_schemas(prim) else None
    if mass and (mass.Get(reading.start) or 0.0) > 0.0:
        return False
    below = iter(Usd.PrimRange(prim, Usd.TraverseInstanceProxies()))
    for each in below:
        if each != prim and names.RIGID_BODY in applied_schemas(each):
            below.PruneChildren()
        elif names.COLLISION in applied_schemas(each):
            return False
    return True


def fixes_massless_frame(reading: StageReading, joint: Usd.Prim) -> bool:
    """True of a fixed joint that holds a body without mass, which is part of what it is held to."""
    return joint.GetTypeName() == names.FIXED_JOINT and any(
        prim is not None and prim.GetPath() in _held_massless_frames(reading) for prim in _joint_body_prims(reading, joint))


def body_of(reading: StageReading, prim: Usd.Prim) -> Usd.Prim | None:
    """The body that moves by forces that a prim is, or lies in."""
    while prim and not prim.IsPseudoRoot():
        if prim.GetPath() in _held_massless_frames(reading):
            holder = _held_massless_frames(reading)[prim.GetPath()]
            return holder if holder and moves_by_forces(reading, holder) else None
        if names.RIGID_BODY in applied_schemas(prim):
            return prim if moves_by_forces(reading, prim) else None
        prim = prim.GetParent()
    return None
