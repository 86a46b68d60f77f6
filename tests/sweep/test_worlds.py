"""Worlds with values of their own: set at once, and as if each were alone."""

import numpy as np
import pytest

from tests.conftest import grid
from tests.make.sweep.worlds import HOW, cloth
from wsim.scene import Scene, SceneError
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation

CPU = {"device": "cpu"}


VALUES = {"stretch": [200.0, 300.0, 250.0], "bend": [1e-4, 2e-4, 3e-4], "damping": [1e-4, 2e-4, 5e-5],
          "density": [0.1, 0.2, 0.4], "dynamic_friction": [0.1, 0.5, 0.9]}


@pytest.mark.parametrize("solver", list(HOW))
def test_values_of_all_worlds_at_once_are_those_of_one_after_another(solver):
    """To the bit, and of the scene's own too: gravity, wind."""
    at_once, in_turn = (Simulation(cloth(solver), worlds=3, **CPU) for _ in range(2))
    for name, values in VALUES.items():
        at_once.set("/cloth", name, values, range(3))
        for world, value in enumerate(values):
            in_turn.set("/cloth", name, value, world)
    for name in ("gravity", "wind"):
        vectors = np.random.default_rng(1).normal(size=(3, 3))
        at_once.set("/", name, vectors, range(3))
        for world in range(3):
            in_turn.set("/", name, vectors[world], world)
    for sim in (at_once, in_turn):
        sim.run(5)
    ends = [at_once.positions("/cloth", world) for world in range(3)]
    assert all(np.array_equal(end, in_turn.positions("/cloth", world)) for world, end in enumerate(ends))
    assert np.abs(ends[0] - ends[1]).max() > 1e-3 and len(at_once.changes) == len(in_turn.changes)


def test_a_value_that_one_world_cannot_have_changes_none():
    sim = Simulation(cloth("xpbd"), worlds=3, **CPU)
    with pytest.raises(SceneError, match="density is -1"):
        sim.set("/cloth", "density", [1.0, -1.0, 1.0], range(3))
    assert sim.changes == []
    with pytest.raises(SceneError, match="has 2 values for 3 worlds"):
        sim.set("/cloth", "density", [1.0, 1.0], range(3))


@pytest.mark.parametrize("solver", list(HOW))
def test_a_world_that_breaks_is_taken_out_and_leaves_the_others_as_they_were(solver):
    """Thrown beyond float32's numbers in world 1 after two frames; the others to the bit as without it."""
    sim, calm = Simulation(cloth(solver), worlds=3, **CPU), Simulation(cloth(solver), worlds=3, **CPU)
    for each in (sim, calm):
        each.plan.clock.touching = True
        each.run(2)
    for each in (sim, calm):
        each.set("/cloth", "velocities", each.velocities("/cloth", 0) if each is calm else np.full((16, 3), 3e38), world=1)
        each.run(3)
    assert list(sim.lost) == [1] and calm.lost == {} and sim.plan.clock.substeps == calm.plan.clock.substeps
    assert any("world 1 stopped being a number" in text for text in sim.warnings)
    for world in (0, 2):
        assert np.array_equal(sim.positions("/cloth", world), calm.positions("/cloth", world))
    start = Simulation(cloth(solver), **CPU).positions()
    assert np.array_equal(sim.positions("/cloth", 1), start)
    sim.reset(world=1)
    sim.run(2)
    assert sim.lost == {} and np.abs(sim.positions("/cloth", 1) - start).max() > 1e-3


@pytest.mark.parametrize("solver", ["xpbd", "explicit"])
def test_a_world_is_reset_alone(solver):
    """Its positions are those of a run that begins, while the others go on; without history to the bit."""
    sim, whole, fresh = (Simulation(cloth(solver), worlds=n, **CPU) for n in (3, 3, 1))
    for each in (sim, whole, fresh):
        each.plan.clock.touching = True
    sim.run(4)
    sim.reset(world=2)
    assert np.array_equal(sim.positions("/cloth", 2), fresh.positions()) and not sim.velocities("/cloth", 2).any()
    for each, frames in ((sim, 3), (whole, 7), (fresh, 3)):
        each.run(frames)
    assert np.array_equal(sim.positions("/cloth", 0), whole.positions("/cloth", 0))
    apart = np.abs(sim.positions("/cloth", 2) - fresh.positions()).max()
    assert apart == 0.0 if solver == "xpbd" else apart < 2e-3
    with pytest.raises(SceneError, match="there is no world 3; allowed are 0 to 2"):
        sim.reset(world=3)


def test_memory_of_worlds_is_said_before_they_are_made(monkeypatch):
    from wsim.simulation.measure import memory
    scene = cloth("xpbd")
    each = memory.bytes_held_by(Simulation(scene, **CPU))
    monkeypatch.setattr(memory, "LARGE", 10)
    monkeypatch.setattr(memory, "free_bytes", lambda device: 4.5 * each)
    with pytest.raises(SceneError, match=r"7 of .* KiB each take .* and .* are free on cpu: 5 fit"):
        Simulation(scene, worlds=7, **CPU)
    assert Simulation(scene, worlds=5, **CPU).worlds == 5


@pytest.mark.slow
def test_worlds_of_several_bodies_have_the_bits_of_one_alone():
    """Each sweep goes through the colours of one world after another: those of all its bodies and kinds of constraints."""
    scene = Scene(solver="xpbd", **HOW["xpbd"])
    for k, n in enumerate((4, 6)):
        points, counts, indices = grid(n)
        scene.cloth(f"/cloth{k}", points + (1.5 * k, 0.0, 0.0), counts, indices, model="membrane",
                    material=Fabric(stretch=300.0, bend=1e-4, damping=1e-4, strain_limit=0.05))
        scene.pin(f"/pin{k}", scene.cloths[k], [0, 3], stiffness=500.0 if k else np.inf)
    scene.net("/net", [[0, 2, 0], [0.1, 2, 0], [0.3, 2, 0]], [[0, 1], [1, 2]], [100.0, 50.0], [0.1, 0.1, 0.2])
    many, alone = Simulation(scene, worlds=5, **CPU), Simulation(scene, **CPU)
    for sim in (many, alone):
        sim.run(6)
    for body in scene.bodies():
        for world in range(5):
            assert np.array_equal(many.positions(body.path, world), alone.positions(body.path))


def test_worlds_take_the_steps_that_one_alone_takes():
    """Whatever so many would choose together: 300 worlds of 16 points by the choice of one."""
    scene = cloth("xpbd")
    scene.solver = scene.integrator = "auto"
    many, alone = Simulation(scene, worlds=300, **CPU).plan.choice, Simulation(scene, **CPU).plan.choice
    assert (many.solver, many.integrator, many.substeps, many.iterations) == (alone.solver, alone.integrator, alone.substeps,
                                                                              alone.iterations)
