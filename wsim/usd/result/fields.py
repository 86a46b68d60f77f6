"""Fields that a fit has found, in its layer, and back.

    young, poisson of each tet        primvars:wsim:young (double[], uniform) on the TetMesh, read by `load_fields`
    stretch, bend .. of each element  primvars:wsim:bend (double[], constant) on the Mesh: kept, and not read
    velocities, rest_shape            the attributes of the points
    lengths of each spring            the attribute of the curves
    actuation of a net                samples of wsim:actuation
    motion of a pin                   samples on the Xform that it hangs on; of a collider, on its own prim
    stiffness of each spring          wsim:stiffness, by `wsim.usd.result.fitted`
"""

from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from wsim.scene import Collider, Pin, Soft
from wsim.scene.solid import Bulk
from wsim.scene.values.per_tet import material_fields_with, material_per_tet
from wsim.usd import names
from wsim.usd.attributes import author_attribute
from wsim.usd.prims.painted import ELEMENTS
from wsim.usd.prims.pins import FRAME
from wsim.usd.prims.springs import author_muscles
from wsim.usd.stage import StageReading, StageUnits
from wsim.usd.transforms import author_motion


def author_fields(stage: Usd.Stage, fields: list[tuple[str, str, np.ndarray]], bodies: dict[str, Any]) -> None:
    """Adds fields (prim path, name, values (n,) or (n, 3)) to the layer that `save_fitted` writes. bodies: bodies and pins of
    the fitted scene by path."""
    units = StageUnits.of(stage)
    for where, name, values in fields:
        prim, thing = stage.GetPrimAtPath(where), bodies[where]
        if name in names.PER_TET or name in names.PER_ELEMENT:
            kind = UsdGeom.Tokens.uniform if name in names.PER_TET else UsdGeom.Tokens.constant
            primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(f"wsim:{name}", Sdf.ValueTypeNames.DoubleArray, kind)
            if name in names.PER_ELEMENT:
                primvar.GetAttr().SetCustomDataByKey(ELEMENTS, True)
            primvar.Set(Vt.DoubleArray.FromNumpy(values / units.factor((names.PER_TET | names.PER_ELEMENT)[name])))
        elif name == "velocities":
            author_attribute(prim, type(thing).__name__, name, _field_at_vertices(prim, thing.velocities), units)
        elif name == "rest_shape":
            author_attribute(prim, type(thing).__name__, "rest_points", thing.rest_points, units)
        elif name == "lengths":
            author_attribute(prim, "Springs", "lengths", thing.lengths, units)
        elif name == "actuation":
            author_muscles(prim, thing, units)
        elif isinstance(thing, Collider):
            _author_collider_motion(prim, thing, units)
        elif name == "motion":
            _author_pin_motion(stage, prim, thing, units)


def _field_at_vertices(prim: Usd.Prim, values: np.ndarray) -> np.ndarray:
    """Of the vertices of curves, where a net has several for a particle."""
    from wsim.usd.result.samples import particle_of_each_vertex
    own = particle_of_each_vertex(prim)
    return values if own is None else values[own]


def _author_pin_motion(stage: Usd.Stage, prim: Usd.Prim, pin: Pin, units: StageUnits) -> None:
    """What a pin hangs on moves; where that is nothing, an Xform below the pin."""
    target = pin.target or f"{pin.path}/{FRAME}"
    author_motion(stage.GetPrimAtPath(target) or UsdGeom.Xform.Define(stage, target).GetPrim(), pin.motion, units, 0)
    if not pin.target:
        prim.CreateRelationship(names.SRC1, False).SetTargets([Sdf.Path(target)])


def _author_collider_motion(prim: Usd.Prim, collider: Collider, units: StageUnits) -> None:
    """A collider's motion, with what of its transform is no motion of the shape (scale, axis): at the start both are known."""
    W = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(Usd.TimeCode(units.start)), np.float64).T
    W[:3, 3] *= units.metres
    from wsim.scene.curve import then
    own = np.linalg.solve(collider.motion.at(0.0), W)
    author_motion(prim, then(collider.motion, own), units, 0)


def load_fields(reading: StageReading, mesh: Usd.Prim, soft: Soft) -> Soft:
    """The soft body with what primvars say of each tet. What is of another size, or out of range, is reported and left out."""
    for name, unit in names.PER_TET.items():
        primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar(f"wsim:{name}")
        if not (primvar and primvar.HasAuthoredValue()):
            continue
        values = np.array(primvar.Get(reading.start))
        if values.dtype.kind not in "fiu":
            reading.warn(mesh.GetPath(), f"{primvar.GetName()} is of type {primvar.GetTypeName()}; allowed is double[]: it is "
                         "left out")
            continue
        values = values * reading.units.factor(unit)
        if primvar.GetInterpolation() in ("vertex", "varying") and values.shape == (len(soft.points),):     # painted
            values = values[np.clip(soft.tets, 0, len(soft.points) - 1)].mean(axis=1)
        if values.shape != (len(soft.tets),):
            reading.warn(mesh.GetPath(), f"{primvar.GetName()} has {values.size} values; allowed is {len(soft.tets)}, one for "
                         f"each tet, or {len(soft.points)} of points with interpolation vertex: it is left out")
            continue
        try:
            for value in (values.min(), values.max()):
                Bulk(**material_fields_with(name, value))
        except ValueError as error:
            reading.warn(mesh.GetPath(), f"{primvar.GetName()}: {error}; it is left out")
            continue
        soft = material_per_tet(soft, name, values)
    return soft
