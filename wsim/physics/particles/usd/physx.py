"""What PhysX says of particles: PhysxParticleSetAPI, its PhysxParticleSystem and PhysxPBDMaterialAPI (PhysxSchema of Omniverse
PhysX 5). Methods read them as far as they have the like; what they do not read they name in one line.

    fluidRestOffset, solidRestOffset r  particles rest 2 r apart
    particleContactOffset c             where r is not authored: r = 0.594 c of fluids, 0.99 c of others, as PhysX has it
"""

from math import inf

from pxr import Usd

from wsim.physics.particles.usd.bindings import authored_names, warn_unread
from wsim.usd.attributes import read_table_attribute
from wsim.usd.names import AttributeEntry
from wsim.usd.stage import StageReading

SET, MATERIAL = "physxParticle:", "physxPBDMaterial:"
REST = {True: ("fluidRestOffset", 0.99 * 0.6), False: ("solidRestOffset", 0.99)}
CONTACT = 0.05                   # [m] particleContactOffset where it is not authored
QUIET = {"friction": 0.2, "particleFrictionScale": 1.0, "gravityScale": 1.0, "cflCoefficient": 1.0, "adhesionOffsetScale": 0.0,
         "particleAdhesionScale": 1.0}      # values that ask for nothing; of others 0
SYSTEM = ("particleSystemEnabled", "enableCCD", "globalSelfCollisionEnabled", "nonParticleCollisionEnabled", "contactOffset",
          "restOffset", "particleContactOffset", "solidRestOffset", "fluidRestOffset", "solverPositionIterationCount",
          "maxDepenetrationVelocity", "maxVelocity", "wind", "maxNeighborhood", "neighborhoodScale")
MET = dict.fromkeys(("particleSystemEnabled", "enableCCD", "globalSelfCollisionEnabled", "nonParticleCollisionEnabled"), True)


def read_radius(reading: StageReading, system: Usd.Prim | None, fluid: bool) -> float:
    """Half the distance [m] at which particles of a system rest."""
    name, part = REST[fluid]
    return read_length(reading, system, name) or part * (read_length(reading, system, "particleContactOffset") or CONTACT)


def find_particle_system(reading: StageReading, prim: Usd.Prim, why: str) -> Usd.Prim | None:
    """The particle system of a set; None where it names none that there is. why: what of it is not read is not, in words."""
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
    warn_unread(reading, found, unread, why)
    return found


def read_own_number(reading: StageReading, prim: Usd.Prim, name: str, unit: str) -> float | None:
    """An authored number [SI]; None where there is none, or minus infinity, which stands for a default."""
    found = read_table_attribute(prim, AttributeEntry("", "", "", name, "float", unit), reading.units)
    return None if found is None or found == -inf else found


def read_weight(reading: StageReading, prim: Usd.Prim, name: str, unit: str) -> float | None:
    """A mass or density above 0; None where none is authored, or 0, which stands for none."""
    found = read_own_number(reading, prim, f"physics:{name}", unit)
    if found is not None and not 0.0 <= found < inf:
        reading.fail(prim.GetPath(), f"physics:{name} is {found:g}; allowed is a finite number > 0, or 0 for none")
        return None
    return found


def read_length(reading: StageReading, prim: Usd.Prim | None, name: str) -> float | None:
    """A length [m] above 0; None where none is authored."""
    found = read_own_number(reading, prim, name, "m") if prim else None
    if prim and found is not None and not 0.0 <= found < inf:
        reading.fail(prim.GetPath(), f"{name} is {found:g}; allowed is a finite length, or minus infinity for that of PhysX")
    return found if found is not None and found > 0.0 else None


def read_flag(reading: StageReading, prim: Usd.Prim, name: str, plain: bool) -> bool:
    found = prim.GetAttribute(name).Get(reading.start) if prim.HasAttribute(name) else None
    if found is not None and not isinstance(found, bool):
        reading.fail(f"{prim.GetPath()}.{name}", f"is of type {prim.GetAttribute(name).GetTypeName()}; allowed is bool: author "
                     "it again with that type")
    return plain if found is None else bool(found)


def flag_is_off(prim: Usd.Prim, name: str) -> bool:
    """Whether a flag of PhysX asks for what is not done; other attributes do."""
    found = prim.GetAttribute(name).Get() if prim.HasAttribute(name) else None
    return found is not True
