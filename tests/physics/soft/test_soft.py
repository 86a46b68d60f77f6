"""Soft bodies as scenes: rest, frequency, free spin, scrambles, contacts, company; against theory and a reference."""

import numpy as np
import pytest

from tests.make.physics.soft.soft_bar import NU, RHO, E, bar, given_way, ran, settled, spin
from wsim import Bulk, Fabric, Plane, Scene, Simulation
from wsim.scene import shapes
from wsim.scene.curve import Motion

# rest

@pytest.mark.parametrize("model, precision, bound", [("corotational", "float64", 3e-8), ("neo_hookean", "float32", 1e-5),
                                                     ("corotational", "float32", 1e-5)])
def test_the_rest_is_that_of_an_independent_reference(model, precision, bound):
    """The same mesh, solved to 1e-12 by SciPy with energies of its own. The tip hangs 0.1 m low and more."""
    pytest.importorskip("scipy")
    from tools.bench.soft.reference import Solid, rest
    scene = bar(model=model)
    soft = scene.softs[0]
    solid = Solid(soft.points.astype(np.float64), soft.tets, scene.pins[0].points, E, NU, RHO, model)
    sim = settled(scene, precision=precision)
    wanted = rest(solid)
    assert np.abs(wanted - soft.points).max() > 0.1
    assert np.abs(sim.positions() - wanted).max() < bound


def hanging(which=None, others=(), filled=None, young=E) -> float:
    """How far the lower end of a bar of nu = 0, 0.8 m long, comes down under 1/8 m/s^2 [m]."""
    scene = bar(size=(0.1, 0.1, 0.8), cells=(1, 1, 8), held=False, gravity=(0.0, 0.0, -0.125), bulk=Bulk(young, 0.0, RHO))
    soft = scene.softs[0]
    soft.which, soft.others, soft.filled = which, list(others), filled
    scene.pin("/ceiling", soft, np.flatnonzero(soft.points[:, 2] > 0.39999))
    sim, low = settled(scene, precision="float64"), soft.points[:, 2] < -0.39999
    return float((soft.points[:, 2] - sim.positions()[:, 2])[low].mean())


def test_youngs_modulus_is_what_the_author_wrote():
    """Uniform tension: rho g L^2 / 2 E; the corners of a cell have unequal masses."""
    assert hanging() == pytest.approx(0.125 * RHO * 0.8**2 / (2.0 * E), rel=2e-3)


def test_tets_have_the_materials_that_which_names():
    """The upper half four times as stiff: its own weight, and that of the lower half, stretch it a quarter as far."""
    upper = shapes.block((0.1, 0.1, 0.8), (1, 1, 8))
    middle = upper[0][upper[1]].mean(axis=1)[:, 2] > 0.0
    whole = 0.125 * RHO * 0.4**2 / (2.0 * E)          # of a half by its own weight: the upper one carries three times that
    assert hanging(middle.astype(np.int32), [Bulk(4.0 * E, 0.0, RHO)]) == pytest.approx(whole + 3.0 * whole / 4.0, rel=2e-3)


def test_tets_that_are_half_body_have_half_the_mass_and_half_the_stiffness():
    count = len(shapes.block((0.1, 0.1, 0.8), (1, 1, 8))[1])
    assert hanging(filled=np.full(count, 0.5)) == pytest.approx(hanging(), rel=1e-9)


# motion

def swinging(young: float, far: float, precision: str = "float32", **more):
    """A bar without weight that begins `far` [m] along its first mode; the mode's frequency [Hz]; a function of a simulation:
    what is left of that, 1 at the start."""
    pytest.importorskip("scipy")
    from tools.bench.soft.reference import Solid, frequencies
    scene = bar(substeps=1, gravity=(0, 0, 0), bulk=Bulk(young, NU, RHO), **more)
    soft = scene.softs[0]
    solid = Solid(soft.points.astype(np.float64), soft.tets, scene.pins[0].points, young, NU, RHO, gravity=(0.0, 0.0, 0.0))
    hertz, shapes_ = frequencies(solid)
    mode = far * shapes_[0].reshape(-1, 3) / np.abs(shapes_[0]).max()
    weights = solid.masses[:, None] * mode / np.sum(solid.masses[:, None] * mode**2)
    sim = Simulation(scene, device="cpu", precision=precision)
    sim.set("/bar", "positions", solid.points + mode)
    return sim, float(hertz[0]), lambda s: float(np.sum(weights * (s.positions() - solid.points)))


