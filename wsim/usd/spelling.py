"""Names on a stage that nobody reads: misspelt, of an older or foreign revision, or on a prim where they mean nothing. A name
that is not read does nothing, so each is a warning with the name that was probably meant. There are also warnings about tokens
that their schema does not allow, and about targets that do not exist.
"""

from difflib import get_close_matches

from pxr import Usd, UsdShade

from wsim.usd import names
from wsim.usd.load_varying import CURVES, is_time_varying
from wsim.usd.names import FOREIGN_ATTRIBUTES, FOREIGN_PREFIXES, FOREIGN_SCHEMAS, FOREIGN_TYPES, TABLE, UNREAD, attribute_entry
from wsim.usd.stage import StageReading, applied_schemas

WSIM, PRIMVAR, RESTART = "wsim:", "primvars:wsim:", "wsim:restart:"
FIELDS = dict.fromkeys(names.PER_TET, names.VOLUME_SIM) | dict.fromkeys(
    (*names.PER_ELEMENT, "thickness"), names.SURFACE_SIM)
# what must be the type of a prim, or applied to it, for the attributes of a schema of wsim to be read
PLACES = {names.WSIM_SCENE: names.PHYSICS_SCENE, names.WSIM_MATERIAL: "Material", names.WSIM_CLOTH: names.SURFACE_SIM,
          names.WSIM_SPRINGS: names.WSIM_SPRINGS, names.WSIM_SOFT: names.VOLUME_SIM, names.WSIM_COLLIDER: names.COLLISION,
          names.WSIM_SHAPES: names.WSIM_SHAPES,
          names.WSIM_RODS: names.CURVES_SIM, names.WSIM_ATTACHMENT: names.ATTACHMENT, names.WSIM_LOAD: names.WSIM_LOAD,
          names.WSIM_RIGID: names.RIGID_BODY, names.WSIM_ACTUATOR: names.WSIM_ACTUATOR, names.WSIM_JOINT: names.WSIM_JOINT,
          names.WSIM_DOMAIN: names.WSIM_DOMAIN, names.WSIM_SOURCE: names.WSIM_SOURCE,
          names.WSIM_LIQUID: names.WSIM_LIQUID, names.WSIM_POUR: names.WSIM_POUR, names.WSIM_GRAINS: names.WSIM_GRAINS,
          names.WSIM_SKELETON: "Skeleton", names.WSIM_CORRECTIVE: "BlendShape", names.WSIM_PARTICLES: names.WSIM_PARTICLES}
SCHEMAS = tuple(v for v in vars(names).values() if isinstance(v, str) and v.startswith(("Physics", "Wsim")))
DEFORMABLE = {names.BODY, names.SURFACE_SIM, names.CURVES_SIM, names.VOLUME_SIM, names.SURFACE_MATERIAL, names.CURVES_MATERIAL,
              names.VOLUME_MATERIAL, names.ATTACHMENT, names.PHYSICS_SCENE, "Material"}    # whose physics: names wsim reads


def _attribute_schemas() -> dict[str, set[str]]:
    """Where each attribute of wsim is read."""
    found: dict[str, set[str]] = {names.ORDER: {names.PHYSICS_SCENE}, names.LOADED: {names.WSIM_LOAD},
                                    names.INTO: {names.WSIM_SOURCE}, names.POURED: {names.WSIM_POUR},
                                    names.DRIVERS: {"Skeleton"}, names.GUIDES: {names.WSIM_RODS}}
    for entry in TABLE:
        if entry.attribute.startswith(WSIM):
            found.setdefault(entry.attribute, set()).add(PLACES[entry.schema])
    found[attribute_entry("Fabric", "thickness").attribute].add(names.SURFACE_SIM)  # beside the float of the mesh
    return found | {PRIMVAR + name: {place} for name, place in FIELDS.items()} | {
        PRIMVAR + "pin": {names.SURFACE_SIM, names.VOLUME_SIM}}                  # `wsim.usd.prims.painted`


READ = _attribute_schemas()
BINDINGS, OWNER = ("material:binding:physics", "material:binding"), "physics:simulationOwner"
OF_JOINTS = ("physics:", "drive:", "limit:")
PHYSICS = {entry.attribute for entry in TABLE if entry.attribute.startswith("physics:")} | set(UNREAD)


def check_spelling(reading: StageReading, prim: Usd.Prim) -> None:
    """Warns of names on a prim that do nothing; notes the attributes that are sampled in time."""
    apis, kind = applied_schemas(prim), prim.GetTypeName()
    for api in (*apis, kind):
        _warn_unknown_schema(reading, prim, api)
    is_, own = {*apis, kind}, set(map(str, prim.GetAuthoredPropertyNames()))
    for name in sorted(own):
        if name in FOREIGN_ATTRIBUTES:
            reading.warn(prim.GetPath(), f"{name} is an older spelling and not read; author {FOREIGN_ATTRIBUTES[name]}")
        elif prefix := next((p for p in FOREIGN_PREFIXES if name.startswith(p)), None):
            reading.warn(prim.GetPath(), f"{name} is a foreign spelling and not read; the current namespace is "
                         f"{FOREIGN_PREFIXES[prefix]}")
        elif name.startswith((WSIM, PRIMVAR)) and not name.startswith(RESTART):
            _warn_wsim_attribute(reading, prim, name, is_)
        elif name.startswith("physics:") and is_ & DEFORMABLE and name not in PHYSICS:
            _warn_physics_attribute(reading, prim, name)
        elif name.startswith("drive:") and name.endswith(":physics:type") or name == "orientation":
            _warn_bad_token(reading, prim, name)
        known = name in READ or name in PHYSICS or kind.endswith("Joint") and name.startswith(OF_JOINTS)
        if known and name not in CURVES and is_time_varying(prim.GetAttribute(name)):
            reading.sampled.append(prim.GetAttribute(name).GetPath())


