"""Which prims are bodies that move by forces, and what else belongs to them."""

from pxr import Usd, UsdPhysics

from wsim.usd import names
from wsim.usd.stage import Reading, applied


def simulated(reading: Reading, prim: Usd.Prim) -> bool:
    """True if a body moves by forces: it is enabled and not kinematic."""
    api, start = UsdPhysics.RigidBodyAPI(prim), reading.start
    return api.GetRigidBodyEnabledAttr().Get(start) is not False and not api.GetKinematicEnabledAttr().Get(start)


def body_of(reading: Reading, prim: Usd.Prim) -> Usd.Prim | None:
    """The body that moves by forces that a prim is, or lies in."""
    while prim and not prim.IsPseudoRoot():
        if names.RIGID_BODY in applied(prim):
            return prim if simulated(reading, prim) else None
        prim = prim.GetParent()
    return None
