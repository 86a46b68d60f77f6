"""Points with PhysxParticleSetAPI -> `MaterialPoints`: fluids as water, others as sand. Every attribute of the set, its
PhysxParticleSystem and its PhysxPBDMaterialAPI is read, or named in a warning.

    physxParticle:fluid                 water, else sand                      physxParticle:particleSystem   the system
    physxParticle:simulationPoints      places, before points                 physxParticle:particleEnabled  off: left out
    fluidRestOffset, solidRestOffset r  particles rest 2 r apart: the volume of one is (2 r)^3, and cells are 4 r
    particleContactOffset c             where r is not authored: r = 0.594 c of fluids, 0.99 c of others, as PhysX has it
    physxPBDMaterial:density            the same                              :friction, :particleFrictionScale   tan of slopes

Of physics:mass and physics:density on the set the mass counts, then the density. PhysX moves particles by their positions, with
as much stiffness as its iterations give; here water has a bulk modulus and sand a Young's modulus, those of their classes.
"""

from dataclasses import replace
from math import atan, inf
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from wsim.physics.mpm.objects import Granular, MaterialPoints, Water
from wsim.physics.mpm.usd.points import authored_names, bound_physics_material, read_point_places, warn_unread
from wsim.usd import names
from wsim.usd.attributes import read_table_attribute
from wsim.usd.names import AttributeEntry
from wsim.usd.stage import StageReading
from wsim.usd.transforms import read_placement

SET, MATERIAL = "physxParticle:", "physxPBDMaterial:"
REST = {True: ("fluidRestOffset", 0.99 * 0.6), False: ("solidRestOffset", 0.99)}
CONTACT = 0.05                   # [m] particleContactOffset where it is not authored
QUIET = {"friction": 0.2, "particleFrictionScale": 1.0, "gravityScale": 1.0, "cflCoefficient": 1.0, "adhesionOffsetScale": 0.0,
         "particleAdhesionScale": 1.0}      # values that ask for nothing; of others 0
SYSTEM = ("particleSystemEnabled", "enableCCD", "globalSelfCollisionEnabled", "nonParticleCollisionEnabled", "contactOffset",
          "restOffset", "particleContactOffset", "solidRestOffset", "fluidRestOffset", "solverPositionIterationCount",
          "maxDepenetrationVelocity", "maxVelocity", "wind", "maxNeighborhood", "neighborhoodScale")
MET = dict.fromkeys(("particleSystemEnabled", "enableCCD", "globalSelfCollisionEnabled", "nonParticleCollisionEnabled"), True)


def load_particle_set(reading: StageReading, prim: Usd.Prim) -> MaterialPoints | None:
    """The body of a prim; None if it is broken, or left out (reported)."""
    path = str(prim.GetPath())
    if not prim.IsA(UsdGeom.Points):
        reading.warn(path, f"is a {prim.GetTypeName()} with {names.PHYSX_SET}; particles are read of Points: it is left out")
        return None
    system = _system_of(reading, prim)
    off = [p.GetPath() for p, name in ((prim, f"{SET}particleEnabled"), (system, "particleSystemEnabled"))
           if p and _flag(reading, p, name, True) is False]
    if off:
        reading.warn(off[0], f"is switched off: {path} is left out")
        return None
    fluid, found = _flag(reading, prim, f"{SET}fluid", True), read_point_places(reading, prim)
    places = prim.GetAttribute(f"{SET}simulationPoints").Get(reading.start)
    if places is not None and np.ndim(places) != 2:
        kind = prim.GetAttribute(f"{SET}simulationPoints").GetTypeName()
        reading.fail(f"{path}.{SET}simulationPoints", f"is of type {kind}; allowed is point3f[]: author it again with "
                     "that type")
    elif places is not None and len(places) != len(found["points"]):
        reading.warn(path, f"has {len(places)} {SET}simulationPoints and {len(found['points'])} points: the points count; "
                     "author as many")
    elif places is not None:
        place = read_placement(reading, prim)
        found["points"] = place.frame[0][:3, 3] + np.array(places, np.float64) * reading.units.metres @ place.linear[0].T
    name, part = REST[fluid]
    contact = _length(reading, system, "particleContactOffset") or CONTACT
    radius = _length(reading, system, name) or part * contact
    volume = (2.0 * radius) ** 3
    material = _read_material(reading, system, prim, fluid)
    mass, density = (_weight(reading, prim, name, unit) for name, unit in (("mass", "kg"), ("density", "kg/m^3")))
    if mass or density:
        material = replace(material, density=mass / (volume * max(len(found["points"]), 1)) if mass else density)              # type: ignore[arg-type]
    read = {f"{SET}{each}" for each in ("fluid", "particleSystem", "simulationPoints", "particleEnabled", "particleGroup")}
    warn_unread(reading, prim, [each for each in authored_names(prim, SET) if each not in read and _flag_is_off(prim, each)],
                "all particles meet each other on one grid")
    return MaterialPoints(path, cell=4.0 * radius, volumes=np.array([volume]), material=material, **found)


