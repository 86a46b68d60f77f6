"""Materials of solids <-> `Bulk`; one for the whole TetMesh, others for some of its tets.

Others are bound to GeomSubsets of element type "tetrahedron" below the TetMesh, for the purpose "physics" or, where the
subset's material says anything of physics, for all purposes. Their order is that of the subsets; a tet of none has the
TetMesh's own.
"""

from dataclasses import fields

import numpy as np
from pxr import Usd, UsdGeom

from wsim.scene.solid import Bulk
from wsim.usd import names
from wsim.usd.attributes import author_attribute, read_attribute
from wsim.usd.names import attribute_entry
from wsim.usd.prims.fabric import (
    UNAUTHORED,
    authored_binding,
    bind_physics_material,
    bound_physics_material,
    define_material,
    effective_density,
    is_physical,
    load_friction,
    material_or_body,
    own_material_values,
    validate_material,
)
from wsim.usd.stage import StageReading, StageUnits

FAMILY = "materialBind"            # of subsets that bind materials, as UsdShade has it


def load_bulk(reading: StageReading, prim: Usd.Prim, body_density: float | None) -> Bulk:
    """The material of a TetMesh or of a subset of it; body_density [kg/m^3] overrules the material's.

    Every value out of range is reported with the material's path; the default takes its place so that reading goes on.
    """
    material = material_or_body(reading, prim, names.VOLUME_MATERIAL)
    if material != prim and read_attribute(material, "Bulk", "young") is None:
        reading.warn(material.GetPath(),
                     f"{attribute_entry('Bulk', 'young').attribute} is not authored: {names.YOUNGS_MODULUS:g} Pa, the "
                     f"fallback of {names.VOLUME_MATERIAL}, counts")
    values = {"young": read_attribute(material, "Bulk", "young", reading.units),
              "poisson": read_attribute(material, "Bulk", "poisson")}
    for field, fallback in (("young", names.YOUNGS_MODULUS), ("poisson", names.POISSONS_RATIO)):
        values[field] = fallback if values[field] in UNAUTHORED else values[field]
    values["density"] = effective_density(reading, material, body_density)
    values["static_friction"], values["dynamic_friction"] = load_friction(reading, prim, note=True)
    if (model := read_attribute(material, "Bulk", "model")) is not None:
        values["model"] = model
    values |= own_material_values(reading, material, "Bulk", values)
    return validate_material(reading, material, Bulk, values)


def load_tet_materials(reading: StageReading, mesh: Usd.Prim, count: int,
                       body_density: float | None) -> tuple[list[Bulk], np.ndarray | None]:
    """Materials of some of the `count` tets, and which material each tet has (0: that of the mesh), None if all have that."""
    others: list[Bulk] = []
    which, owners = np.zeros(count, np.int32), [mesh]
    for subset in mesh.GetChildren():
        if subset.GetTypeName() != "GeomSubset" or not _subset_binds_material(reading, mesh, subset):
            continue
        kind = UsdGeom.Subset(subset).GetElementTypeAttr().Get()
        if kind != UsdGeom.Tokens.tetrahedron:
            reading.warn(subset.GetPath(), f"binds a physics material to elements of type {kind!r} of {mesh.GetPath()}; only "
                         "'tetrahedron' is read")
            continue
        tets = read_attribute(subset, "Part", "tets", reading.units, reading.start)
        tets = np.zeros(0, np.int32) if tets is None else tets
        outside = (tets < 0) | (tets >= count)
        if outside.any():
            k = int(np.argmax(outside))
            reading.fail(subset.GetPath(), f"indices[{k}] names tet {tets[k]}; allowed is 0 to {count - 1} (tets of "
                         f"{mesh.GetPath()})")
            continue
        twice = which[tets] != 0
        if twice.any():
            k = int(np.argmax(twice))
            reading.fail(subset.GetPath(), f"indices[{k}] names tet {tets[k]}, and so does {owners[which[tets[k]]].GetPath()}; "
                         "allowed is one material a tet: take it out of one of the two")
            continue
        others.append(load_bulk(reading, subset, body_density))
        owners.append(subset)
        which[tets] = len(others)
    return others, which if which.any() else None


def _subset_binds_material(reading: StageReading, mesh: Usd.Prim, subset: Usd.Prim) -> bool:
    """Whether a subset has a physics material that is not merely the mesh's."""
    if authored_binding(subset):
        return True
    material = bound_physics_material(reading, subset)
    return material is not None and material != bound_physics_material(reading, mesh) and is_physical(material)


def author_bulk(stage: Usd.Stage, path: str, bulk: Bulk, units: StageUnits) -> Usd.Prim:
    """The Material at `path`, defined as one that says this solid unless it is there already."""
    found = stage.GetPrimAtPath(path)
    if found:
        return found
    prim = define_material(stage, path)
    for schema in (names.MATERIAL, names.VOLUME_MATERIAL, names.WSIM_MATERIAL):
        prim.AddAppliedSchema(schema)
    for field in (f.name for f in fields(Bulk)):
        author_attribute(prim, "Bulk", field, getattr(bulk, field), units)
    return prim


def author_tet_materials(mesh: UsdGeom.TetMesh, which: np.ndarray | None, parts: list[tuple[str, Usd.Prim]]) -> None:
    """Defines a subset for each of the other materials; parts: (path of the subset, Material)."""
    stage = mesh.GetPrim().GetStage()
    for k, (path, material) in enumerate(parts, 1):
        subset = UsdGeom.Subset.Define(stage, path).GetPrim()
        author_attribute(subset, "Part", "kind", UsdGeom.Tokens.tetrahedron)
        author_attribute(subset, "Part", "family", FAMILY)
        author_attribute(subset, "Part", "tets", np.zeros(0) if which is None else np.flatnonzero(which == k))
        bind_physics_material(subset, material)
    if parts:
        UsdGeom.Subset.SetFamilyType(mesh, FAMILY, UsdGeom.Tokens.nonOverlapping)
