"""Fields of a fluid as samples of a result: a file a frame, beside the layer."""

from typing import Any

import numpy as np

from wsim.physics.fluid.objects import Fluid
from wsim.scene.samples import Sample, Volume


def samples(fluid: Fluid, fields: dict[str, np.ndarray]) -> list[Sample]:
    """One sample of the domain's prim. fields: density [1] and temperature [K] (nx, ny, nz), velocity (nx, ny, nz, 3) [m/s], of
    the cells' centres."""
    found: dict[str, Any] = {"low": fluid.low, "cell": np.float64(fluid.cell), **fields}
    return [Volume(fluid.path, ".npz", lambda file: np.savez_compressed(file, **found))]
