"""What is told of a fluid: fields at the centres of cells, energy, smoke, speed, divergence. NumPy only."""

from typing import Any

import numpy as np

from wsim.physics.fluid.grid.layout import Layout
from wsim.physics.fluid.objects import Fluid

NAMES = ("u", "v", "w")


def fields_at_centers(fluid: Fluid, layout: Layout, arrays: dict[str, np.ndarray], dtype=np.float32) -> dict[str, np.ndarray]:
    """density [1], temperature [K] (nx, ny, nz), velocity (nx, ny, nz, 3) [m/s] at the centres, of type `dtype`."""
    velocity = np.zeros((*fluid.shape, 3), dtype)
    for a, axis in enumerate(layout.axes):
        velocity[..., axis] = layout.component_at_centers(arrays[NAMES[a]], a).reshape(fluid.shape)
    found = {"velocity": velocity}
    for name, of in (("density", "smoke"), ("temperature", "heat")):
        if of in arrays:
            found[name] = arrays[of].astype(dtype).reshape(fluid.shape)
    return found


def fluid_cell_divergence(fluid: Fluid, layout: Layout, arrays: dict[str, np.ndarray], obstacles: Any = None) -> np.ndarray:
    """Outflow of each cell over its volume [1/s], (n), as kernels/fluid/solver/divergence.py has it: through the openings of
    its faces, and what obstacles that move push in; 0 of cells that none opens."""
    found, open_, swells = np.zeros(layout.n), np.zeros(layout.n), np.zeros(layout.n)
    solids = obstacles.solids() if obstacles and obstacles.moving else None
    for a, o in enumerate(obstacles.host_openings() if obstacles else [None] * layout.dim):
        shape = layout.faces(a)
        o = np.ones(shape) if o is None else o.astype(np.float64).reshape(shape)
        s = np.zeros(shape) if solids is None else solids[a].astype(np.float64).reshape(shape)
        found += layout.outflow(o * arrays[NAMES[a]] + (1.0 - o) * s, a) / fluid.cell
        open_ += layout.component_at_centers(o, a) / layout.dim
        swells += layout.outflow(s, a) / fluid.cell
    if obstacles and "forming" in obstacles.shapes.kinds:
        found -= (1.0 - open_) * swells
    return np.where(open_ > 0.0, found, 0.0)


def fluid_measures(fluid: Fluid, layout: Layout, arrays: dict[str, np.ndarray], obstacles: Any = None) -> dict[str, float]:
    """Kinetic energy [J], greatest speed [m/s], greatest divergence [1/s], and smoke [m^3] where there is some."""
    volume = fluid.cell ** 3
    square = sum(layout.component_at_centers(arrays[NAMES[a]] ** 2, a) for a in range(layout.dim))
    found = {"fluid_energy": float(0.5 * fluid.density * volume * np.sum(square)),
             "fluid_speed": float(np.sqrt(np.max(square))),
             "fluid_divergence": float(np.abs(fluid_cell_divergence(fluid, layout, arrays, obstacles)).max())}
    return found | ({"fluid_smoke": float(arrays["smoke"].sum() * volume)} if "smoke" in arrays else {})
