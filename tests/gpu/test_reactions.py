"""On a GPU: what pins bear in a recording, and gradients by it, are those of the CPU. Skipped where there is no CUDA device."""

import numpy as np
import pytest
import warp as wp

from tests.make.gradient.gradients import bar, net, sheet
from tests.make.physics.cloth.muscles import SOLVERS as PULLED
from tests.make.physics.cloth.muscles import muscled
from tests.make.physics.soft.plastic_adjoint import LEAPFROG, NEWTON, yielding
from tests.make.physics.solver.xpbd_adjoint import SWEEPS
from tools.bench.nets import reference
from wsim.gradient.recording import Recording
from wsim.simulation.simulation import Simulation

wp.init()
pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")

SOLVED = {"solver": "implicit", "integrator": "bdf2", "substeps": 2}
EULER = SWEEPS | {"integrator": "backward_euler"}


def woven():
    """Springs of which several threads share a point."""
    scene = reference.spring_cloth(16)
    scene.solver, scene.integrator, scene.substeps = "explicit", "leapfrog", 40
    return scene


def blown(**more):
    scene = sheet("membrane", damping=2e-4, **more)
    scene.cloths[0].drag, scene.cloths[0].lift, scene.wind = 1.0, 0.6, (1.0, 3.0, 4.0)
    return scene


SCENES = {"woven": (woven, "stiffness"), "chain, xpbd": (lambda: net(**EULER), "stiffness"),
          "sheet": (lambda: sheet("membrane", damping=2e-4), "shear"),
          "sheet, xpbd": (lambda: sheet("membrane", damping=2e-4, **EULER), "shear"),
          "sheet, newton": (lambda: sheet("springs", **SOLVED), "stretch"),
          "bar": (lambda: bar("corotational", damping=1e-3), "young"),
          "bar, newton": (lambda: bar("neo_hookean", **SOLVED), "poisson"),
          "wind": (blown, "bend"), "wind, xpbd": (lambda: blown(**EULER), "bend"),
          "flow": (lambda: yielding(**LEAPFROG), "yield_strain"),
          "flow, newton": (lambda: yielding("neo_hookean", **NEWTON), "young"),
          "muscles": (lambda: muscled(**PULLED["leapfrog"]), "stiffness"),
          "muscles, xpbd": (lambda: muscled(**PULLED["xpbd"]), "stiffness"),
          "muscles, newton": (lambda: muscled(**PULLED["newton"]), "stiffness")}


@pytest.mark.parametrize("key", SCENES)
def test_gradients_by_reactions_agree(key):
    """And twice on a GPU they are the same, to the bit but for sheets and wind, whose adjoints (Warp's) add by atomics."""
    make, name = SCENES[key]
    found, forces = [], []
    for device in ("cpu", "cuda:0", "cuda:0"):
        recording = Recording(Simulation(make(), device=device, precision="float64", gradients=True), 2)
        path = recording.sim.scene.pins[0].path
        forces.append(recording.reactions(2, path))
        r = np.random.default_rng(2).normal(size=(2, *forces[0].shape))
        g = recording.backward({2: recording.positions(0)}, reactions={1: {path: r[0]}, 2: {path: r[1]}})
        found.append([g.positions(), g.velocities(), g.masses(), g.gravity(), g.material(name),
                      *([g.actuation()] if recording.plan.method("muscles") else []),
                      *([g.wind()] if recording.plan.method("aero") else [])])
    assert np.abs(forces[1] - forces[0]).max() < 1e-9 * np.abs(forces[0]).max()
    for a, b, c in zip(*found, strict=True):
        assert np.abs(np.subtract(b, a)).max() < 1e-7 * np.abs(a).max()
        assert np.abs(np.subtract(c, b)).max() <= (1e-9 * np.abs(b).max() if key.startswith(("sheet", "wind")) else 0.0)
