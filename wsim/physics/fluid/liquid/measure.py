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


def free(solid: np.ndarray, cell: float) -> np.ndarray:
    """Part of each cell that obstacles leave, (cells,), of their signed distances at the nodes [m]; exact of planes across an
    axis."""
    for a in [a for a, n in enumerate(solid.shape) if n > 1]:
        solid = 0.5 * (np.delete(solid, 0, a) + np.delete(solid, -1, a))
    return np.clip(0.5 + solid.astype(np.float64) / cell, 0.0, 1.0).ravel()


def measures(liquid: Liquid, particles: dict[str, np.ndarray], gravity: np.ndarray, phi: np.ndarray | None,
             part: np.ndarray | float = 1.0) -> dict[str, float]:
    """Kinetic energy and that in gravity [J], greatest speed [m/s], particles; of the distances phi of the cells' centres to
    the surface, in cells, the volume within it [m^3], exact of planes across an axis. part: of each cell that counts."""
    x, v, m = particles["x"], particles["v"], mass(liquid)
    found = {"liquid_energy": float(m * (0.5 * np.sum(v ** 2) - np.sum(x @ gravity))),
             "liquid_speed": float(np.sqrt(np.max(np.sum(v ** 2, axis=1), initial=0.0))), "liquid_particles": float(len(x))}
    if phi is not None:
        found["liquid_volume"] = float(np.sum(part * np.clip(0.5 - phi.astype(np.float64), 0.0, 1.0)) * liquid.cell ** 3)
    return found
