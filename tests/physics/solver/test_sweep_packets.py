"""Sweeps of membranes and hinges by eights on a CPU: those of one constraint after the other, to rounding."""

from dataclasses import replace

import numpy as np
import pytest

from wsim.physics.solver import batch
from wsim.scene import Scene, shapes
from wsim.simulation.simulation import Simulation


def shaken(monkeypatch, packed: bool, precision: str, uneven: float = 0.0, worlds: int = 1, squeeze: float = 1.0,
           **more) -> Simulation:
    """A sheet of 10 x 8 triangles' sides, so that colours leave a remainder, that starts squeezed to a part of its width."""
    monkeypatch.setattr(batch, "PACKED", packed)
    scene = Scene(solver="xpbd", integrator="backward_euler", substeps=6, **{"iterations": 2} | more)
    points, counts, indices = shapes.sheet(0.5, 0.4, 10, 8)
    points = points + uneven * np.random.default_rng(1).normal(size=points.shape)
    cloth = scene.cloth("/cloth", points * [squeeze, 1.0, 1.0], counts, indices, rest_points=points)
    cloth.material = replace(cloth.material, damping=2e-3 if uneven else 0.0)
    scene.pin("/pin", "/cloth", [0, 10])
    sim = Simulation(scene, device="cpu", precision=precision, worlds=worlds)
    sim.run(2)
    assert {b.kind: b.packed for b in sim.plan.ports.xpbd_batches} == {"membrane": packed, "dihedral": packed}
    return sim


@pytest.mark.parametrize("precision, most", [("float32", 2e-6), ("float64", 1e-14)])
@pytest.mark.parametrize("more", [
    {"iterations": 1}, {"uneven": 0.004}, {"uneven": 0.004, "squeeze": 0.3}], ids=["regular", "damped", "squeezed"])
def test_eight_at_a_time_are_what_one_after_the_other_are(monkeypatch, precision, most, more):
    """Uniform and own compliances, without and with multipliers and damping, and steps that are shortened. Of points that move
    by 0.1 m; where a sheet that was squeezed to a third unfolds, roundings grow."""
    one, eight = (shaken(monkeypatch, packed, precision, **more) for packed in (False, True))
    x, start = one.positions("/cloth"), one.given.cloths[0].points
    assert np.abs(x - start).max() > 0.02
    grown = 1e3 if "squeeze" in more else 1.0
    assert np.abs(eight.positions("/cloth") - x).max() < most * grown
    assert np.abs(eight.velocities("/cloth") - one.velocities("/cloth")).max() < 200.0 * most * grown


def test_worlds_have_the_bits_of_one(monkeypatch):
    one, two = (shaken(monkeypatch, True, "float32", 0.004, worlds) for worlds in (1, 2))
    for world in (0, 1):
        assert np.array_equal(two.positions("/cloth", world), one.positions("/cloth"))


def test_a_live_value_reaches_the_packets(monkeypatch):
    """A regular sheet whose compliances were one for all until one was set."""
    found = []
    for packed in (False, True):
        sim = shaken(monkeypatch, packed, "float64")
        sim.set("/cloth", "stretch", 40.0)
        sim.set("/cloth", "bend", 1e-4)
        sim.run(2)
        found.append(sim.positions("/cloth"))
    np.testing.assert_allclose(found[1], found[0], atol=1e-13)
