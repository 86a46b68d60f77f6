"""Points prims <-> bodies of particles: places, rates, ids, widths, colours, and materials of GeomSubsets. What says which
material is a function, so that prims of other schemas (newton.py, physx.py) are read in the same way."""

from collections.abc import Callable
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from wsim.usd.attributes import to_usd_array
from wsim.usd.stage import StageReading, StageUnits
from wsim.usd.transforms import read_placement

FAMILY = "materialBind"                    # of subsets that bind materials, as UsdShade has it
LIKE = 1e-3                                # materials whose densities differ by less are one


def read_point_places(reading: StageReading, prim: Usd.Prim) -> dict[str, Any]:
    """Fields of a body: points, velocity, ids, widths, colours, world [SI]."""
    place, points, metres = read_placement(reading, prim), UsdGeom.Points(prim), reading.units.metres
    L, local = place.linear[0], _array(points.GetPointsAttr(), reading.start, 3) * metres
    found: dict[str, Any] = {"points": place.frame[0][:3, 3] + local @ L.T}
    if np.linalg.det(L) == 0.0:
        reading.fail(prim.GetPath(), "its transform flattens it (a scale is zero); give it scales other than zero")
    for name, attribute, kind in (("velocity", points.GetVelocitiesAttr(), 3), ("ids", points.GetIdsAttr(), 1)):
        values = _array(attribute, reading.start, kind)
        if len(values) == len(local) > 0:
            found[name] = values * metres @ L.T if name == "velocity" else values.astype(np.int64)
        elif len(values):
            reading.warn(prim.GetPath(), f"has {len(values)} {attribute.GetName()} and {len(local)} points; they are left out: "
                         f"author {len(local)}")
    scale = float(np.cbrt(abs(np.linalg.det(L))))
    widths = _array(UsdGeom.PrimvarsAPI(prim).GetPrimvar("widths") or points.GetWidthsAttr(), reading.start, 1) * metres * scale
    if len(widths) in (1, len(local)) and len(widths):
        found["widths"] = widths
    elif len(widths):
        reading.fail(prim.GetPath(), f"has {len(widths)} widths and {len(local)} points; author float[] widths, one or "
                     f"{len(local)}")
    colors = read_display_colors(reading, prim, len(local))
    return found | ({} if colors is None else {"colors": colors})


def read_display_colors(reading: StageReading, prim: Usd.Prim, count: int) -> np.ndarray | None:
    """Linear displayColor (3,), or (count, 3); of what has faces the mean. None where there is none."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("displayColor")
    values = np.array((primvar.ComputeFlattened(reading.start) if primvar and primvar.HasValue() else None) or [], np.float64)
    if len(values) == 0:
        return None
    if prim.IsA(UsdGeom.Points) and len(values) not in (1, count):
        reading.warn(prim.GetPath(), f"has {len(values)} displayColor and {count} points: all get their mean; author 1 or "
                     f"{count}")
    return values if len(values) == count != 1 else values.reshape(-1, 3).mean(axis=0)


def _array(attribute: Any, time: Usd.TimeCode, width: int) -> np.ndarray:
    """Values of an attribute or primvar, (n,) or (n, 3) float64; none where it says nothing."""
    value = None if not attribute else attribute.ComputeFlattened(time) if isinstance(attribute, UsdGeom.Primvar) \
        else attribute.Get(time)
    found = np.array([] if value is None else value, np.float64)
    return found.reshape(-1, 3) if width == 3 else found.reshape(-1)


def point_subsets(reading: StageReading, prim: Usd.Prim, count: int) -> list[tuple[Usd.Prim, np.ndarray]]:
    """Subsets of points that bind materials, with their points; what cannot be read is reported."""
    found, taken = [], np.zeros(count, bool)
    for child in prim.GetChildren():
        subset = UsdGeom.Subset(child)
        if not subset or subset.GetFamilyNameAttr().Get(reading.start) != FAMILY:
            continue
        kind, numbers = subset.GetElementTypeAttr().Get(reading.start), _array(subset.GetIndicesAttr(), reading.start, 1)
        own, path = numbers.astype(np.int64), child.GetPath()
        if kind != UsdGeom.Tokens.point:
            reading.fail(path, f"elementType is '{kind}'; of Points it is 'point'; author that")
        elif len(own) and not 0 <= own.min() <= own.max() < count:
            reading.fail(path, f"indices go from {own.min()} to {own.max()}; allowed is 0 to {count - 1}: name points that "
                         "there are")
        elif taken[own].any() or len(np.unique(own)) != len(own):
            twice = own[taken[own]][0] if taken[own].any() else np.sort(own)[:-1][np.diff(np.sort(own)) == 0][0]
            reading.fail(path, f"names point {twice} twice, or another subset has it; a point has one material: name it once")
        else:
            found.append((child, own))
            taken[own] = True
    return found


def read_material_subsets(reading: StageReading, prim: Usd.Prim, count: int,
                          material_of: Callable[[Usd.Prim], Any]) -> dict[str, Any]:
    """Fields `material`, `further`, `which` of a body of so many points. material_of: the material of the prim or a subset,
    None where it is broken or says none (a subset then has that of the prim)."""
    base, which, further = material_of(prim), np.zeros(count, np.int64), []
    for subset, own in point_subsets(reading, prim, count):
        material = material_of(subset)
        if material is not None:
            known = [base, *further]
            if material not in known:
                further.append(material)
                known.append(material)
            which[own] = known.index(material)
    if base is None:
        return {}
    return {"material": base} | ({"further": tuple(further), "which": which} if further else {})


def author_point_places(stage: Usd.Stage, thing: Any, units: StageUnits) -> Usd.Prim:
    """Defines the Points of a body; materials are not written here."""
    points = UsdGeom.Points.Define(stage, thing.path)
    volumes = np.atleast_1d(np.asarray(thing.volumes, np.float64))
    points.CreatePointsAttr(to_usd_array(thing.points, "point3f[]", units.metres))
    widths = (6.0 / np.pi * volumes) ** (1.0 / 3.0) if thing.widths is None else thing.widths
    points.CreateWidthsAttr(to_usd_array(widths, "float[]", units.metres))
    points.SetWidthsInterpolation(UsdGeom.Tokens.constant if len(widths) == 1 else UsdGeom.Tokens.vertex)
    if thing.velocity is not None and thing.velocity.ndim == 2:
        points.CreateVelocitiesAttr(to_usd_array(thing.velocity, "vector3f[]", units.metres))
    if thing.ids is not None:
        points.CreateIdsAttr(Vt.Int64Array.FromNumpy(thing.ids))
    return points.GetPrim()


def author_display_colors(prim: Usd.Prim, colors: np.ndarray) -> None:
    """Writes linear colours: one, or one a point."""
    kind = UsdGeom.Tokens.constant if np.ndim(colors) == 1 else UsdGeom.Tokens.vertex
    UsdGeom.PrimvarsAPI(prim).CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, kind).Set(
        Vt.Vec3fArray.FromNumpy(np.asarray(colors, np.float32).reshape(-1, 3)))


def author_subset(prim: Usd.Prim, name: str, own: np.ndarray) -> Usd.Prim:
    """Defines a subset of points that has a material of its own."""
    subset = UsdGeom.Subset.Define(prim.GetStage(), prim.GetPath().AppendChild(name))
    subset.CreateElementTypeAttr(UsdGeom.Tokens.point)
    subset.CreateFamilyNameAttr(FAMILY)
    subset.CreateIndicesAttr(Vt.IntArray.FromNumpy(own.astype(np.int32)))
    return subset.GetPrim()
