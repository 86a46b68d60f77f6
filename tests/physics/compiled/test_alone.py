"""What the tests compile in parts has the bits of the modules that a simulation compiles whole."""

import numpy as np
import pytest
import warp as wp

from tests.make.suite import alone
from wsim.scene import Sphere
from wsim.simulation.simulation import Simulation


@pytest.mark.parametrize("solver, precision", [("xpbd", "float32"), ("implicit", "float64")])
def test_a_whole_module_has_the_bits_of_its_parts(scene, monkeypatch, solver, precision):
    """A cloth that falls on a ball."""
    scene.pins.clear()
    scene.solver = solver
    scene.collider("/ball", Sphere(0.3), at=(0.5, -0.31, 0.5))
    ends = []
    for whole in ([], [True]):
        monkeypatch.setattr(alone, "WHOLE", whole)
        sim = Simulation(scene, device="cpu", precision=precision)
        modules = [wp.get_module(name) for name in (sim.model.module, *sim.model.modules)]
        sim.run(2)
        assert sim.indicators()["contacts"] > 0
        made = [e for m in modules if len(m.kernels) > 1 for e in m.execs.values()]
        assert made and all(isinstance(e, alone.Parts) != bool(whole) for e in made)
        ends.append((sim.positions(), sim.velocities()))
        for module in modules:
            module.unload()
    assert np.array_equal(*[e[0] for e in ends]) and np.array_equal(*[e[1] for e in ends])
