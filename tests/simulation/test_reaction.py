"""Forces of pins: a weight, the balance of momentum, every solver, what moves, what is refused."""

import numpy as np
import pytest

from wsim import Bulk, Curve, Fabric, Motion, Scene, SceneError, Simulation
from wsim.scene import shapes

SOLVERS = {"leapfrog": {"solver": "explicit", "integrator": "leapfrog", "substeps": 40},
           "rk4": {"solver": "explicit", "integrator": "rk4", "substeps": 30},
           "newton": {"solver": "implicit", "integrator": "backward_euler", "substeps": 1, "iterations": 8},
           "xpbd": {"solver": "xpbd", "integrator": "backward_euler", "substeps": 20, "iterations": 60}}
DAMPED = {"fps": 60.0, "air_drag": 8.0}
G = np.array([0.0, -9.81, 0.0])


def bar(**more) -> Scene:
    """1 kg in all, held at one end."""
    scene = Scene(**{"fps": 60.0, **more})
    points, tets = shapes.block((0.4, 0.1, 0.1), (4, 1, 1))
    body = scene.soft("/bar", points, tets, material=Bulk(2e5, 0.3, 250.0))
    scene.pin("/wall", body, np.flatnonzero(points[:, 0] < points[:, 0].min() + 1e-6))
    return scene


def sheet(**more) -> Scene:
    scene = Scene(**{"fps": 60.0, **more})
    cloth = scene.cloth("/sheet", *shapes.sheet(1.0, 1.0, 4, 4), mass=0.5,
                        material=Fabric(stretch=80.0, shear=30.0, bend=1e-3, thickness=1e-3))
    scene.pin("/left", cloth, [20])
    scene.pin("/right", cloth, [24])
    return scene


def chain(**more) -> Scene:
    scene = Scene(**{"fps": 60.0, **more})
    points = np.zeros((3, 3))
    points[:, 1] = (0.0, -0.3, -0.6)
    scene.pin("/pin", scene.net("/chain", points, [[0, 1], [1, 2]], [400.0], [0.1, 0.2, 0.7]), [0])
    return scene


def simulated(scene, frames, **more) -> Simulation:
    sim = Simulation(scene, device="cpu", precision="float64", **more)
    sim.run(frames)
    return sim


def momentum(sim: Simulation) -> np.ndarray:
    """Of all points that pins do not hold still [kg m/s]."""
    return (sim.model.stack("masses")[:, None] * sim.state.v.numpy()).sum(axis=0)


# what it is

@pytest.mark.parametrize("make, mass, solver", [*((chain, 1.0, name) for name in SOLVERS), (sheet, 0.5, "leapfrog"),
                                                (bar, 1.0, "newton")])
def test_what_hangs_at_rest_pulls_by_its_weight(make, mass, solver):
    sim = simulated(make(**DAMPED | SOLVERS[solver]), 120 if make is chain else 240)
    total = sum(sim.reactions(p.path).sum(axis=0) for p in sim.scene.pins)
    moving = np.abs(sim.state.v.numpy()).max()                        # what still swings, at up to 100 rad/s
    assert total == pytest.approx(-mass * G, abs=1e-6 + 100.0 * moving) and moving < 1e-4
    if make is sheet:                                                 # and hangs inwards between the two
        left, right = (sim.reactions(p)[0] for p in ("/left", "/right"))
        assert left[1] == pytest.approx(right[1], rel=0.05) and left[0] == pytest.approx(-right[0], rel=0.05)


def bent(**more) -> Scene:
    """A bar that flows."""
    scene = bar(**more)
    scene.softs[0].material = Bulk(2e5, 0.3, 250.0, yield_strain=1e-4)
    return scene


@pytest.mark.parametrize("make", [chain, sheet, bar, bent])
def test_reactions_are_what_momentum_lacks_by_leapfrog(make):
    """P(t + h) - P(t) = h / 2 (F(t) + F(t + h)), F of gravity and pins: to rounding, in any motion."""
    sim = Simulation(make(fps=4000.0, solver="explicit", integrator="leapfrog", substeps=1), device="cpu", precision="float64")
    weight = sim.model.stack("masses").sum() * G
    sim.run(200)
    assert make is not bent or sim.indicators()["plastic_strain"] > 1e-4
    for _ in range(3):
        before, force = momentum(sim), weight + sum(sim.reactions(p.path).sum(axis=0) for p in sim.scene.pins)
        sim.run(1)
        force = force + weight + sum(sim.reactions(p.path).sum(axis=0) for p in sim.scene.pins)
        assert momentum(sim) - before == pytest.approx(0.5 / 4000.0 * force, abs=1e-12)


@pytest.mark.parametrize("make", [chain, sheet, bar])
def test_reactions_are_what_momentum_lacks_by_newton_s_method(make):
    """P(t + h) - P(t) = h F(t + h) by backward Euler, with damping by the air; solved to 1e-13 with gradients."""
    sim = Simulation(make(fps=100.0, solver="implicit", integrator="backward_euler", substeps=1, iterations=20, air_drag=0.0),
                     device="cpu", precision="float64")
    sim.run(20)
    before = momentum(sim)
    sim.run(1)
    force = sim.model.stack("masses").sum() * G + sum(sim.reactions(p.path).sum(axis=0) for p in sim.scene.pins)
    assert momentum(sim) - before == pytest.approx(0.01 * force, abs=2e-6 * np.abs(force).max())


