"""Materials: what is bound for the purpose "physics" (or for all purposes) <-> `Fabric` and friction. (Solids: solid.py)

The deformable proposal says a sheet by surfaceStretchStiffness K = E h / (1 - nu^2), surfaceShearStiffness G h and
surfaceBendStiffness E h^3 / (12 (1 - nu^2)); a stiffness that is not authored (-inf) follows from youngsModulus E,
poissonsRatio nu and the thickness h, for which the proposal's fallbacks stand in. `Fabric.stretch` is E h = K (1 -
nu^2).
"""

import math
from dataclasses import fields
from typing import Any

from pxr import Sdf, Usd, UsdGeom, UsdShade

from wsim.scene.fabric import Fabric
from wsim.scene.values.table import FRICTION
from wsim.usd import names
from wsim.usd.attributes import author_attribute, is_authored, read_attribute
from wsim.usd.names import attribute_entry
from wsim.usd.stage import StageReading, StageUnits, applied_schemas

DEFORMABLE = (names.SURFACE_MATERIAL, names.CURVES_MATERIAL, names.VOLUME_MATERIAL)
UNAUTHORED = (None, -math.inf)     # what stands for "derive it"
SOFT = "solref", "solimp"          # of MuJoCo's contacts, as mjc: attributes of a collider
UNBOUND_FRICTION = 0.5             # where no physics material is bound, as in `wsim.scene`


def bound_physics_material(reading: StageReading, prim: Usd.Prim) -> Usd.Prim | None:
    """The material that acts on a prim's physics: purpose "physics", else the one for all purposes; None: none."""
    material = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")[0]
    return material.GetPrim() if material else None


def is_physical(material: Usd.Prim | None) -> bool:
    """True if a material says anything about physics, not only about looks."""
    if material is None:
        return False
    apis = applied_schemas(material)
    return (names.MATERIAL in apis or any(api in apis for api in DEFORMABLE)
            or any(a.GetName().startswith("physics:") for a in material.GetAuthoredAttributes()))


def material_or_body(reading: StageReading, prim: Usd.Prim, schema: str) -> Usd.Prim:
    """The physics material of a body; where none is bound the body itself, which carries none of its attributes, with a warning
    that the fallbacks of `schema` count."""
    material = bound_physics_material(reading, prim)
    if material is not None and is_physical(material):
        return material
    reading.warn(prim.GetPath(), f"no physics material is bound: the fallbacks of {schema} count (E = {names.YOUNGS_MODULUS:g} "
                 f"Pa, density {names.DENSITY:g} kg/m^3); bind one by material:binding:physics")
    return prim


def load_friction(reading: StageReading, prim: Usd.Prim, note: bool = False) -> tuple[float, float]:
    """Static and dynamic coefficient: 0.5 without a physics material, 0 (UsdPhysics) where it does not author one."""
    material = bound_physics_material(reading, prim)
    if material is None or not is_physical(material):
        return UNBOUND_FRICTION, UNBOUND_FRICTION
    found = [read_attribute(material, "Friction", field, reading.units) for field in FRICTION]
    for field, value in zip(FRICTION, found, strict=True):
        name = attribute_entry("Friction", field).attribute
        if value is None and note:
            reading.warn(material.GetPath(), f"{name} is not authored: 0, the fallback of UsdPhysics, counts")
        if value is not None and not (math.isfinite(value) and value >= 0):
            reading.fail(material.GetPath(), f"{name} is {value:g}; allowed is a finite number >= 0")
    static, dynamic = (v if v is not None and math.isfinite(v) and v >= 0 else 0.0 for v in found)
    return static, dynamic


def friction_by_name(reading: StageReading, prim: Usd.Prim) -> dict[str, float]:
    """Static and dynamic coefficient of friction by name [1]."""
    return dict(zip(FRICTION, load_friction(reading, prim), strict=True))


def load_restitution(reading: StageReading, prim: Usd.Prim) -> float:
    """Restitution of a collider: 0, the fallback of UsdPhysics, where no physics material authors one."""
    material = bound_physics_material(reading, prim)
    value = None if material is None else read_attribute(material, "Friction", "restitution", reading.units)
    if material is not None and value is not None and not 0.0 <= value <= 1.0:
        reading.fail(material.GetPath(),
                     f"{attribute_entry('Friction', 'restitution').attribute} is {value:g}; allowed is 0 to 1")
        return 0.0
    return value or 0.0


