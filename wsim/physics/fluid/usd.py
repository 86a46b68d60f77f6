"""Prims with WsimFluidDomainAPI <-> `Fluid`, with WsimFluidSourceAPI <-> `Source`.

The box of a domain is the world box of its prim: of a Cube its size, of any other (an Xform, a Volume) its extent. It is
written as a Cube of purpose guide, with its corners as custom data beside it, which count as long as the Cube still says them:
sums of a centre and a half are not exact. Sources have the shapes of colliders, or
are Points.
"""

from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdVol, Vt

from wsim.physics.contact.collider.cloud_usd import SOURCES, author_source_shape, has_source_shape, load_source_shape
from wsim.physics.fluid.objects import Fluid, Source
from wsim.scene.curve import Curve, Motion
from wsim.usd import names
from wsim.usd.attributes import author_attribute as write
from wsim.usd.attributes import (
    define_attribute,
    is_authored,
    read_attribute,
    read_object_fields,
    read_unlisted_number,
    to_usd_array,
)
from wsim.usd.stage import StageReading, StageUnits, applied_schemas
from wsim.usd.transforms import author_motion, read_placement
from wsim.usd.transforms.curves import author_curve, read_curve

CELLS = 64                     # along the longest edge of a domain without a cell size
BOX = "wsim:box"               # custom data of a domain: corners, in stage units
TURNED = 1e-6                  # of the largest number of a transform's linear part that may be where 0 should be
SETTINGS = ("sides", "side_velocities", "slip", "layers", "advection", "scalar_advection", "pressure", "steps", "margin",
            "conserve", "most_steps")
START = ("velocity", "smoke", "temperature", "acceleration")   # of each cell


def load(reading: StageReading, prim: Usd.Prim) -> Fluid | Source | None:
    domain, source = (name in applied_schemas(prim) for name in (names.WSIM_DOMAIN, names.WSIM_SOURCE))
    if domain and source:
        reading.fail(prim.GetPath(), f"has {names.WSIM_DOMAIN} and {names.WSIM_SOURCE}; a source that fills a domain is a prim "
                     "of its own: author the source on another Cube")
        return None
    if domain and names.WSIM_LIQUID in applied_schemas(prim):
        reading.fail(prim.GetPath(), f"has {names.WSIM_DOMAIN} and {names.WSIM_LIQUID}: one prim is one domain; author the "
                     "other on another Cube")
        return None
    return _load_fluid_domain(reading, prim) if domain else _load_smoke_source(reading, prim)


def _load_fluid_domain(reading: StageReading, prim: Usd.Prim) -> Fluid | None:
    path, units = str(prim.GetPath()), reading.units
    if prim.IsInstanceProxy():
        reading.fail(path, "is a fluid in an instance, whose contents cannot be written over; author instanceable = false "
                     "on the instance")
        return None
    if names.COLLISION in applied_schemas(prim):
        reading.fail(path, f"has {names.WSIM_DOMAIN} and {names.COLLISION}: an obstacle that fills its own domain; take "
                     f"{names.COLLISION} off")
        return None
    found_box = read_domain_box(reading, prim, names.WSIM_DOMAIN)
    if found_box is None:
        return None
    found: dict[str, Any] = read_object_fields(prim, "Fluid", units)
    found |= {name: value for name in SETTINGS if (value := read_attribute(prim, "Fluid", name, units)) is not None}
    for name, count in (("sides", 6), ("side_velocities", 6)):
        if name in found and len(found[name]) != count:
            reading.fail(path, f"{names.attribute_entry('Fluid', name).attribute} has {len(found[name])} entries; author "
                               f"{count}, for -x, "
                         "+x, -y, +y, -z, +z")
            return None
    fluid = Fluid(path, *found_box, found.pop("cell", None) or float((found_box[1] - found_box[0]).max()) / CELLS, **found)
    for name in START:
        value = read_attribute(prim, "Fluid", name, units)
        if name == "acceleration" and value is not None and len(value) == 1:
            fluid.acceleration = value[0]
            continue
        if value is not None and len(value) != fluid.cells:
            reading.fail(path, f"{names.attribute_entry('Fluid', name).attribute} has {len(value)} entries, and the domain "
                         f"{'x'.join(map(str, fluid.shape))} cells; author one each, x slowest, or none")
            return None
        if value is not None:
            setattr(fluid, name, value.reshape(*fluid.shape, *value.shape[1:]))
    return fluid


def read_domain_box(reading: StageReading, prim: Usd.Prim, api: str) -> tuple[np.ndarray, np.ndarray] | None:
    """Corners of the world box [m] of a domain with that API; None where there is none (reported)."""
    path, units = str(prim.GetPath()), reading.units
    if prim.IsA(UsdGeom.Cube):
        half = 0.5 * read_unlisted_number(UsdGeom.Cube(prim).GetSizeAttr(), reading.start)
        local = np.array([[-half] * 3, [half] * 3])
    else:
        attribute = prim.GetAttribute("extent")
        value = attribute.Get(reading.start) if attribute else None
        if value is None or np.shape(value) != (2, 3):
            reading.fail(path, f"is a {prim.GetTypeName() or 'prim without a type'} with {api} and no extent; "
                         "make it a Cube, or author float3[] extent, the two corners of its box")
            return None
        local = np.array(value, np.float64)
    place = read_placement(reading, prim)
    if len(place.times) > 1:
        reading.warn(path, "is animated and a domain of a fluid: it stays where the animation starts")
    L, t = place.linear[0], place.frame[0][:3, 3]
    kept = np.abs(L) > TURNED * np.abs(L).max()
    straight = (kept.sum(axis=0) == 1).all() and (kept.sum(axis=1) == 1).all()
    if not straight or prim.IsA(UsdVol.Volume) and (np.diag(L) <= 0.0).any():
        reading.fail(path, "is turned or sheared (or flattened by a scale of 0), and a domain is a box along the world's axes; "
                     "take the rotation out of its transform and of what is above it")
        return None
    ends = units.metres * local @ L.T + t
    low, high = ends.min(axis=0), ends.max(axis=0)
    noted = prim.GetCustomDataByKey(BOX)
    if noted is not None and np.shape(noted) == (6,):
        exact = units.metres * np.array(noted).reshape(2, 3)
        if np.abs(exact - [low, high]).max() <= 1e-9 * max(1.0, float(np.abs(exact).max())):
            return exact[0], exact[1]
    return low, high