def test_the_first_frequency_is_that_of_the_mesh():
    """Midpoint turns a mode by 2 atan(w h / 2) a step: a quarter of a period at frame-size steps, to 0.1 % of the amplitude."""
    sim, hertz, left = swinging(2e4, 1e-4, "float64", integrator="implicit_midpoint", iterations=4)
    omega = 2.0 * np.pi * hertz
    steps = round(np.pi / 2.0 / omega * 60.0)
    sim.run(steps)
    assert steps > 5 and not given_way(sim)
    assert left(sim) == pytest.approx(np.cos(steps * 2.0 * np.arctan(omega / 120.0)), abs=1e-3)


def test_a_step_of_a_frame_keeps_the_first_frequency_to_a_thousandth():
    """What Newton's method takes where the scene leaves it open, at 1/60 s and h omega = 0.16: 1.6 s of swinging, by Prony."""
    sim, hertz, left = swinging(2.4e5, 1e-3, integrator="auto", iterations=2)
    from tools.bench.soft.problem import oscillation
    q: list[float] = []
    sim.run(96, lambda s: q.append(left(s)))
    found, damping = oscillation(np.array(q), 1.0 / 60.0)
    assert 2.0 * np.pi * hertz / 60.0 > 0.15 and sim.plan.clock.steps == 1 and not given_way(sim)
    assert found == pytest.approx(hertz, rel=1e-3) and 0.0 < damping < 2e-3


@pytest.mark.parametrize("solver, integrator, substeps, bounds", [("implicit", "implicit_midpoint", 4, (1e-5, 1e-2)),
                                                                  ("explicit", "leapfrog", 40, (1e-5, 1e-3))])
def test_a_free_body_that_spins_keeps_its_momentum_and_energy(solver, integrator, substeps, bounds):
    """One second at 10 rad/s in float32."""
    scene = bar((4, 2, 2), (0.4, 0.2, 0.2), held=False, gravity=(0, 0, 0), solver=solver, integrator=integrator,
                substeps=substeps, iterations=4 if solver == "implicit" else 1)
    scene.softs[0].velocities = np.cross([3.0, 4.0, 8.0], scene.softs[0].points)
    sim = Simulation(scene, device="cpu")
    before, energy = spin(sim)
    sim.run(60)
    after, later = spin(sim)
    assert not given_way(sim)
    assert np.linalg.norm(after - before) < bounds[0] * np.linalg.norm(before) and abs(later / energy - 1.0) < bounds[1]


def test_explicit_and_implicit_steps_go_to_the_same_motion():
    """Leapfrog is of second order, and so is the midpoint: 1e-4 m at a quarter of a second of a fall by 0.15 m."""
    fast = ran(bar(solver="auto", integrator="auto"), 15)
    slow = ran(bar(integrator="implicit_midpoint", substeps=16, iterations=2), 15, precision="float64")
    assert fast.plan.choice.solver == "explicit" and "leapfrog" in fast.plan.choice.why
    assert np.sqrt(np.mean(np.sum((fast.positions() - slow.positions())**2, axis=1))) < 1e-4


def test_a_body_a_kilometre_away_moves_as_at_home():
    """float32: places relative to the body's own origin."""
    home = ran(bar(), 10)
    scene = bar()
    scene.softs[0].motion = Motion.at_place((1000.0, -2000.0, 500.0))
    away = ran(scene, 10)
    assert np.abs(away.positions() - (1000.0, -2000.0, 500.0) - home.positions()).max() < 1e-6