def load_contact(reading: StageReading, prim: Usd.Prim) -> dict[str, Any]:
    """Values of a collider that contacts with it know, by its fields: friction, restitution and thickness [m] (None where
    open)."""
    return {**friction_by_name(reading, prim), "restitution": load_restitution(reading, prim),
            "thickness": read_attribute(prim, "Collider", "thickness", reading.units), **_soft_contact_by_name(prim)}


def _soft_contact_by_name(prim: Usd.Prim) -> dict[str, tuple[float, ...]]:
    """solref and solimp of MuJoCo's contacts, where a prim authors them."""
    found = {name: prim.GetAttribute(f"mjc:{name}") for name in SOFT}
    return {name: tuple(map(float, attribute.Get())) for name, attribute in found.items()
            if attribute and attribute.HasAuthoredValue()}


def author_softness(prim: Usd.Prim, collider) -> None:
    """Writes solref and solimp of a collider, where they are not MuJoCo's defaults."""
    for name in SOFT:
        value = getattr(collider, name)
        if value != type(collider).__dataclass_fields__[name].default:
            prim.CreateAttribute(f"mjc:{name}", Sdf.ValueTypeNames.DoubleArray, False).Set(list(value))


def load_fabric(reading: StageReading, prim: Usd.Prim, body_density: float | None, thickness: float | None) -> Fabric:
    """The fabric of a cloth. body_density [kg/m^3] overrules the material's; thickness [m] is that of the mesh.

    Every value out of range is reported with the material's path; the default takes its place so that reading goes on.
    """
    material = material_or_body(reading, prim, names.SURFACE_MATERIAL)
    values = _read_sheet_stiffness(reading, material, thickness)
    values["density"] = effective_density(reading, material, body_density)
    values["static_friction"], values["dynamic_friction"] = load_friction(reading, prim, note=True)
    values |= own_material_values(reading, material, "Fabric", values)
    return validate_material(reading, material, Fabric, values)


def own_material_values(reading: StageReading, material: Usd.Prim, owner: str, known: dict) -> dict:
    """Values of wsim's own schema that a material authors and nothing else says [SI], by field."""
    found = {field: read_attribute(material, owner, field, reading.units)
             for field in names.schema_fields(owner, names.WSIM_MATERIAL)
             if field not in known}
    return {field: value for field, value in found.items() if value is not None}


def effective_density(reading: StageReading, material: Usd.Prim, body_density: float | None) -> float:
    """[kg/m^3]: the body's, else the material's, else the proposal's fallback."""
    return body_density or _unset_to_none(read_attribute(material, "Friction", "density", reading.units)) or names.DENSITY


def note_density(reading: StageReading, prim: Usd.Prim) -> None:
    """Warns of a physics material without a density, where that of nothing else counts."""
    material, entry = bound_physics_material(reading, prim), attribute_entry("Friction", "density")
    if material is not None and is_physical(material) and _unset_to_none(read_attribute(material, "Friction",
                                                                                        "density")) is None:
        reading.warn(material.GetPath(), f"{entry.attribute} is not authored: {names.DENSITY:g} kg/m^3 counts, the fallback, "
                     "as heavy as water; author it in units of the stage")


