"""Slender triangles in XPBD: sweeps leave a seam that carries a cloth the strain that
`wsim.simulation.predicted.sweep_strain` says, no
seam tears, and `auto` takes as many substeps as that asks for."""

from dataclasses import replace

import numpy as np
import pytest

from wsim.scene import Capsule, Scene
from wsim.scene.curve import Motion
from wsim.scene.fabric import Fabric, fabric
from wsim.scene.shapes import sheet
from wsim.simulation.predicted import errors, sweep_strain
from wsim.simulation.simulation import Simulation

STIFF = Fabric(stretch=1e6, shear=1e6, bend=0.0, density=400.0, thickness=5e-4)        # all strain is what sweeps leave


def hung(seam: float, substeps: int, iterations: int) -> Scene:
    """A square of 40 cm that a pinned edge holds; 5 cm below it a row of cells that is `seam` [m] high."""
    scene = Scene(fps=24.0, frames=24, substeps=substeps, iterations=iterations, solver="xpbd", integrator="backward_euler",
                  air_drag=8.0)
    points, counts, indices = sheet(0.4, 1.0, 8, 9)
    rows = -np.array([0.0, 0.05, 0.05 + seam, *np.linspace(0.1, 0.4, 7)])
    points[:, 1] = np.repeat(rows, 9)
    scene.pin("/pin", scene.cloth("/cloth", points, counts, indices, material=STIFF), range(9))
    return scene


def left(seam: float, substeps: int, iterations: int) -> tuple[float, float]:
    """Largest strain at rest, and what is expected."""
    sim = Simulation(hung(seam, substeps, iterations), device="cpu", precision="float64")
    sim.run()
    lag = sweep_strain.sweep_lag(sim.model, errors.falling_bodies(sim.model))
    return sim.indicators()["max_strain"], lag / (24.0 * substeps)**2 / iterations


def test_sweeps_leave_a_seam_the_strain_of_the_weight_below_it():
    """C = F h^2 (w0 + w1) over the seam's height. An edge is swept with each of its two triangles: half of that at least."""
    (coarse, said), (fine, _), (narrow, more), (swept, less) = (
        left(5e-3, 40, 1), left(5e-3, 80, 1), left(2.5e-3, 80, 1), left(5e-3, 80, 4))
    assert coarse / fine == pytest.approx(4.0, rel=0.05)                                # h^2, but for what the material gives
    assert narrow / fine == pytest.approx(2.0, rel=0.1)
    assert 0.5 < coarse / said < 1.0 and 0.5 < narrow / more < 1.0 and 0.25 < swept / less < 1.0


def draped(seam: float, **how) -> Scene:
    """Cotton over a bar, which friction holds there; on either side a seam."""
    scene = Scene(fps=24.0, frames=24, air_drag=2.0, **how)
    points, counts, indices = sheet(0.5, 1.0, 8, 14, horizontal=True, at=(0.0, 0.115, 0.0))
    rows = np.linspace(-0.5, 0.5, 15)
    rows[[5, 9]] = rows[4] + seam, rows[10] - seam
    points[:, 2] = np.repeat(rows, 9)
    cotton = replace(fabric("cotton"), static_friction=0.5, dynamic_friction=0.5)
    scene.cloth("/cloth", points, counts, indices, material=cotton)
    turn = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    scene.collider("/bar", Capsule(0.1, 0.4), motion=Motion.still(turn), static_friction=0.5, dynamic_friction=0.5)
    return scene


@pytest.mark.parametrize("substeps, iterations", [(65, 1), (16, 4)])
def test_no_seam_tears_where_triangles_of_1_to_62_carry_a_cloth(substeps, iterations):
    """Its edges lag by 0.1 and 0.4 of their length. 250 and 2000 where sweeps stretched needles by a bounded step."""
    sim = Simulation(draped(1e-3, substeps=substeps, iterations=iterations, solver="xpbd"), device="cpu")
    worst = []
    sim.run(24, lambda s: worst.append(s.indicators()["max_strain"]))
    assert max(worst) < 10.0 * sweep_strain.sweep_lag(sim.model,
                                                      errors.falling_bodies(sim.model)) / (24.0 * substeps)**2 / iterations


def test_auto_takes_the_substeps_that_a_seam_needs():
    """A millimetre: with the substeps that its motion alone needs, the seam is strained by more than `auto` lets sweeps leave
    there, ten times the wanted error of 1 %."""
    sim = Simulation(replace(hung(1e-3, 10, 1), solver="auto", integrator="auto"), device="cpu")
    lag, n, why = (sweep_strain.sweep_lag(sim.model, errors.falling_bodies(sim.model)), sim.plan.choice.substeps,
                   sim.plan.choice.why)
    assert sim.plan.choice.solver == "xpbd" and lag / (24.0 * n)**2 <= 0.1 < lag / (24.0 * n / 1.04)**2
    before = Simulation(hung(1e-3, int(why.split(" (")[-1].split()[0]), 1), device="cpu")
    for run in (sim, before):
        run.run(24)
    assert sim.indicators()["max_strain"] < 0.1 and before.indicators()["max_strain"] > 0.1, why


def test_a_cloth_of_even_cells_takes_no_more_substeps_than_its_motion_needs():
    """A hundred times as stiff as cotton, for which leapfrog costs more than sweeps."""
    scene, cotton = Scene(fps=24.0, substeps=10), fabric("cotton")
    stiff = replace(cotton, stretch=100.0 * cotton.stretch, shear=100.0 * cotton.shear)
    scene.pin("/pin", scene.cloth("/cloth", *sheet(1.0, 1.0, 32, 32), material=stiff), range(33))
    sim = Simulation(scene, device="cpu")
    lag = sweep_strain.sweep_lag(sim.model, errors.falling_bodies(sim.model))
    assert sim.plan.choice.solver == "xpbd" and "in its edges" not in sim.plan.choice.why
    assert lag == pytest.approx(3.5 * 9.81 * 32**2, rel=0.35)
