"""What is told of a liquid: its particles as a sample of a result, energies, speed, volume. NumPy only."""

import numpy as np

from wsim.physics.fluid.liquid.objects import ACROSS, Liquid
from wsim.scene.samples import DROPS, Particles


def width(liquid: Liquid) -> float:
    """Diameter of a ball with the volume that a particle has at rest [m]."""
    return liquid.cell / ACROSS * (6.0 / np.pi) ** (1.0 / 3.0)


def mass(liquid: Liquid) -> float:
    """Mass of a particle [kg]; a flat liquid is one cell thick."""
    return liquid.density * liquid.cell ** 3 / ACROSS ** len(liquid.axes)


def sample(liquid: Liquid, particles: dict[str, np.ndarray]) -> Particles:
    """Sample that stands beside its domain."""
    x = particles["x"]
    return Particles(liquid.path + DROPS, x, np.full(len(x), width(liquid)), particles["id"], particles["v"])


def measures(liquid: Liquid, particles: dict[str, np.ndarray], gravity: np.ndarray,
             phi: np.ndarray | None) -> dict[str, float]:
    """Kinetic energy and that in gravity [J], greatest speed [m/s], particles; of the distances phi of the cells' centres to
    the surface, in cells, the volume within it [m^3], exact of planes across an axis."""
    x, v, m = particles["x"], particles["v"], mass(liquid)
    found = {"liquid_energy": float(m * (0.5 * np.sum(v ** 2) - np.sum(x @ gravity))),
             "liquid_speed": float(np.sqrt(np.max(np.sum(v ** 2, axis=1), initial=0.0))), "liquid_particles": float(len(x))}
    if phi is not None:
        found["liquid_volume"] = float(np.clip(0.5 - phi.astype(np.float64), 0.0, 1.0).sum() * liquid.cell ** 3)
    return found