@pytest.mark.parametrize("solver", ["implicit", "explicit"])
def test_a_live_modulus_counts_from_the_next_frame_on(solver):
    more = {} if solver == "implicit" else {"solver": "explicit", "integrator": "leapfrog", "substeps": 30, "iterations": 1}
    soft, stiff = bar(**more), bar(bulk=Bulk(4.0 * E, NU, RHO), **more)
    sim = Simulation(soft, device="cpu")
    sim.set("/bar", "young", 4.0 * E)
    sim.run(5)
    np.testing.assert_allclose(sim.positions(), ran(stiff, 5).positions(), atol=1e-6)


def test_a_stiffer_live_modulus_takes_shorter_steps():
    """With the root of it: four times as many for sixteen times the stiffness."""
    sim = Simulation(bar(solver="explicit", integrator="auto", substeps=1), device="cpu")
    before = sim.plan.method("explicit").least()
    sim.set("/bar", "young", 16.0 * E)
    after = sim.plan.method("explicit").least()
    assert before > 2 and 4 * (before - 1) < after <= 4 * before
    assert sim.plan.clock.substeps == after


# abuse

def scrambled(points: np.ndarray, how: str) -> np.ndarray:
    free = points[:, :1] > points[:, 0].min() + 1e-6
    to = {"scrambled": np.random.default_rng(3).uniform(-0.3, 0.3, points.shape), "plane": points * (1.0, 0.0, 1.0),
          "point": np.zeros_like(points), "inside out": points * (-1.0, 1.0, 1.0)}[how]
    return np.where(free, to, points)


@pytest.mark.parametrize("model", ["corotational", "neo_hookean"])
@pytest.mark.parametrize("how", ["scrambled", "plane", "point", "inside out"])
def test_a_body_recovers_from_anything(model, how):
    """One face held: 5 s of backward Euler bring the rest shape back, within 1 mm of 0.4 m."""
    scene = bar((4, 2, 2), (0.4, 0.2, 0.2), model=model, gravity=(0, 0, 0), air_drag=5.0)
    sim = Simulation(scene, device="cpu")
    points = scene.softs[0].points.astype(np.float64)
    sim.set("/bar", "positions", scrambled(points, how))
    sim.run(300)
    assert np.abs(sim.positions() - points).max() < 1e-3


# company

def test_a_cube_lands_on_the_ground_and_stays():
    scene = bar((3, 3, 3), (0.3, 0.3, 0.3), held=False, integrator="auto", solver="auto", substeps=4,
                bulk=Bulk(E, NU, RHO, damping=0.01))
    scene.softs[0].motion = Motion.at_place((0.0, 0.3, 0.0))
    upright = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    scene.collider("/ground", Plane(), motion=Motion.still(upright))
    sim = ran(scene, 120)
    x = sim.positions()
    sag = RHO * 9.81 * 0.3**2 / (2.0 * E)                            # of a column under its own weight: 4.4 mm
    assert x[:, 1].min() > -1e-4 and x[:, 1].max() == pytest.approx(0.3 - sag, abs=0.5 * sag)
    assert np.abs(sim.velocities()).max() < 1e-2


def test_cloth_and_soft_bodies_and_worlds_share_a_scene():
    """Each as if it were alone: nothing couples them."""
    def both() -> Scene:
        scene = bar()
        cloth = scene.cloth("/cloth", *shapes.sheet(0.5, 0.5, 6, 6), material=Fabric())
        scene.pin("/nail", cloth, [0, 1])
        return scene
    sim = ran(both(), 5, worlds=2)
    np.testing.assert_allclose(sim.positions("/bar", 1), sim.positions("/bar", 0), atol=0)
    np.testing.assert_allclose(sim.positions("/bar"), ran(bar(), 5).positions(), atol=1e-6)


def test_a_restart_goes_on_bit_for_bit():
    scene = bar()
    whole = ran(scene, 6)
    first, second = ran(scene, 3), Simulation(scene, device="cpu")
    second.restart(3, {"/bar": first.fields("/bar")})
    second.run(3)
    assert np.array_equal(second.positions(), whole.positions())
