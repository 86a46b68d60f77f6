"""Bodies and points of a world in one launch beside a launch for each pass, and beside other worlds."""

import numpy as np
import pytest

from tests.make.physics.rigid.contact import UP, ball, box
from tests.make.physics.rigid.touch.scene import falls
from tests.physics.rigid.touch.touching import grid, run, scene
from wsim.physics.rigid.touch import worlds
from wsim.scene import Plane, Scene
from wsim.scene.curve import Motion


def two(**more) -> Scene:
    """A box and a ball that lie against each other on two sheets, above and below; the lower one touches a plane too."""
    found = scene(box("/box", (0.0, 0.06, 0.0), (0.4, 0.1, 0.4), velocity=(0.1, -1.0, 0.0), mass=0.5),
                  ball("/ball", (0.29, 0.1, 0.02), 0.09, velocity=(-0.4, -1.0, 0.0), mass=0.3), pinned=True, **more)
    points, quads = grid(9, 0.5, 0.21)
    found.cloth("/over", points, np.full(len(quads), 4), quads.ravel())
    low = UP.copy()
    low[1, 3] = -0.02
    found.collider("/ground", Plane(), motion=Motion.still(low))
    return found


def ends(found: Scene, few: int, monkeypatch, **more):
    """Places of points and bodies after so many frames."""
    monkeypatch.setattr(worlds, "FEW", few)
    sim = run(found, **more)
    assert (sim.plan.ports.moving_bodies.worlds is None) == (few == 0)
    sim.run(8)
    return sim.plan.state.x.numpy(), sim.plan.method("rigid").poses(), sim


@pytest.mark.slow
@pytest.mark.parametrize("way", [("xpbd", "backward_euler", 2), ("xpbd", "bdf2", 4), ("explicit", "leapfrog", 1)])
def test_one_launch_is_a_launch_for_each_pass(way, monkeypatch):
    """Rounds that change nothing are left out, and a star begins at the one before: to 1e-9 m both are the same, in float64."""
    more = {"solver": way[0], "integrator": way[1], "iterations": way[2], "substeps": 12 if way[0] == "xpbd" else 60}
    x, poses, sim = ends(two(**more), 32, monkeypatch, precision="float64")
    others, other, beside = ends(two(**more), 0, monkeypatch, precision="float64")
    assert sim.indicators()["touches"] == beside.indicators()["touches"] > 30
    assert np.abs(x - others).max() < 1e-9 and np.abs(poses - other).max() < 1e-9


def test_worlds_end_by_themselves(monkeypatch):
    """Each world has the bits of one alone, whatever the others do."""
    alone = ends(falls(), 32, monkeypatch)[0]
    sim = run(falls(), worlds=3)
    sim.set("/ball", "mass", 2.0, world=1)
    sim.run(8)
    first, second, third = np.split(sim.plan.state.x.numpy(), 3)
    assert np.array_equal(first, alone) and np.array_equal(third, alone)
    assert np.abs(second - alone).max() > 1e-3
