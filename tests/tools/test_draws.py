"""Random draws of surfaces that collide: what they judge, and that they see what they are to see."""

import numpy as np
import pytest

from tools.draws import row as draws
from tools.draws.scenes import KINDS, Draw, drawn
from wsim.physics.contact.selfcontact.crossings import crossed_triangles
from wsim.simulation.simulation import Simulation


def test_a_draw_holds_and_without_self_collision_it_does_not():
    """A scrunched sheet of 100 points in a turned and scaled prim, by XPBD."""
    row = draws.tried(2, "xpbd", 3, "cpu")
    assert draws.held(row) and row["tested"] == 3 and row["kind"] == "scrunch" and 0.0 < row["least_gap"] < 2.0
    assert row["momentum"] < 1e-5
    scene = drawn(2, "xpbd")
    scene.cloths[0].self_collision = False
    sim = Simulation(scene, device="cpu")
    sim.run(3)
    assert draws.crossed(sim) > 0


@pytest.mark.parametrize("k", range(21))
def test_a_draw_begins_without_intersections_and_is_the_same_again(k):
    """All kinds in all frames; what is near 1 km away is rounded as a file rounds it."""
    draw = Draw(k, "newton")
    places = [b.points.astype(np.float32).astype(np.float64) @ M[:3, :3].T + M[:3, 3]
              for b in draw.scene.bodies() for M in [b.motion.at(0.0)]]
    faces = [np.reshape(b.indices, (-1, 3)) for b in draw.scene.cloths]
    first = np.cumsum([0, *(len(p) for p in places)])
    assert not len(crossed_triangles(np.concatenate(places),
                                     np.concatenate([f + s for f, s in zip(faces, first, strict=False)]), neighbours=False))
    assert draw.kind == KINDS[k % 7] and draw.scene == drawn(k, "newton")


def test_what_is_beyond_a_bound_fails():
    row = {"finite": True, "crossed": 0, "cut_energy": 1e-3, "cut_run": 10.0}
    assert draws.held(row)
    assert not any(draws.held(row | more) for more in ({"crossed": 1}, {"cut_energy": 2e-3}, {"cut_run": 11.0},
                                                       {"finite": False}))
