"""What is said of particles by materials that are bound to them, and by attributes of other vendors."""

from pxr import Usd, UsdShade

from wsim.usd.stage import StageReading


def bound_physics_material(prim: Usd.Prim, own: bool = False) -> Usd.Prim | None:
    """The material of a prim for the purpose "physics", not that for looks alone. own: bound to the prim itself."""
    if own:
        relationship = prim.GetRelationship("material:binding:physics")
        targets = relationship.GetForwardedTargets() if relationship else []
        found = prim.GetStage().GetPrimAtPath(targets[0]) if targets else None
        return found if found and found.IsValid() else None
    material, relationship = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")
    return material.GetPrim() if material and relationship and "physics" in relationship.GetName() else None


def warn_unread(reading: StageReading, prim: Usd.Prim, names: list[str], why: str) -> None:
    """One warning of what a prim says and nobody reads."""
    if names:
        reading.warn(prim.GetPath(), f"{', '.join(names)} {'is' if len(names) == 1 else 'are'} not read: {why}")


def authored_names(prim: Usd.Prim, prefix: str) -> list[str]:
    """Attributes and relationships of a prim that say something, by the beginning of their names."""
    return sorted(str(name) for name in prim.GetAuthoredPropertyNames() if str(name).startswith(prefix))
