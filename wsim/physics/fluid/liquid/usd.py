"""Prims with WsimLiquidDomainAPI <-> `Liquid`, with WsimLiquidSourceAPI <-> `LiquidSource`; boxes and shapes as of the domains
and sources of smoke (`wsim.physics.fluid.usd`)."""

from typing import Any

from pxr import Sdf, Usd, UsdGeom

from wsim.physics.contact.collider.cloud_usd import SOURCES, author_source_shape, has_source_shape, load_source_shape
from wsim.physics.fluid.liquid.objects import Liquid, LiquidSource
from wsim.physics.fluid.usd import CELLS, author_box, author_strength, read_domain_box, read_strength_curve
from wsim.usd import names
from wsim.usd.attributes import author_attribute as write
from wsim.usd.attributes import is_authored, read_attribute, read_object_fields
from wsim.usd.stage import StageReading, StageUnits, applied_schemas

SETTINGS = ("sides", "transfer", "volume", "steps", "most_steps")


def load(reading: StageReading, prim: Usd.Prim) -> Liquid | LiquidSource | None:
    path = str(prim.GetPath())
    domain, source = (name in applied_schemas(prim) for name in (names.WSIM_LIQUID, names.WSIM_POUR))
    if domain and source:
        reading.fail(path, f"has {names.WSIM_LIQUID} and {names.WSIM_POUR}; a liquid that fills a domain is a prim of its own: "
                     f"author {names.WSIM_POUR} on another Cube")
        return None
    if names.COLLISION in applied_schemas(prim):
        reading.fail(path, f"has {names.WSIM_LIQUID if domain else names.WSIM_POUR} and {names.COLLISION}: there is no liquid "
                     f"within an obstacle; take {names.COLLISION} off")
        return None
    if prim.IsInstanceProxy():
        reading.fail(path, "is a liquid in an instance, whose contents cannot be written over; author instanceable = false on "
                     "the instance")
        return None
    return _load_liquid_domain(reading, prim) if domain else _load_liquid_source(reading, prim)


def _load_liquid_domain(reading: StageReading, prim: Usd.Prim) -> Liquid | None:
    path, units = str(prim.GetPath()), reading.units
    ends = read_domain_box(reading, prim, names.WSIM_LIQUID)
    if ends is None:
        return None
    found: dict[str, Any] = read_object_fields(prim, "Liquid", units)
    found |= {name: value for name in SETTINGS if (value := read_attribute(prim, "Liquid", name, units)) is not None}
    if len(found.get("sides", range(6))) != 6:
        reading.fail(path, f"{names.attribute_entry('Liquid', 'sides').attribute} has {len(found['sides'])} entries; author 6, "
                           "for -x, +x, -y, +y, -z, +z")
        return None
    return Liquid(path, *ends, found.pop("cell", None) or float((ends[1] - ends[0]).max()) / CELLS, **found)


def _load_liquid_source(reading: StageReading, prim: Usd.Prim) -> LiquidSource | None:
    path, units = str(prim.GetPath()), reading.units
    if not has_source_shape(prim):
        reading.fail(path, f"is a {prim.GetTypeName() or 'prim without a type'} with {names.WSIM_POUR}; it has a shape: "
                     f"{SOURCES}")
        return None
    relationship = prim.GetRelationship(names.POURED)
    targets = [str(target) for target in relationship.GetForwardedTargets()] if relationship else []
    if len(targets) > 1:
        reading.fail(path, f"{names.POURED} names {', '.join(targets)}; name one domain, or none for all")
        return None
    found = load_source_shape(reading, prim)
    if found is None:
        return None
    values = {name: value for name in ("role", "velocity")
              if (value := read_attribute(prim, "LiquidSource", name, units)) is not None}
    if is_authored(prim, "LiquidSource", "strength"):
        values["strength"] = read_strength_curve(prim, "LiquidSource", units)
    return LiquidSource(path, *found, liquid="".join(targets), **values)


def author(stage: Usd.Stage, thing: Liquid | LiquidSource, units: StageUnits) -> None:
    if isinstance(thing, LiquidSource):
        _author_liquid_source(stage, thing, units)
        return
    prim = author_box(stage, thing, units, names.WSIM_LIQUID)
    plain = Liquid(thing.path, thing.low, thing.high, 0.0)
    for name in (*names.schema_fields("Liquid"), *SETTINGS):
        value = getattr(thing, name)
        if value != getattr(plain, name):
            write(prim, "Liquid", name, value, units)


def _author_liquid_source(stage: Usd.Stage, source: LiquidSource, units: StageUnits) -> None:
    prim = author_source_shape(stage, source, units)
    UsdGeom.Imageable(prim).CreatePurposeAttr(UsdGeom.Tokens.guide)
    prim.AddAppliedSchema(names.WSIM_POUR)
    if source.liquid:
        prim.CreateRelationship(names.POURED, False).SetTargets([Sdf.Path(source.liquid)])
    plain = LiquidSource(source.path, source.shape)
    if source.role != plain.role:
        write(prim, "LiquidSource", "role", source.role, units)
    if source.velocity is not None:
        write(prim, "LiquidSource", "velocity", source.velocity, units)
    if source.strength != plain.strength:
        author_strength(prim, "LiquidSource", source.strength, units)
