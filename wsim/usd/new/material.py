"""The physics material of what `wsim new` makes: one that is named (--material), a new one where its numbers are given, else
the one that the mesh is bound to already, else a new one of the defaults."""

from collections.abc import Callable

from pxr import Usd, UsdGeom, UsdShade

from wsim.scene import Problem, SceneError
from wsim.usd.new.mesh import BareMesh, NewSceneOptions
from wsim.usd.new.place import free_path_below_root
from wsim.usd.prims.fabric import bind_physics_material, is_physical


def bound_material_of_mesh(stage: Usd.Stage, bare: BareMesh) -> Usd.Prim | None:
    """The physics material that the mesh is bound to, or None."""
    material = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath(bare.path)).ComputeBoundMaterial("physics")[0]
    return material.GetPrim() if material and is_physical(material.GetPrim()) else None


def bind_material(stage: Usd.Stage, bare: BareMesh, body: Usd.Prim, wanted: NewSceneOptions, given: bool,
                  make: Callable[[], Usd.Prim]) -> bool:
    """Binds the material of a body. given: its numbers are asked for, and `make()` authors it. Returns whether it was made.

    Raises SceneError where wanted.bound is no material that says anything of physics."""
    found = _find_material(stage, wanted.bound) if wanted.bound else None if given else bound_material_of_mesh(stage, bare)
    if found is None:
        bind_physics_material(body, make())
        return True
    root = stage.GetDefaultPrim().GetPath()
    if not found.GetPath().HasPrefix(root):                    # a stage that refers to this one gets it too
        UsdGeom.Scope.Define(stage, root.AppendChild("materials"))
        copy = stage.DefinePrim(free_path_below_root(stage, f"materials/{found.GetName()}"))
        copy.GetReferences().AddInternalReference(found.GetPath())
        found = copy
    bind_physics_material(body, found)
    return False


def _find_material(stage: Usd.Stage, name: str) -> Usd.Prim:
    """The material of that path or name."""
    materials = [p for p in stage.Traverse() if p.IsA(UsdShade.Material)]
    found = [p for p in materials if name in (str(p.GetPath()), p.GetName())]
    if len(found) == 1 and is_physical(found[0]):
        return found[0]
    fit = ", ".join(str(p.GetPath()) for p in materials if is_physical(p)) or "none"
    what = ("says nothing of physics (no physics: attribute)" if len(found) == 1 else
            f"names {len(found)} materials" if found else "is no material of the mesh's file")
    raise SceneError(Problem(name, f"{what}; physics materials there: {fit} (--material)"))