def _system_of(reading: StageReading, prim: Usd.Prim) -> Usd.Prim | None:
    """The particle system of a set; None where it names none that there is."""
    relationship = prim.GetRelationship(f"{SET}particleSystem")
    targets = relationship.GetForwardedTargets() if relationship else []
    found = reading.stage.GetPrimAtPath(targets[0]) if targets else None
    if not found:
        reading.warn(prim.GetPath(), f"{SET}particleSystem names no prim that there is: offsets are those of PhysX by default")
        return None
    plain = {each: value for each, value in MET.items() if found.HasAttribute(each) and found.GetAttribute(each).Get() is value}
    read = {"particleSystemEnabled", "particleContactOffset", "solidRestOffset", "fluidRestOffset", *plain}
    own = set(map(str, found.GetAuthoredPropertyNames()))
    unread = [each for each in SYSTEM if each in own - read] + authored_names(found, "physxParticle")
    warn_unread(reading, found, unread, "they set PhysX's solver of positions; here particles meet on a grid, and never pass a "
                "collider")
    return found


def _read_material(reading: StageReading, system: Usd.Prim | None, prim: Usd.Prim, fluid: bool) -> Any:
    """Water or sand with what the material that is bound to the system, else to the set, says of it."""
    bound = next((found for each in (system, prim) if each and (found := bound_physics_material(each))), None)
    value = {} if bound is None else {
        name: _own_number(reading, bound, MATERIAL + name, "kg/m^3" if name == "density" else "1")
        for name in (each.removeprefix(MATERIAL) for each in authored_names(bound, MATERIAL))}
    own = _own_number(reading, bound, "physics:density", "kg/m^3") if bound else None
    density = value.pop("density", None) or own or 1000.0
    known = [] if fluid else ["friction", "particleFrictionScale"]
    if bound:
        warn_unread(reading, bound, [MATERIAL + name for name, number in value.items()
                                     if name not in known and number is not None and number != QUIET.get(name, 0.0)],
                    "they are numbers of PhysX's solver of positions; author WsimMaterialPointsAPI on the Points for viscosity "
                    "[Pa s] and the like")
    if fluid:
        return Water(density=density)
    mu = (value.get("friction") or 0.2) * (value.get("particleFrictionScale") or 1.0)
    return Granular(density=density, friction_angle=atan(mu))


def _own_number(reading: StageReading, prim: Usd.Prim, name: str, unit: str) -> float | None:
    """An authored number [SI]; None where there is none, or minus infinity, which stands for a default."""
    found = read_table_attribute(prim, AttributeEntry("", "", "", name, "float", unit), reading.units)
    return None if found is None or found == -inf else found


def _weight(reading: StageReading, prim: Usd.Prim, name: str, unit: str) -> float | None:
    """A mass or density above 0; None where none is authored, or 0, which stands for none."""
    found = _own_number(reading, prim, f"physics:{name}", unit)
    if found is not None and not 0.0 <= found < inf:
        reading.fail(prim.GetPath(), f"physics:{name} is {found:g}; allowed is a finite number > 0, or 0 for none")
        return None
    return found


def _length(reading: StageReading, prim: Usd.Prim | None, name: str) -> float | None:
    """A length [m] above 0; None where none is authored."""
    found = _own_number(reading, prim, name, "m") if prim else None
    if prim and found is not None and not 0.0 <= found < inf:
        reading.fail(prim.GetPath(), f"{name} is {found:g}; allowed is a finite length, or minus infinity for that of PhysX")
    return found if found is not None and found > 0.0 else None


def _flag(reading: StageReading, prim: Usd.Prim, name: str, plain: bool) -> bool:
    found = prim.GetAttribute(name).Get(reading.start) if prim.HasAttribute(name) else None
    if found is not None and not isinstance(found, bool):
        reading.fail(f"{prim.GetPath()}.{name}", f"is of type {prim.GetAttribute(name).GetTypeName()}; allowed is bool: author "
                     "it again with that type")
    return plain if found is None else bool(found)


def _flag_is_off(prim: Usd.Prim, name: str) -> bool:
    """Whether a flag of PhysX asks for what is not done; other attributes do."""
    found = prim.GetAttribute(name).Get() if prim.HasAttribute(name) else None
    return found is not True
