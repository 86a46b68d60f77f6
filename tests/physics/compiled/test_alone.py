"""What the tests compile in parts has the bits of the modules that a simulation compiles whole."""

import numpy as np
import pytest
import warp as wp

from tests.make.suite import alone
from wsim.gradient.recording import Recording
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


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["xpbd", "explicit"])
def test_a_gradient_has_the_bits_of_whole_modules(scene, monkeypatch, solver):
    """Of a cloth that slides down a ball, whose adjoints call `wp.grad`."""
    scene.pins.clear()
    scene.solver, scene.gravity = solver, (3.0, -9.0, 0.0)
    scene.collider("/ball", Sphere(0.3), at=(0.5, -0.31, 0.5), static_friction=0.3, dynamic_friction=0.3)
    found = []
    for whole in ([], [True]):
        monkeypatch.setattr(alone, "WHOLE", whole)
        r = Recording(Simulation(scene, device="cpu", precision="float64", gradients=True), 6)
        r.run()
        gradient = r.backward({6: np.ones((16, 3))})
        found.append([gradient.value("/cloth", "positions"), gradient.value("/ball", "dynamic_friction"),
                      gradient.value("/cloth", "density")])
        for module in (wp.get_module(name) for name in (r.sim.model.module, *r.sim.model.modules)):
            module.unload()
    assert abs(found[0][1]) > 0.0
    assert all(np.array_equal(a, b) for a, b in zip(*found, strict=True))