def test_muscles_pull_at_the_pin_from_the_moment_that_they_do():
    """k (r - f L) n of the spring that is held, f at that time."""
    scene = chain(**SOLVERS["leapfrog"])
    scene.springs[0].actuation = Curve(np.array([0.0, 0.05]), np.array([[1.2], [0.7]]))
    sim = Simulation(scene, device="cpu", precision="float64")
    for frame, factor in ((0, 1.2), (2, 1.2 - 0.5 * 2.0 / 3.0), (6, 0.7)):
        sim.run(frame - sim.frame)
        x = sim.positions()
        r = np.linalg.norm(x[1] - x[0])
        pull = -400.0 * (r - factor * 0.3) * (x[1] - x[0]) / r - 0.1 * G
        assert sim.reactions()[0] == pytest.approx(pull, abs=1e-4)


def test_a_soft_pin_pulls_as_its_spring_and_damper_do():
    """In motion: k (X - x) - c v. At rest the weight."""
    scene = chain(**DAMPED | SOLVERS["leapfrog"])
    scene.pins[0].stiffness, scene.pins[0].damping = 500.0, 2.0
    sim = simulated(scene, 3)
    x, v = sim.positions()[0], sim.velocities()[0]
    assert sim.reactions()[0] == pytest.approx(-500.0 * x - 2.0 * v, abs=1e-9) and np.abs(v).max() > 0.01
    sim.run(200)
    assert sim.reactions().sum(axis=0) == pytest.approx(-G, abs=0.1)


def test_a_pin_that_is_thrown_carries_what_it_takes():
    """All of a chain at rest in free air is accelerated with its pin: F = m a once nothing swings (0.2 g sideways)."""
    times = np.arange(0.0, 3.5, 1.0 / 2400.0)
    values = np.tile(np.eye(4), (len(times), 1, 1))
    values[:, 0, 3] = 0.5 * 2.0 * times**2
    scene = chain(**SOLVERS["leapfrog"], fps=60.0)
    points = np.zeros((3, 3))
    points[:, 0] = (0.0, -0.3, -0.6)
    scene.springs[0].points, scene.gravity = points.astype(np.float32), (0.0, 0.0, 0.0)
    scene.springs[0].damping, scene.pins[0].motion = 0.05, Motion(times, values)
    sim = simulated(scene, 180)
    assert sim.reactions()[0] == pytest.approx((2.0, 0.0, 0.0), abs=2e-2)


def test_wind_is_carried_by_the_pins():
    scene = sheet(**DAMPED | SOLVERS["leapfrog"])
    scene.wind, scene.cloths[0].drag = (0.0, 0.0, 3.0), 1.0
    scene.air_drag = 4.0
    sim = simulated(scene, 120)
    total = sum(sim.reactions(p.path).sum(axis=0) for p in sim.scene.pins)
    x = sim.state.x.numpy()[sim.model.body(None).triangles]
    area = 0.5 * np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    push = 0.5 * 1.2 * np.abs(area @ scene.wind).sum() * np.array(scene.wind)
    assert total == pytest.approx(-0.5 * G - push, abs=0.02 + 20.0 * np.abs(sim.state.v.numpy()).max()) and push[2] > 1.0


# worlds, precision, live values, welds and middles

def test_each_world_has_its_own_and_follows_live_values():
    sim = Simulation(chain(**DAMPED | SOLVERS["leapfrog"]), device="cpu", worlds=2, precision="float64")
    sim.set("/chain", "stiffness", 800.0, world=1)
    sim.run(2)
    alone = Simulation(chain(**DAMPED | SOLVERS["leapfrog"]), device="cpu", precision="float64")
    alone.set("/chain", "stiffness", 800.0)
    alone.run(2)
    assert sim.reactions("/pin", 1) == pytest.approx(alone.reactions(), abs=1e-12)
    assert np.abs(sim.reactions("/pin", 1) - sim.reactions("/pin", 0)).max() > 0.1
    before = alone.reactions()
    alone.set("/chain", "stiffness", 400.0)
    assert np.abs(alone.reactions() - before).max() > 0.1


def test_middles_of_quadratic_tets_and_float32_give_the_same_total():
    scene = bar(**DAMPED | SOLVERS["leapfrog"])
    scene.softs[0].quadratic = True
    sim = Simulation(scene, device="cpu")
    sim.run(150)
    found = sim.reactions()
    assert found.shape == (4, 3) and found.sum(axis=0) == pytest.approx(-G, abs=2e-2)


@pytest.mark.parametrize("change, path, words", [
    (lambda s: None, "/nail", "/nail: in world 0 is no pin; there are /left, /right"),
    (lambda s: setattr(s.cloths[0], "tethers", True), "/left", "/sheet: has tethers or a strain limit"),
    (lambda s: s.pins.clear(), None, "is no pin; there are none")])
def test_what_has_no_reaction_is_refused(change, path, words):
    scene = sheet(**SOLVERS["xpbd"])
    change(scene)
    with pytest.raises(SceneError, match=words):
        Simulation(scene, device="cpu").reactions(path)
