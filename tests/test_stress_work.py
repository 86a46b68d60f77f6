"""The work of the wind in the ledger of tools/stress: it closes the balance of energy; the judge sees what it did not give."""

import numpy as np
import pytest

from tests.test_aero import sheet
from tools.stress import examples, work
from wsim.curve import Curve, Motion
from wsim.scene import Load
from wsim.simulation import Simulation

DOUBLE = {"device": "cpu", "precision": "float64"}
FRAMES = 12


def flag(**more):
    """A square of 0.8 m, held along an edge, under a wind of 4 m/s that makes it flap."""
    settings = {"solver": "explicit", "integrator": "leapfrog", "substeps": 40, "fps": 24.0, "drag": 0.3, "lift": 3.0}
    scene = sheet((4.0, 0.3, 0.5), area_density=0.2, cells=6, **settings | more)
    cloth = scene.cloths[0]
    scene.pin("/rope", "/cloth", np.flatnonzero(cloth.points[:, 0] < cloth.points[:, 0].min() + 1e-3))
    return scene


def run(scene) -> examples.Example:
    found = examples.run("flag", f"{scene.solver}/{scene.integrator}", scene, FRAMES, "cpu", "float64")
    assert not (found.refusal or found.broke), found
    return found


@pytest.mark.parametrize("tilt", [0.0, 1.2])
def test_forces_are_those_of_the_engine(tilt):
    """Of a sheet that moves, with drag and lift, at its first prediction."""
    sim = Simulation(sheet((3.0, 1.0, -0.5), tilt=tilt, velocity=(0.5, -0.2, 0.1), drag=1.1, lift=0.7), **DOUBLE)
    aero, wind = sim.plan.method("aero"), work.wind_of(sim)
    sim.plan.method("points").predict(sim.plan.clock)
    aero.launch(sim.plan.clock)
    by_triangle, drag = aero.force.numpy(), aero.k.numpy()
    F, k = wind.forces(work.Work(sim).places(), np.tile((0.5, -0.2, 0.1), (sim.model.points, 1)))
    np.testing.assert_allclose(F.sum(axis=0), 3.0 * by_triangle.sum(axis=0), rtol=1e-6)
    np.testing.assert_allclose(k.sum(), 3.0 * drag.sum(), rtol=1e-6)


def test_wind_gives_a_sheet_that_it_carries_its_kinetic_energy():
    """Nothing else acts: W is what the sheet has, but for the impulse's own half, m dv^2 / 2 of a substep, which h bounds."""
    gaps = []
    for substeps in (20, 40):
        scene = sheet((0.0, 5.0, 0.0), drag=1.2, solver="explicit", integrator="leapfrog", substeps=substeps)
        found = run(scene)
        assert found.kinetic[-1] > 0.1 and found.wind == found.turned
        gaps.append(abs(found.wind - found.kinetic[-1]) / found.kinetic[-1])
    assert gaps[0] < 0.1 and gaps[1] == pytest.approx(0.5 * gaps[0], rel=0.2)


def test_the_work_is_a_bound_that_closes_with_the_step():
    """Leapfrog dissipates nothing: the energy less the work is never above the start, and below it by the first order of h by
    which W exceeds the work along the way."""
    gaps = []
    for substeps in (40, 80):
        found = run(flag(substeps=substeps))
        assert max(found.kinetic) > 0.1 and max(found.energy[1:]) < found.start
        assert examples.judge(found, found).held
        gaps.append((found.start - found.energy[-1]) / found.turned)
    assert gaps[0] < examples.COUNTED and gaps[1] == pytest.approx(0.5 * gaps[0], rel=0.1)


class Doubled(Simulation):
    """Twice the wind's forces."""

    def __init__(self, *arguments, **more):
        super().__init__(*arguments, **more)
        for name in ("drag", "lift"):
            array = getattr(self.plan.method("aero").air, name)
            array.assign(2.0 * array.numpy())


class Pushed(Simulation):
    """Kinetic energy grows by 4 % a frame."""

    def step(self):
        super().step()
        self.set("/cloth", "velocities", 1.02 * self.velocities())


@pytest.mark.parametrize("kind", [Doubled, Pushed])
def test_energy_that_the_wind_did_not_give_is_seen(kind, monkeypatch):
    monkeypatch.setattr(examples, "Simulation", kind)
    found = run(flag())
    verdict = examples.judge(found, found)
    assert not verdict.held and "gains" in verdict.text


def test_what_is_not_counted_is_said():
    scene = flag()
    assert work.uncounted(scene, 24) == ""
    scene.pins[0].motion = Motion(np.array([0.0, 2.0]), np.array([np.eye(4), np.diag([2.0, 1.0, 1.0, 1.0])]))
    assert work.uncounted(scene, 24) == "/rope moves"
    scene.loads.append(Load("/push", "/cloth", Curve(np.zeros(1), np.ones((1, 3)))))
    assert work.uncounted(scene, 24) == "/rope moves, load /push"


def test_air_at_rest_is_not_followed():
    """It only takes energy: the run stays as it is, from its graph."""
    sim = Simulation(sheet(drag=1.0), **DOUBLE)
    assert work.Work(sim).wind is None and "_replay" not in vars(sim)