def _warn_bad_token(reading: StageReading, prim: Usd.Prim, name: str) -> None:
    """Warns of a token that its schema does not allow; it is read as the first allowed one."""
    allowed = prim.GetPrimDefinition().GetPropertyMetadata(name, "allowedTokens") or ()
    if allowed and (value := prim.GetAttribute(name).Get(reading.start)) not in allowed:
        reading.warn(prim.GetPath(), f"{name} is {value!r}, and is read as {allowed[0]}; allowed is {' or '.join(allowed)}: "
                     "choose one")


def _warn_unknown_schema(reading: StageReading, prim: Usd.Prim, name: str) -> None:
    """A type or an applied API."""
    if name in names.FEATURES:
        reading.warn(prim.GetPath(), f"wsim does not simulate {names.FEATURES[name]} ({name})")
    elif name in FOREIGN_SCHEMAS:
        reading.warn(prim.GetPath(), f"{name} is not read; the current schema is {FOREIGN_SCHEMAS[name]}")
    elif name.startswith(FOREIGN_TYPES) and name.endswith("Attachment"):
        reading.warn(prim.GetPath(), f"{name} is not read; the current type is {names.ATTACHMENT}, with physics:type0 and "
                     "physics:type1")
    elif (name.startswith(("Physics", "Wsim", "physics", "wsim")) and name.partition(":")[0] not in SCHEMAS
          and not _is_known_schema(name) and (close := get_close_matches(name, SCHEMAS, 1, 0.8))):
        reading.warn(prim.GetPath(), f"{name} is no schema that wsim or USD knows, and does nothing; did you mean {close[0]}?")


def _is_known_schema(name: str) -> bool:
    """Whether USD has a schema of that name."""
    registry = Usd.SchemaRegistry()
    plain = name.partition(":")[0]
    return bool(registry.FindConcretePrimDefinition(plain) or registry.FindAppliedAPIPrimDefinition(plain)
                or registry.IsAppliedAPISchema(plain))


def _warn_wsim_attribute(reading: StageReading, prim: Usd.Prim, name: str, is_: set[str]) -> None:
    if name not in READ:
        mine = [n for n, places in READ.items() if places & is_]
        close = get_close_matches(name, mine, 1, 0.7) or get_close_matches(name, list(READ), 1, 0.7)
        reading.warn(prim.GetPath(), f"{name} is no name that wsim reads, and does nothing; "
                     + (f"did you mean {close[0]}?" if close else f"read here are: {', '.join(mine) or 'none'}"))
    elif not READ[name] & is_:
        places = " or ".join(f"a {p}" if p == "Material" or not p.endswith("API") else f"a prim with {p}"
                             for p in sorted(READ[name]))
        reading.warn(prim.GetPath(), f"{name} does nothing on a {prim.GetTypeName() or 'prim without a type'} like this; it is "
                     f"read on {places}: author it there")


def _warn_physics_attribute(reading: StageReading, prim: Usd.Prim, name: str) -> None:
    if prim.GetPrimDefinition().GetPropertyDefinition(name) or name.startswith("physics:deformablePose:"):
        return
    close = get_close_matches(name, PHYSICS, 1, 0.8)
    reading.warn(prim.GetPath(), f"{name} is no name that wsim reads here, and does nothing"
                 + (f"; did you mean {close[0]}?" if close else ""))


def warn_missing_targets(reading: StageReading, prim: Usd.Prim) -> None:
    """Warns of a selected variant, a bound physics material and a simulation owner of a prim that do not exist."""
    for name, chosen in (prim.GetVariantSets().GetAllVariantSelections() if prim.HasVariantSets() else {}).items():
        if chosen and chosen not in (has := prim.GetVariantSet(name).GetVariantNames()):
            reading.warn(prim.GetPath(), f"its variant set {name} has no variant {chosen!r}, so no variant is selected; choose "
                         f"one of {', '.join(has) or 'those it has'}")
    if not any(api.startswith(("Physics", "Wsim")) for api in applied_schemas(prim)):
        return
    for name in BINDINGS:
        for target in _forwarded_targets(prim, name):
            found = reading.stage.GetPrimAtPath(target)
            if not UsdShade.Material(found):
                what = f"is a {found.GetTypeName() or 'prim without a type'}, not a Material" if found else "is no prim"
                reading.warn(prim.GetPath(), f"{name} names {target}, which {what}: material values are defaults; name a "
                             "Material, or remove the binding")
            return
    for target in _forwarded_targets(prim, OWNER):
        found = reading.stage.GetPrimAtPath(target)
        if not found or found.GetTypeName() != names.PHYSICS_SCENE:
            reading.warn(prim.GetPath(), f"{OWNER} names {target}, which is no {names.PHYSICS_SCENE}; name one, or remove it")


def _forwarded_targets(prim: Usd.Prim, name: str) -> list:
    relationship = prim.GetRelationship(name)
    return relationship.GetForwardedTargets() if relationship else []
