"""Which steps the bodies of a scene take: explicit ones, as short as the stiffest material needs, or implicit ones. NumPy."""

from typing import Any

import numpy as np

from wsim.physics.mpm.objects import MaterialPoints

IMPLICIT_MATERIALS = "sand alone, or jelly and snow"
INTEGRATORS = ("auto", "explicit", "implicit")
COURANT = WAY = 0.5        # cells that a wave, and a particle, may cross in a step, as kernels/particles/mpm/motion.py
HARDENING = 4.0            # largest exponent of snow that is packed, as kernels/particles/mpm/laws.py
SAND_STEPS = 200           # explicit steps of a frame, above which sand takes implicit ones
ELASTIC_STEPS = 1000       # and jelly and snow: half of the time of explicit steps, on a CPU (par: 400); they damp
ELASTIC = {"neo_hookean", "corotational", "snow"}


def materials_of(things: list[MaterialPoints]) -> list:
    """Materials of all bodies."""
    return [material for thing in things for material in thing.materials]


def explicit_steps(material: Any, cell: float, fps: float, speed: float = 0.0) -> tuple[float, float]:
    """Explicit steps of a frame, and the length of one [s], by the wave of the material; cell: edge of a cell [m].

    speed    with which it hits something [m/s]. Nothing is farther in a step than WAY cells. Snow whose elastic limit does not
             bear the pressure density speed^2 packs where it is struck, and is then as stiff as its law has it at most."""
    mu, lam = material.numbers()[:2]
    wave = float(np.sqrt((lam + 2.0 * mu) / material.density))
    if material.law == "snow" and material.density * speed**2 > material.compression_limit * (lam + 2.0 * mu):
        wave *= float(np.exp(0.5 * HARDENING * (material.hardening > 0.0)))
    step = cell / max(wave / COURANT, speed / WAY)
    return (1.0 / (fps * step) if fps > 0.0 else 0.0), step


def has_implicit_steps(things: list[MaterialPoints]) -> bool:
    """True if there are implicit steps for what the bodies are made of: sand alone, or jelly and snow."""
    laws = {material.law for material in materials_of(things)}
    return laws == {"sand"} or laws <= ELASTIC


def chosen_integrator(things: list[MaterialPoints], fps: float, pushes: bool = False) -> str:
    """"explicit" or "implicit", for all bodies of a scene: what they ask for; else implicit where it is known and a frame would
    take many explicit steps. pushes: they push rigid bodies, cloth or soft bodies, which takes explicit steps; pins of sand do
    so too."""
    asked = {thing.integrator for thing in things} - {"auto"}
    pushes |= any(thing.pins for thing in things) and things[0].material.law == "sand"
    if asked or pushes:
        return "explicit" if pushes else asked.pop()
    most = max(explicit_steps(material, things[0].cell, fps)[0] for material in materials_of(things))
    limit = SAND_STEPS if things[0].material.law == "sand" else ELASTIC_STEPS
    return "implicit" if has_implicit_steps(things) and most > limit else "explicit"
