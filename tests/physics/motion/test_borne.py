"""Named explicit steps between the limit at rest and the bound: tension makes nets stiffer, and steps follow it."""

import numpy as np
import pytest

from tests.conftest import first_and_slow
from tests.make.physics.rods.bodies import box
from wsim.physics.motion.stability import MARGIN, stable_stretch
from wsim.scene import Pin, Scene, SceneError, shapes
from wsim.scene.fabric import Fabric
from wsim.scene.integrator import TABLE
from wsim.simulation.simulation import Simulation

REST, BOUND = 40, 58           # substeps that are not refused, and those of the bound


def loaded(substeps: int, mass: float = 2.0) -> Scene:
    """A square cloth by its corners, and a box that falls on it."""
    scene, n = Scene(gravity=(0.0, -9.81, 0.0), fps=60.0, substeps=substeps, solver="explicit", integrator="leapfrog"), 14
    points, counts, indices = shapes.sheet(0.5, 0.5, n, n, horizontal=True)
    points = np.array(points) - np.mean(points, axis=0)
    fabric = Fabric(stretch=2000.0, shear=500.0, bend=1e-5, thickness=2e-3, density=200.0)
    scene.cloth("/cloth", points, counts, indices, material=fabric)
    scene.pins.append(Pin("/pin", "/cloth", [0, n, (n + 1) * n, (n + 1)**2 - 1]))
    box(scene, "/box", (0.06, 0.06, 0.06), (0.0, 0.07, 0.0), mass=mass)
    return scene


def energy(sim: Simulation) -> float:
    """Of the cloth and the box [J]."""
    told = sim.indicators()
    return told["energy"] + told["rigid_energy"]


def test_a_cloth_that_a_box_stretches_gains_no_energy_by_leapfrog():
    """Contacts, friction and damping take some; by 40 substeps it had four times as much after 16 frames, then 1e21 J."""
    sim = Simulation(loaded(REST))
    sim.step()
    start = energy(sim)
    for _ in range(29):
        sim.step()
        assert energy(sim) < 1.005 * start
    assert sim.plan.clock.substeps == BOUND and len(sim.warnings) == 1
    assert "an edge of /cloth is 1.01 times as long as at rest, and tension makes it stiffer" in sim.warnings[0]
    assert sim.warnings[0].endswith(f"repeated with {BOUND}, which stay; give --substeps {BOUND}")


@pytest.mark.parametrize("substeps, mass", first_and_slow([(BOUND, 2.0), (52, 2.0), (45, 0.1)]))
def test_steps_that_bear_what_an_edge_is_stretched_by_stay(substeps, mass):
    """By 0.6, 0.6 and 0.1 of its length."""
    sim = Simulation(loaded(substeps, mass))
    sim.run(16)
    assert sim.plan.clock.substeps == substeps and not sim.warnings


@pytest.mark.parametrize("ratio", [1.1, 1.2])
def test_leapfrog_bears_as_much_tension_as_is_left_of_its_limit(ratio):
    """h omega = 2 / ratio at rest, and omega^2 grows by 2 - 1 / s, without the margin: s = 1 / (2 - ratio^2)."""
    scene, omega = Scene(fps=60.0, substeps=50, solver="explicit", integrator="leapfrog"), 2.0 * 60.0 * 50 / ratio / MARGIN
    assert stable_stretch(scene, TABLE["leapfrog"], omega, 0.0, 60) == pytest.approx(1.0 / (2.0 - ratio**2), rel=5e-3)
    assert stable_stretch(scene, TABLE["leapfrog"], omega * ratio / 1.3, 0.0, 60) == 2.0


def test_tension_adds_as_much_to_a_square_net_as_is_said():
    """Springs, stretched by 1.5 both ways and held by their border: the highest eigenvalue of M^-1 K."""
    n, k, m, s = 21, 100.0, 0.01, 1.5
    ids = np.arange(n * n).reshape(n, n)
    edges = [(np.stack([ids[:-1], ids[1:]], axis=2).reshape(-1, 2), (1.0, 0.0)),
             (np.stack([ids[:, :-1], ids[:, 1:]], axis=2).reshape(-1, 2), (0.0, 1.0))]
    free = np.add.outer(2 * ids[1:-1, 1:-1].ravel(), [0, 1]).ravel()

    def top(stretch: float) -> float:
        K = np.zeros((2 * n * n, 2 * n * n))
        for pairs, along in edges:
            each = k * (np.outer(along, along) + (1.0 - 1.0 / stretch) * (np.eye(2) - np.outer(along, along)))
            for a, b in pairs:
                for i, j, sign in ((a, a, 1), (b, b, 1), (a, b, -1), (b, a, -1)):
                    K[2 * i:2 * i + 2, 2 * j:2 * j + 2] += sign * each
        return float(np.linalg.eigvalsh(K[np.ix_(free, free)] / m).max())
    assert top(s) == pytest.approx((2.0 - 1.0 / s) * top(1.0), rel=1e-9)


def test_steps_that_are_certain_to_grow_at_rest_are_refused():
    with pytest.raises(SceneError, match=f"leapfrog is stable for .* give --substeps {BOUND} "):
        Simulation(loaded(REST - 1))
