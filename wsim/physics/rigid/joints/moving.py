"""Which prims are bodies that move by forces, and what else belongs to them."""

from pxr import Sdf, Usd, UsdPhysics

from wsim.usd import names
from wsim.usd.stage import Reading, applied


def simulated(reading: Reading, prim: Usd.Prim) -> bool:
    """True if a body moves by forces: it is enabled and not kinematic, and no frame without mass that fixed joints hold."""
    api, start = UsdPhysics.RigidBodyAPI(prim), reading.start
    if api.GetRigidBodyEnabledAttr().Get(start) is False or api.GetKinematicEnabledAttr().Get(start):
        return False
    return prim.GetPath() not in _held(reading)


def _held(reading: Reading) -> set[Sdf.Path]:
    """Bodies without mass and colliders that a fixed joint holds to the world, or to a body that they lie in: converters of
    robots write such anchors and frames. They stand still, or belong to that body."""
    if reading.held is None:
        reading.held = set()
        joined = [_ends(reading, prim) for prim in _fixed(reading)]
        size = -1
        while size < len(reading.held):                         # an anchor may hold another one
            size = len(reading.held)
            for ends in joined:
                for prim, other in (ends, ends[::-1]):
                    if prim and _massless(reading, prim) and _holds(reading, other, prim):
                        reading.held.add(prim.GetPath())
    return reading.held


def _fixed(reading: Reading) -> list[Usd.Prim]:
    prims = Usd.PrimRange(reading.stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
    return [prim for prim in prims if prim.GetTypeName() == names.FIXED_JOINT
            and UsdPhysics.Joint(prim).GetJointEnabledAttr().Get(reading.start) is not False]


def _ends(reading: Reading, joint: Usd.Prim) -> tuple[Usd.Prim | None, Usd.Prim | None]:
    """The prims with PhysicsRigidBodyAPI on both sides of a joint; None: the world."""
    api, found = UsdPhysics.Joint(joint), []
    for rel in (api.GetBody0Rel(), api.GetBody1Rel()):
        targets = rel.GetTargets()
        prim = reading.stage.GetPrimAtPath(targets[0]) if targets else None
        while prim and not prim.IsPseudoRoot() and names.RIGID_BODY not in applied(prim):
            prim = prim.GetParent()
        found.append(prim if prim and not prim.IsPseudoRoot() else None)
    return found[0], found[1]


def _holds(reading: Reading, other: Usd.Prim | None, prim: Usd.Prim) -> bool:
    """Whether what a fixed joint has on its other side carries a prim along: the world, or a body that the prim lies in."""
    return other is None or other.GetPath() in (reading.held or ()) or (
        other != prim and prim.GetPath().HasPrefix(other.GetPath()))


def _massless(reading: Reading, prim: Usd.Prim) -> bool:
    """True of a body without an authored mass and without colliders."""
    mass = UsdPhysics.MassAPI(prim).GetMassAttr() if names.MASS in applied(prim) else None
    if mass and (mass.Get(reading.start) or 0.0) > 0.0:
        return False
    below = iter(Usd.PrimRange(prim, Usd.TraverseInstanceProxies()))
    for each in below:
        if each != prim and names.RIGID_BODY in applied(each):
            below.PruneChildren()
        elif names.COLLISION in applied(each):
            return False
    return True


def holds_a_frame(reading: Reading, joint: Usd.Prim) -> bool:
    """True of a fixed joint that holds a body without mass, which is part of what it is held to."""
    return joint.GetTypeName() == names.FIXED_JOINT and any(
        prim is not None and prim.GetPath() in _held(reading) for prim in _ends(reading, joint))


def body_of(reading: Reading, prim: Usd.Prim) -> Usd.Prim | None:
    """The body that moves by forces that a prim is, or lies in."""
    while prim and not prim.IsPseudoRoot():
        if names.RIGID_BODY in applied(prim) and prim.GetPath() not in _held(reading):
            return prim if simulated(reading, prim) else None
        prim = prim.GetParent()
    return None
