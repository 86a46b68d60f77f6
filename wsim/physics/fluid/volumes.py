"""Fields of a fluid as samples of a result: an OpenVDB file a frame, beside the layer (`wsim.usd.result.kinds.volumes`)."""

import numpy as np

from wsim.physics.fluid.objects import Fluid
from wsim.scene.samples import Sample, VolumeSample


def volume_samples(fluid: Fluid, fields: dict[str, np.ndarray]) -> list[Sample]:
    """One sample of the domain's prim. fields: density [1] and temperature [K] (nx, ny, nz), velocity (nx, ny, nz, 3) [m/s], of
    the cells' centres."""
    return [VolumeSample(fluid.path, fluid.low, fluid.cell, fields, {"velocity": "m/s"})]
