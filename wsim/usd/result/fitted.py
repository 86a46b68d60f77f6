"""A layer over a scene's file with what a fit has found: materials, springs, loads, gravity and air; nothing else is touched.

A material that only the fitted bodies bind is written over where it is; of one that others bind too, a copy is made under
/fitted, and bound.
"""

import os
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
from pxr import Sdf, Usd

from wsim.scene import Problem, Scene, SceneError
from wsim.scene.fabric import Fabric
from wsim.scene.methods import each_method_object
from wsim.scene.solid import Bulk
from wsim.scene.values import table
from wsim.scene.values.table import FRICTION
from wsim.usd import names
from wsim.usd.attributes import author_attribute, is_authored
from wsim.usd.prims.colliders import surface_values
from wsim.usd.prims.fabric import (
    author_fabric,
    author_friction,
    bind_physics_material,
    bound_physics_material,
    plane_stress_conversion,
)
from wsim.usd.prims.loads import author_load_curve
from wsim.usd.prims.solid import author_bulk
from wsim.usd.result.as_json import as_json
from wsim.usd.result.sublayer import refuse_source, set_source_sublayer, write_variant_selections
from wsim.usd.settings import author_gravity
from wsim.usd.stage import StageReading, StageUnits, open_stage
from wsim.usd.write import new_stage

SCOPE, SAID = "/fitted", "wsim:fit"


def fitted_prim_fields(owner: str) -> list[str]:
    """Fields of a class that a fit finds and its prim says itself, not a material."""
    return [row.name for row in table.values_of_class(owner).values() if row.fit and row.usd
            and row.usd.schema not in table.MATERIALS]


def check_target(scene: Scene, path: str) -> None:
    """Raises SceneError where the layer cannot be written, before a fit has cost time."""
    if scene.source is None:
        raise SceneError(Problem(str(path), "the scene was made in Python and has no file to lie over; save it first"))
    try:
        refuse_source(scene.source, str(path))
    except ValueError as error:
        raise SceneError(Problem(str(path), str(error).removeprefix(f"{path} "))) from None


def save_fitted(before: Scene, after: Scene, path, said: dict | None = None,
                more: Callable[[Usd.Stage], None] | None = None) -> None:
    """Writes what differs between two states of a loaded scene as a layer over its file, under a temporary name, renamed.

    said    kept as custom data of the layer, as JSON
    more    writes more into it, before it is renamed. Raises SceneError where the file cannot be written.
    """
    check_target(before, path)
    with new_stage(path) as stage:
        source = os.path.abspath(str(before.source))
        set_source_sublayer(source, stage.GetRootLayer(), os.path.dirname(os.path.abspath(os.fspath(path))))
        original = open_stage(source)
        if original.HasAuthoredTimeCodeRange():
            stage.SetStartTimeCode(original.GetStartTimeCode())
            stage.SetEndTimeCode(original.GetEndTimeCode())
        write_variant_selections(stage, before.variants)
        units = StageUnits.of(stage)
        _author_fitted_scene(stage, before, after, units)
        _author_fitted_bodies(stage, before, after, units)
        for (_, old), (_, new) in zip(each_method_object(before), each_method_object(after), strict=True):
            _author_changed_fields(stage.GetPrimAtPath(new.path), old, new, [], units)
        for old, new in zip(before.loads, after.loads, strict=True):
            if old != new:
                author_load_curve(_refuse_instance_proxy(stage.GetPrimAtPath(new.path)), new, units)
        if more:
            more(stage)
        if said:
            stage.GetRootLayer().customLayerData = {SAID: as_json(said)}


def _author_fitted_scene(stage: Usd.Stage, before: Scene, after: Scene, units: StageUnits) -> None:
    own = fitted_prim_fields("Scene")
    changed = [name for name in ("gravity", *own) if getattr(before, name) != getattr(after, name)]
    if not changed:
        return
    prim = next((p for p in stage.Traverse() if p.GetTypeName() == names.PHYSICS_SCENE), None)
    prim = prim or stage.DefinePrim("/physicsScene", names.PHYSICS_SCENE)
    if "gravity" in changed:
        author_gravity(prim, after, units)
    if set(changed) & set(own):
        prim.AddAppliedSchema(names.WSIM_SCENE)
    for name in set(changed) & set(own):
        author_attribute(prim, "Scene", name, getattr(after, name), units)


