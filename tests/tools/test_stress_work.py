"""The work of wind and pins in the ledger of tools/stress closes its balance; the judge sees what they did not give."""

import numpy as np
import pytest

from tests.conftest import first_and_slow
from tests.make.physics.cloth.air import sheet
from tools.stress import examples, work
from wsim.scene import Load, Sphere
from wsim.scene.curve import Curve, Motion
from wsim.simulation.simulation import Simulation

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
    F, k = wind.forces(work.Work(sim, 1).places(), np.tile((0.5, -0.2, 0.1), (sim.model.points, 1)))
    np.testing.assert_allclose(F.sum(axis=0), 3.0 * by_triangle.sum(axis=0), rtol=1e-6)
    np.testing.assert_allclose(k.sum(), 3.0 * drag.sum(), rtol=1e-6)


def test_wind_gives_a_sheet_that_it_carries_its_kinetic_energy():
    """Nothing else acts: W is what the sheet has, to the order of leapfrog."""
    gaps = []
    for substeps in (20, 40):
        scene = sheet((0.0, 5.0, 0.0), drag=1.2, solver="explicit", integrator="leapfrog", substeps=substeps)
        found = run(scene)
        assert found.kinetic[-1] > 0.1 and found.work == found.turned
        gaps.append(abs(found.work - found.kinetic[-1]) / found.kinetic[-1])
    assert gaps[0] < 1e-3 and gaps[1] == pytest.approx(0.25 * gaps[0], rel=0.2)


def test_the_balance_of_energy_and_work_closes_with_the_step():
    """Leapfrog dissipates nothing: the energy less the work stays what it was, to order 2."""
    gaps = []
    for substeps in (80, 160):
        found = run(flag(substeps=substeps))
        assert max(found.kinetic) > 0.1 and examples.judge(found, found).held
        gaps.append(np.abs(np.subtract(found.energy, found.start)).max() / found.turned)
    assert gaps[0] < 1e-3 and gaps[1] == pytest.approx(0.25 * gaps[0], rel=0.1)


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


def turning(t: float) -> np.ndarray:
    """Goes to and fro, and turns about y."""
    a, M = 0.5 * (1.0 - np.cos(4.0 * t)), np.eye(4)
    M[0, 0], M[0, 2], M[2, 0], M[2, 2] = np.cos(a), np.sin(a), -np.sin(a), np.cos(a)
    M[:3, 3] = 0.3 * (1.0 - np.cos(5.0 * t)), 0.1 * np.sin(3.0 * t)**2, 0.0
    return M


def swung(**more):
    """The flag in air at rest under gravity, at a pin that moves."""
    scene, times = flag(gravity=(0.0, -9.81, 0.0), **more), np.linspace(0.0, 1.0, 241)
    scene.wind = (0.0, 0.0, 0.0)
    scene.pins[0].motion = Motion(times, np.array([turning(t) for t in times]))
    return scene


def test_what_carries_the_scene_gives_what_leapfrog_has():
    """With next to no drag; the error is of the first order of h. Gravity's work is as large as that of the pin."""
    gaps = []
    for substeps in (40, 160):
        scene = swung(substeps=substeps, drag=1e-6, lift=0.0)
        found = run(scene)
        assert found.work > 0.1 and not found.besides and examples.judge(found, found).held
        gaps.append(np.abs(np.array(found.energy) - found.start).max() / found.turned)
    assert gaps[0] < 0.005 and gaps[1] < 0.5 * gaps[0]


@pytest.mark.parametrize("solver, integrator", first_and_slow([("xpbd", "backward_euler"), ("implicit", "bdf2"),
                                                              ("implicit", "backward_euler")]))
def test_what_carries_the_scene_bounds_what_others_have(solver, integrator):
    found = run(swung(solver=solver, integrator=integrator, substeps=10, iterations=4))
    assert found.work > 0.1 and not found.besides and examples.judge(found, found).held


def test_a_scene_that_is_pushed_while_it_is_carried_is_seen(monkeypatch):
    monkeypatch.setattr(examples, "Simulation", Pushed)
    found = run(swung(drag=1e-6, lift=0.0))
    assert "gains" in examples.judge(found, found).text


def test_what_is_not_counted_is_said():
    scene = flag()
    assert work.uncounted(scene, 24, False) == "" and work.carried(scene, 24) is None
    scene.pins[0].motion = Motion(np.array([0.0, 2.0]), np.array([np.eye(4), np.diag([2.0, 1.0, 1.0, 1.0])]))
    assert work.uncounted(scene, 24, False) == "/rope moves" and work.carried(scene, 24) is None       # it stretches
    scene.loads.append(Load("/push", "/cloth", Curve(np.zeros(1), np.ones((1, 3)))))
    assert work.uncounted(scene, 24, False) == "/rope moves, load /push"


def test_motions_that_differ_carry_nothing():
    scene = swung()
    assert work.carried(scene, 24) is scene.pins[0].motion
    scene.collider("/floor", Sphere(0.1), motion=Motion.at_place((0.0, -5.0, 0.0)))
    assert work.carried(scene, 24) is None
    scene.colliders[0].motion = scene.pins[0].motion
    assert work.carried(scene, 24) is not None


def test_air_at_rest_is_not_followed():
    """It only takes energy: the run stays as it is, from its graph."""
    sim = Simulation(sheet(drag=1.0), **DOUBLE)
    assert not work.Work(sim, 1).blows and "_replay" not in vars(sim)
