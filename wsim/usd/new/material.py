"""The physics material of what `wsim new` makes: one that is named (--material), a new one where its numbers are given, else
the one that the mesh is bound to already, else a new one of the defaults."""

from collections.abc import Callable

from pxr import Usd, UsdGeom, UsdShade

from wsim.scene import Problem, SceneError
from wsim.usd.new.mesh import Bare, Wanted
from wsim.usd.new.place import under
from wsim.usd.prims.fabric import bind, is_physical


def physical_of(stage: Usd.Stage, bare: Bare) -> Usd.Prim | None:
    """The physics material that the mesh is bound to, or None."""
    material = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath(bare.path)).ComputeBoundMaterial("physics")[0]
    return material.GetPrim() if material and is_physical(material.GetPrim()) else None


def bind_material(stage: Usd.Stage, bare: Bare, body: Usd.Prim, wanted: Wanted, given: bool,
                  make: Callable[[], Usd.Prim]) -> bool:
    """Binds the material of a body. given: its numbers are asked for, and `make()` authors it. Returns whether it was made.

    Raises SceneError where wanted.bound is no material that says anything of physics."""
    found = _named(stage, wanted.bound) if wanted.bound else None if given else physical_of(stage, bare)
    if found is None:
        bind(body, make())
        return True
    root = stage.GetDefaultPrim().GetPath()
    if not found.GetPath().HasPrefix(root):                    # a stage that refers to this one gets it too
        UsdGeom.Scope.Define(stage, root.AppendChild("materials"))
        copy = stage.DefinePrim(under(stage, f"materials/{found.GetName()}"))
        copy.GetReferences().AddInternalReference(found.GetPath())
        found = copy
    bind(body, found)
    return False


def _named(stage: Usd.Stage, name: str) -> Usd.Prim:
    """The material of that path or name."""
    materials = [p for p in stage.Traverse() if p.IsA(UsdShade.Material)]
    found = [p for p in materials if name in (str(p.GetPath()), p.GetName())]
    if len(found) == 1 and is_physical(found[0]):
        return found[0]
    fit = ", ".join(str(p.GetPath()) for p in materials if is_physical(p)) or "none"
    what = ("says nothing of physics (no physics: attribute)" if len(found) == 1 else
            f"names {len(found)} materials" if found else "is no material of the mesh's file")
    raise SceneError(Problem(name, f"{what}; physics materials there: {fit} (--material)"))
