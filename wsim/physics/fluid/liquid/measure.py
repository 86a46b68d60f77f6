"""What is told of a liquid: its particles as a sample of a result, energies, speed, volume. NumPy only."""

import numpy as np

from wsim.physics.fluid.liquid.objects import ACROSS, Liquid
from wsim.scene.samples import DROPS, ParticleSample

CHANGED = 0.05             # part of its volume that a liquid may lose or gain; flows that are resolved change it by 0.02
LEAST = 64.0               # cells of liquid, of fewer the grid does not know the volume that well


def particle_diameter(liquid: Liquid) -> float:
    """Diameter of a ball with the volume that a particle has at rest [m]."""
    return liquid.cell / ACROSS * (6.0 / np.pi) ** (1.0 / 3.0)


def particle_mass(liquid: Liquid) -> float:
    """Mass of a particle [kg]; a flat liquid is one cell thick."""
    return liquid.density * liquid.cell ** 3 / ACROSS ** len(liquid.axes)


def liquid_sample(liquid: Liquid, particles: dict[str, np.ndarray]) -> ParticleSample:
    """Sample that stands beside its domain."""
    x = particles["x"]
    return ParticleSample(liquid.path + DROPS, x, np.full(len(x), particle_diameter(liquid)), particles["id"], particles["v"])


def liquid_measures(liquid: Liquid, particles: dict[str, np.ndarray], gravity: np.ndarray,
                    volume: float | None) -> dict[str, float]:
    """Kinetic energy and that in gravity [J], greatest speed [m/s], particles; volume [cells] in m^3, where it is known."""
    x, v, m = particles["x"], particles["v"], particle_mass(liquid)
    found = {"liquid_energy": float(m * (0.5 * np.sum(v ** 2) - np.sum(x @ gravity))),
             "liquid_speed": float(np.sqrt(np.max(np.sum(v ** 2, axis=1), initial=0.0))), "liquid_particles": float(len(x))}
    return found if volume is None else found | {"liquid_volume": volume * liquid.cell ** 3}


def volume_error(volume: float, held: float) -> float:
    """Part of the volume of its particles, `held`, that a liquid has gained, or lost (below 0); volumes [cells]. Particles come
    and go by sources, sinks and open sides alone."""
    return volume / held - 1.0 if held >= LEAST else 0.0


def volume_change(liquid: Liquid, error: float) -> str:
    """Text of a warning of that error, with a place for its size in percent."""
    fix = (f"wsim:liquid:cfl {0.5 * liquid.cfl:g}, or smaller cells" + (", or room where walls close in" if error < 0.0 else "")
           if liquid.volume else "wsim:liquid:keepVolume 1")
    return f"{liquid.path}: its liquid {'lost' if error < 0.0 else 'gained'} {{worst}} % of its volume; give {fix}"