def _load_smoke_source(reading: StageReading, prim: Usd.Prim) -> Source | None:
    path, units = str(prim.GetPath()), reading.units
    if not has_source_shape(prim):
        reading.fail(path, f"is a {prim.GetTypeName() or 'prim without a type'} with {names.WSIM_SOURCE}; a source has a "
                     f"shape: {SOURCES}")
        return None
    if names.COLLISION in applied_schemas(prim):
        reading.fail(path, f"has {names.WSIM_SOURCE} and {names.COLLISION}: there is no air within an obstacle; author the "
                     "source on a shape of its own around it")
        return None
    relationship = prim.GetRelationship(names.INTO)
    targets = [str(target) for target in relationship.GetForwardedTargets()] if relationship else []
    if len(targets) > 1:
        reading.fail(path, f"{names.INTO} names {', '.join(targets)}; name one domain, or none for all")
        return None
    found = load_source_shape(reading, prim)
    if found is None:
        return None
    values: dict[str, Any] = read_object_fields(prim, "Source", units)
    values |= {name: value for name in ("hold", "velocity")
               if (value := read_attribute(prim, "Source", name, units)) is not None}
    if is_authored(prim, "Source", "strength"):
        values["strength"] = read_strength_curve(prim, "Source", units)
    return Source(path, *found, fluid="".join(targets), **values)


def read_strength_curve(prim: Usd.Prim, owner: str, units: StageUnits) -> Curve:
    """Keys at the samples; of one that is not sampled a single one."""
    attribute = prim.GetAttribute(names.attribute_entry(owner, "strength").attribute)
    return read_curve(attribute, units, lambda code: read_attribute(prim, owner, "strength", units, code))


def author(stage: Usd.Stage, thing: Fluid | Source, units: StageUnits) -> None:
    if isinstance(thing, Source):
        _author_smoke_source(stage, thing, units)
    else:
        _author_fluid_domain(stage, thing, units)


def author_box(stage: Usd.Stage, thing: Any, units: StageUnits, api: str) -> Usd.Prim:
    """A Cube that is the box of a domain."""
    cube = UsdGeom.Cube.Define(stage, thing.path)
    prim, M = cube.GetPrim(), np.eye(4)
    cube.CreatePurposeAttr(UsdGeom.Tokens.guide)
    cube.CreateExtentAttr([(-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)])
    M[:3, 3] = 0.5 * (thing.low + thing.high)
    author_motion(prim, Motion.still(M), units, 0)
    UsdGeom.Xformable(prim).AddScaleOp(UsdGeom.XformOp.PrecisionDouble).Set(
        tuple((0.5 * (thing.high - thing.low) / units.metres).tolist()))
    prim.SetCustomDataByKey(BOX, Vt.DoubleArray((np.concatenate([thing.low, thing.high]) / units.metres).tolist()))
    prim.AddAppliedSchema(api)
    return prim


def _author_fluid_domain(stage: Usd.Stage, fluid: Fluid, units: StageUnits) -> None:
    prim = author_box(stage, fluid, units, names.WSIM_DOMAIN)
    plain = Fluid(fluid.path, fluid.low, fluid.high, 0.0)
    for name in (*names.schema_fields("Fluid"), *SETTINGS, *START):
        value = getattr(fluid, name)
        if value is None or np.array_equal(value, getattr(plain, name)):
            continue
        if name in START:
            entry = names.attribute_entry("Fluid", name)
            rows = np.reshape(value, (-1, 3)) if name == "acceleration" else value
            define_attribute(prim, entry).Set(to_usd_array(rows, entry.type, units.factor(entry.unit)))
        else:
            write(prim, "Fluid", name, value, units)


def _author_smoke_source(stage: Usd.Stage, source: Source, units: StageUnits) -> None:
    prim = author_source_shape(stage, source, units)
    UsdGeom.Imageable(prim).CreatePurposeAttr(UsdGeom.Tokens.guide)
    prim.AddAppliedSchema(names.WSIM_SOURCE)
    if source.fluid:
        prim.CreateRelationship(names.INTO, False).SetTargets([Sdf.Path(source.fluid)])
    plain = Source(source.path, source.shape)
    for name in (*names.schema_fields("Source"), "hold", "velocity"):
        value = getattr(source, name)
        if value is not None and value is not getattr(plain, name) and not np.array_equal(value, getattr(plain, name)):
            write(prim, "Source", name, value, units)
    if source.strength != plain.strength:
        author_strength(prim, "Source", source.strength, units)


def author_strength(prim: Usd.Prim, owner: str, curve: Curve, units: StageUnits) -> None:
    attribute = define_attribute(prim, names.attribute_entry(owner, "strength"))
    author_curve(attribute, curve, units, lambda value, code: write(prim, owner, "strength", value, units, time=code))
