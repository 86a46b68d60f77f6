"""A smoothed contact is a potential: it knows no substep, keeps energy to the integrator's order, becomes the hard one."""

import numpy as np
import pytest

from tests.make.physics.contact.restitution import G, ball
from wsim.physics.contact.barrier import contact_energy_scale
from wsim.scene import SceneError
from wsim.scene.check.scene import check_scene
from wsim.simulation.simulation import Simulation

FALL = 0.1             # [m]


def flown(substeps: int, width: float = 0.02, frames: int = 30, **more) -> tuple[np.ndarray, np.ndarray]:
    """Heights and energies over those at the start, after each frame."""
    scene = ball(e=0.0, height=FALL, substeps=substeps, frames=frames, contact_width=width, **more)
    sim, found = Simulation(scene, device="cpu", precision="float64"), []
    for _ in range(frames):
        sim.step()
        y, v = sim.positions()[0, 1], sim.velocities()[0]
        found.append((y / FALL, (0.5 * v @ v + G * y) / (G * FALL)))
    damps = ["steps of solver xpbd damp" in w for w in sim.warnings]
    assert sim.plan.clock.substeps == substeps and damps == [True] * (scene.solver == "xpbd")
    return tuple(np.transpose(found))


def test_a_ball_that_bounces_keeps_its_energy_to_order_two():
    """Under leapfrog; two bounces of 1/12 s in the width each."""
    runs = {n: flown(n) for n in (40, 80, 160)}
    ends = [y[-1] for y, _ in runs.values()]
    assert (ends[0] - ends[1]) / (ends[1] - ends[2]) == pytest.approx(4.0, rel=0.1)
    for n, (_, e) in runs.items():
        assert abs(e[-1] - 1.0) < 3e-6 * (40.0 / n)**2           # of 40 substeps 1.8e-6
    assert max(y.max() for y, _ in runs.values()) < 1.0          # a force that grew as 1 / h^2 threw it 160 m high


def test_sweeps_lose_energy_by_their_own_damping_and_gain_none():
    """Backward Euler, order one: the loss halves with the substep; steps that do not resolve the width are stable."""
    loss = [1.0 - flown(n, solver="xpbd", integrator="backward_euler")[1][-1] for n in (40, 80, 160)]
    assert loss[0] / loss[1] == pytest.approx(1.75, abs=0.3) and loss[1] / loss[2] == pytest.approx(2.0, abs=0.2)
    y, e = flown(4, 1e-4, solver="xpbd", integrator="backward_euler")
    assert y.max() < 1.0 and e.max() < 1.0 + 1e-9


def test_a_width_that_goes_to_0_is_the_bounce_that_gives_back_all():
    """A flight up and down again, and the next one: what the width takes of the height goes with it."""
    exact = Simulation(ball(e=1.0, height=FALL, substeps=40), device="cpu", precision="float64")
    exact.run(12)
    away = [abs(flown(n, w, 12)[0][-1] * FALL - exact.positions()[0, 1]) for n, w in ((40, 0.02), (80, 0.01), (160, 0.005))]
    assert away[1] < 0.6 * away[0] and away[2] < 0.6 * away[1] and away[2] < 0.1 * FALL


def test_steps_too_long_for_the_width_and_a_restitution_are_refused():
    scene = ball(e=0.0, height=FALL, substeps=4, contact_width=0.002)
    with pytest.raises(SceneError, match="leapfrog is stable for .* give --substeps"):
        Simulation(scene, device="cpu")
    scene.integrator = "auto"
    sim = Simulation(scene, device="cpu")
    omega = (6.0 * contact_energy_scale(scene)) **0.5 / 0.002
    assert sim.plan.clock.dt / sim.plan.clock.substeps < 2.0 / omega
    scene.colliders[0].restitution = 0.5
    assert [p.path for p in check_scene(scene) if p.fatal and "gives back all energy" in p.text] == ["/floor"]
