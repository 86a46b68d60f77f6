"""What tests/physics/soft/test_plastic_adjoint.py shares with other tests: LEAPFROG, NEWTON, yielding."""

from dataclasses import replace

import numpy as np

from tests.make.gradient.gradients import bar
from wsim.scene import Scene

LEAPFROG = {"integrator": "leapfrog", "substeps": 60}
NEWTON = {"solver": "implicit", "integrator": "bdf2", "substeps": 4}


def yielding(model: str = "corotational", yields: float = 0.02, **more) -> Scene:
    """The bar, which turns so fast that it flows; a third of it is elastic."""
    scene = bar(model, damping=1e-3, **more)
    soft = scene.softs[0]
    soft.others, soft.which = [soft.material], (np.arange(len(soft.tets)) % 3 == 0).astype(np.int32)
    soft.material = replace(soft.material, yield_strain=yields)
    return scene
