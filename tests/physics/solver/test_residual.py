"""Residuals of Newton's method: of what flies freely there is none, rounding is no miss; of what is loaded it is told."""

import numpy as np
import pytest

from wsim.scene import Scene, shapes
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation


@pytest.mark.parametrize("integrator", ["bdf2", "implicit_midpoint"])
def test_a_cloth_that_flies_without_a_force_keeps_its_integrator(integrator):
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=60.0, solver="implicit", integrator=integrator, substeps=4, iterations=1)
    points, counts, indices = shapes.sheet(1.0, 1.0, 8, 8)
    scene.cloth("/cloth", points, counts, indices, material=Fabric(stretch=1e4, shear=3e3, bend=1e-4),
                velocities=np.tile((3.0, 1.0, -2.0), (len(points), 1)))
    sim = Simulation(scene, device="cpu")
    sim.run(5)
    found = sim.report(profile=False)["error"]
    assert sim.plan.integrator == integrator and found["residual"] == 0.0


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("integrator", ["backward_euler", "bdf2"])
def test_a_small_cloth_that_flies_about_the_origin_has_no_residual(integrator, precision):
    """Its forces are those of rounded places, beyond what masses bound, and so is what they are compared with."""
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=60.0, solver="implicit", integrator=integrator, substeps=4, iterations=4)
    points, counts, indices = shapes.sheet(0.2, 0.2, 8, 8, horizontal=True)
    scene.cloth("/cloth", points, counts, indices, material=Fabric(stretch=1e3, bend=1e-4),
                velocities=np.tile((1.0, 0.5, -0.2), (len(points), 1)))
    sim = Simulation(scene, device="cpu", precision=precision)
    sim.run(6)
    assert sim.plan.integrator == integrator and sim.indicators()["residual"] == 0.0 and not sim.warnings


def test_a_stiff_chain_that_hangs_in_a_bow_has_a_residual():
    """One Newton step a system of 1e7 N/m, whose last steps would be within rounding of each place, but not their sum."""
    scene = Scene(fps=60.0, solver="implicit", integrator="bdf2", substeps=4, iterations=1)
    points, springs = [[0.1 * i, 0.0, 0.0] for i in range(200)], [[i, i + 1] for i in range(199)]
    net = scene.net("/net", points, springs, [1e7] * 199, [0.01] * 200)
    scene.pin("/pin", net, [0])
    sim = Simulation(scene, device="cpu")
    sim.run(4)
    assert sim.report(profile=False)["error"]["residual"] > 0.1 and sim.plan.integrator == "backward_euler"