def _read_sheet_stiffness(reading: StageReading, material: Usd.Prim, thickness: float | None) -> dict:
    """Thickness and the three stiffnesses [SI], each as authored or derived."""
    units = reading.units
    own = read_attribute(material, "Fabric", "thickness", units) or None
    h = thickness if thickness is not None else own if own is not None else names.THICKNESS
    nu = read_attribute(material, "Fabric", "poisson", units)
    nu = names.POISSONS_RATIO if nu in UNAUTHORED else nu
    E = read_attribute(material, "Elastic", "young", units)
    E = names.YOUNGS_MODULUS if E in UNAUTHORED else E
    if not (math.isfinite(E) and E > 0):
        name = attribute_entry("Elastic", "young").attribute
        reading.fail(material.GetPath(), f"{name} is {E / units.factor('Pa'):g}; allowed is a finite number > 0")
        E = names.YOUNGS_MODULUS
    safe = nu if -1.0 < nu < 0.5 else 0.0                      # out of range: reported by validated
    derived = {"stretch": E * h, "shear": E * h / (2.0 * (1.0 + safe)), "bend": E * h * h * h / (12.0 * (1.0 - safe * safe))}
    for field in derived:
        value = read_attribute(material, "Fabric", field, units,
                               through=plane_stress_conversion(safe) if field == "stretch" else None)
        if value not in UNAUTHORED:
            derived[field] = value
        if field == "stretch" and value not in UNAUTHORED and not value > 0:     # as authored, not as converted
            authored = read_attribute(material, "Fabric", field, units)
            reading.fail(material.GetPath(),
                         f"{attribute_entry('Fabric', field).attribute} is {authored:g}; allowed is a finite "
                                             "number > 0")
            derived[field] = E * h
    return {"thickness": h, "poisson": nu, **derived}


def plane_stress_conversion(nu: float):
    """(forward, inverse) between E h and the plane-stress stiffness E h / (1 - nu^2)."""
    return (lambda stretch: stretch / (1.0 - nu * nu)), (lambda stiffness: stiffness * (1.0 - nu * nu))


def _unset_to_none(value: float | None) -> float | None:
    """None for the sentinel 0 (and -inf): not authored."""
    return None if value in (*UNAUTHORED, 0.0) else value


def validate_material(reading: StageReading, material: Usd.Prim, kind: type, values: dict):
    """The Fabric or Bulk (kind) of these values; those out of range are reported and left at their defaults."""
    good = {}
    for field, value in values.items():
        try:
            kind(**{field: value})
            good[field] = value
        except ValueError as error:
            reading.fail(material.GetPath(),
                         f"{attribute_entry(kind.__name__, field).attribute}: {error} (in SI units); author it "
                                             "there")
    return kind(**good)


def define_material(stage: Usd.Stage, path: str) -> Usd.Prim:
    UsdGeom.Scope.Define(stage, Sdf.Path(path).GetParentPath())
    return UsdShade.Material.Define(stage, path).GetPrim()


def author_fabric(stage: Usd.Stage, path: str, fabric: Fabric, units: StageUnits) -> Usd.Prim:
    """Defines a Material that says a fabric."""
    prim = define_material(stage, path)
    for schema in (names.MATERIAL, names.SURFACE_MATERIAL, names.WSIM_MATERIAL):
        prim.AddAppliedSchema(schema)
    for field in (f.name for f in fields(Fabric)):
        through = plane_stress_conversion(fabric.poisson) if field == "stretch" else None
        author_attribute(prim, "Fabric", field, getattr(fabric, field), units, through)
    return prim


def author_friction(stage: Usd.Stage, path: str, friction: tuple[float, ...], units: StageUnits) -> Usd.Prim:
    """Defines a Material that says nothing but friction (static, dynamic) and, where there is a third number, restitution."""
    prim = define_material(stage, path)
    prim.AddAppliedSchema(names.MATERIAL)
    for field, value in zip((*FRICTION, "restitution"), friction, strict=False):
        author_attribute(prim, "Friction", field, value, units)
    return prim


def bind_physics_material(prim: Usd.Prim, material: Usd.Prim) -> None:
    """Binds a material for the purpose "physics"; what a viewer shows is left alone."""
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(
        UsdShade.Material(material), UsdShade.Tokens.fallbackStrength, "physics")


def warn_subset_materials(reading: StageReading, prim: Usd.Prim) -> None:
    """Warns of physics materials on parts of a mesh: one material counts for the whole."""
    for child in prim.GetChildren():
        if child.GetTypeName() == "GeomSubset" and authored_binding(child):
            reading.warn(child.GetPath(), f"binds a physics material to a part of {prim.GetPath()}; wsim takes the "
                         "material of the whole mesh")


def authored_binding(prim: Usd.Prim) -> bool:
    relationship = prim.GetRelationship("material:binding:physics")
    return bool(relationship) and relationship.HasAuthoredTargets()


def has_mass(prim: Usd.Prim) -> bool:
    return is_authored(prim, "Body", "mass")
