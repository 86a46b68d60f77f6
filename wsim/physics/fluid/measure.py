"""What is told of a fluid: fields at the centres of cells, energy, smoke, speed, divergence. NumPy only."""

import numpy as np

from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.objects import Fluid

NAMES = ("u", "v", "w")


def centered(fluid: Fluid, layout: Layout, arrays: dict[str, np.ndarray], dtype=np.float32) -> dict[str, np.ndarray]:
    """density [1], temperature [K] (nx, ny, nz), velocity (nx, ny, nz, 3) [m/s] at the centres, of type `dtype`."""
    velocity = np.zeros((*fluid.shape, 3), dtype)
    for a, axis in enumerate(layout.axes):
        velocity[..., axis] = layout.centered(arrays[NAMES[a]], a).reshape(fluid.shape)
    found = {"velocity": velocity}
    for name, of in (("density", "smoke"), ("temperature", "heat")):
        if of in arrays:
            found[name] = arrays[of].astype(dtype).reshape(fluid.shape)
    return found


def divergence(fluid: Fluid, layout: Layout, arrays: dict[str, np.ndarray], openings: list[np.ndarray] | None) -> np.ndarray:
    """Outflow of each cell over its volume [1/s], (n); with openings of the faces through those only."""
    found = np.zeros(layout.n)
    for a in range(layout.dim):
        u = arrays[NAMES[a]] * (1.0 if openings is None else openings[a].astype(np.float64).reshape(layout.faces(a)))
        found += (np.roll(u, -1, a) - u if layout.periodic[a] else np.diff(u, axis=a)) / fluid.cell
    return found


def measures(fluid: Fluid, layout: Layout, arrays: dict[str, np.ndarray],
             openings: list[np.ndarray] | None) -> dict[str, float]:
    """Kinetic energy [J], greatest speed [m/s], greatest divergence [1/s], and smoke [m^3] where there is some."""
    volume = fluid.cell ** 3
    square = sum(layout.centered(arrays[NAMES[a]] ** 2, a) for a in range(layout.dim))
    found = {"fluid_energy": float(0.5 * fluid.density * volume * np.sum(square)),
             "fluid_speed": float(np.sqrt(np.max(square))),
             "fluid_divergence": float(np.abs(divergence(fluid, layout, arrays, openings)).max())}
    return found | ({"fluid_smoke": float(arrays["smoke"].sum() * volume)} if "smoke" in arrays else {})