def _author_fitted_bodies(stage: Usd.Stage, before: Scene, after: Scene, units: StageUnits) -> None:
    reading = StageReading(stage, units)
    changed: list[tuple[Usd.Prim, Any, Any]] = []
    users: dict[str, list] = {}                                  # bodies of each material
    for old, new in zip(before.bodies(), after.bodies(), strict=True):
        prim = stage.GetPrimAtPath(old.path)
        if new.materials:
            material = bound_physics_material(reading, prim)
            users.setdefault(str(material.GetPath()) if material else "", []).append(new.materials[0])
        _author_changed_fields(prim, old, new, ["masses"] * (not new.materials), units)
        if new.materials and old.materials[0] != new.materials[0]:
            changed.append((prim, old.materials[0], new.materials[0]))
    for own, given in zip(before.colliders, after.colliders, strict=True):
        prim = stage.GetPrimAtPath(own.path)
        material = bound_physics_material(reading, prim)
        users.setdefault(str(material.GetPath()) if material else "", []).append(surface_values(given))
        if surface_values(own) != surface_values(given):
            changed.append((prim, surface_values(own), surface_values(given)))
    for prim, was, is_ in changed:
        material = bound_physics_material(reading, prim)
        if material and len(set(users[str(material.GetPath())])) == 1 and not material.IsInstanceProxy():
            _author_material_changes(material, was, is_, units)
        else:
            path = _free_material_path(stage, prim.GetName())
            makers: dict[type, Callable] = {Fabric: author_fabric, Bulk: author_bulk, tuple: author_friction}
            bind_physics_material(_refuse_instance_proxy(prim), makers[type(is_)](stage, path, is_, units))
        if isinstance(is_, (Fabric, Bulk)) and was.density != is_.density:
            for owner in (prim, prim.GetParent()):
                if is_authored(owner, "Body", "density"):
                    author_attribute(_refuse_instance_proxy(owner), "Body", "density", is_.density, units)


def _author_changed_fields(prim: Usd.Prim, old, new, more: list[str], units: StageUnits) -> None:
    """What of an object its prim says itself and has changed; more: beside values."""
    owner = type(new).__name__
    for name in (*fitted_prim_fields(owner), *more):
        if not np.array_equal(getattr(old, name), getattr(new, name)):
            author_attribute(_refuse_instance_proxy(prim), owner, name, getattr(new, name), units)


def _author_material_changes(material: Usd.Prim, was, is_, units: StageUnits) -> None:
    """Opinions on a material for the fields that differ; of a collider's: friction and restitution."""
    if isinstance(is_, tuple):
        for field, value in zip((*FRICTION, "restitution"), is_, strict=False):
            author_attribute(material, "Friction", field, value, units)
        return
    owner = type(is_).__name__
    changed = {f.name for f in fields(is_) if getattr(was, f.name) != getattr(is_, f.name)}
    if owner == "Fabric" and "poisson" in changed:           # what a file says of these, or leaves out, may follow it
        changed |= {"stretch", "shear", "bend"}
    for name in (f.name for f in fields(is_) if f.name in changed):
        through = plane_stress_conversion(is_.poisson) if (owner, name) == ("Fabric", "stretch") else None
        author_attribute(material, owner, name, getattr(is_, name), units, through)


def _refuse_instance_proxy(prim: Usd.Prim) -> Usd.Prim:
    if prim.IsInstanceProxy():
        raise SceneError(Problem(str(prim.GetPath()), "is inside an instance, over which no layer can write; make its instance "
                                 "uninstanceable, or fit a scene without it"))
    return prim


def _free_material_path(stage: Usd.Stage, name: str) -> str:
    path, k = f"{SCOPE}/{name}", 0
    while stage.GetPrimAtPath(Sdf.Path(path)):
        k += 1
        path = f"{SCOPE}/{name}_{k}"
    return path
