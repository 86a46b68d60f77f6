"""PhysX's words on Points with WsimParticlesAPI, as hints: what wsim:particles: does not say. The rest is named in a line.

    physxParticle:fluid                          a fluid, else grains
    fluidRestOffset, solidRestOffset             radius of a particle, where the system says one; else widths count
    particleContactOffset                        radius, where neither rest offsets nor widths say one
    physxParticle:simulationPoints               places, before points
    physxParticle:particleEnabled, particleSystemEnabled     off: the prim is left out
    physxPBDMaterial:friction                    friction of grains, and of a fluid with colliders
    physxPBDMaterial:surfaceTension              above 0: a fluid has that of water, since its unit there is 1/m^3
    physxPBDMaterial:density, physics:density, physics:mass  density; of these the mass counts first, then that on the set

PhysX's viscosity, cohesion and damping have no unit: they are parts of its iterations, and no number of SI is the same.
"""

from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np
from pxr import Usd

from wsim.physics.particles.usd.bindings import authored_names, bound_physics_material, warn_unread
from wsim.physics.particles.usd.physx import (
    MATERIAL,
    QUIET,
    REST,
    SET,
    find_particle_system,
    flag_is_off,
    read_flag,
    read_length,
    read_own_number,
    read_radius,
    read_weight,
)
from wsim.usd import names
from wsim.usd.stage import StageReading, applied_schemas

OF_FLUIDS = ("surfaceTension", "viscosity", "cohesion", "vorticityConfinement")      # PhysX too leaves solids alone with these
READ = {f"{SET}{each}" for each in ("fluid", "particleSystem", "simulationPoints", "particleEnabled", "particleGroup")}
WATER = 0.072              # surface tension against air [N/m]
IN_XPBD = "here particles move in the iterations of the scene, and wsim:scene attributes say how many"


@dataclass
class PhysxHints:
    """Hints of a prim.

    left_out      it is switched off
    fluid         None: PhysX says nothing
    radius        half the rest distance that is authored [m]; None: none is
    fallback      radius by the contact offset [m]
    places        simulationPoints, own frame (n, 3) [m]
    density       [kg/m^3]      mass   of all [kg]      friction   [1]
    tension       surface tension [N/m]
    """

    left_out: bool = False
    fluid: bool | None = None
    radius: float | None = None
    fallback: float | None = None
    places: np.ndarray | None = None
    density: float | None = None
    mass: float | None = None
    friction: float | None = None
    tension: float | None = None

    def density_of(self, radius: float, count: int) -> float | None:
        """Density of particles of a radius [m]; None where nothing says one."""
        if self.mass and count and radius > 0.0:
            volume = (2.0 * radius) ** 3 if self.fluid else 4.0 / 3.0 * pi * radius**3
            return self.mass / (count * volume)
        return self.density


def read_physx_hints(reading: StageReading, prim: Usd.Prim, fluid: bool | None) -> PhysxHints:
    """Hints of a prim; empty where it has no PhysxParticleSetAPI. fluid: as wsim:particles: says, None: nothing."""
    if names.PHYSX_SET not in applied_schemas(prim):
        return PhysxHints()
    system = find_particle_system(reading, prim, IN_XPBD)
    off = [p.GetPath() for p, name in ((prim, f"{SET}particleEnabled"), (system, "particleSystemEnabled"))
           if p and read_flag(reading, p, name, True) is False]
    if off:
        reading.warn(off[0], f"is switched off: {prim.GetPath()} is left out")
        return PhysxHints(left_out=True)
    found = PhysxHints(fluid=read_flag(reading, prim, f"{SET}fluid", True) if fluid is None else fluid)
    found.radius = read_length(reading, system, REST[bool(found.fluid)][0])
    found.fallback = read_radius(reading, system, bool(found.fluid))
    found.places = _read_places(reading, prim)
    _read_material(reading, system, prim, found)
    found.mass = read_weight(reading, prim, "mass", "kg")
    found.density = read_weight(reading, prim, "density", "kg/m^3") or found.density
    warn_unread(reading, prim, [each for each in authored_names(prim, SET) if each not in READ and flag_is_off(prim, each)],
                "all particles meet each other")
    return found


def _read_places(reading: StageReading, prim: Usd.Prim) -> np.ndarray | None:
    attribute = prim.GetAttribute(f"{SET}simulationPoints")
    places = attribute.Get(reading.start) if attribute else None
    if places is None:
        return None
    if np.ndim(places) != 2:
        reading.fail(attribute.GetPath(), f"is of type {attribute.GetTypeName()}; allowed is point3f[]: author it again with "
                     "that type")
        return None
    return np.array(places, np.float64).reshape(-1, 3) * reading.units.metres


def _read_material(reading: StageReading, system: Usd.Prim | None, prim: Usd.Prim, found: PhysxHints) -> None:
    """Friction, density and surface tension of the material that is bound to the system, else to the set."""
    bound: Any = next((each for of in (system, prim) if of and (each := bound_physics_material(of))), None)
    if bound is None:
        return
    value = {name: read_own_number(reading, bound, MATERIAL + name, "kg/m^3" if name == "density" else "1")
             for name in (each.removeprefix(MATERIAL) for each in authored_names(bound, MATERIAL))}
    found.density = value.pop("density", None) or read_own_number(reading, bound, "physics:density", "kg/m^3")
    found.friction = value.pop("friction", None)
    if found.fluid and (value.pop("surfaceTension", None) or 0.0) > 0.0:
        found.tension = WATER
        reading.warn(bound.GetPath(), f"its {MATERIAL}surfaceTension is no force over a length: the fluid has {WATER:g} "
                     "N/m, that of water; author wsim:particles:surfaceTension for another")
    warn_unread(reading, bound, [MATERIAL + name for name, number in value.items() if number is not None
                                 and number != QUIET.get(name, 0.0) and (found.fluid or name not in OF_FLUIDS)],
                "they have no unit in PhysX; author wsim:particles: attributes on the Points, such as viscosity [Pa s]")
