"""Random draws of surfaces that collide: what they judge, and that they see what they are to see."""

from tools import draws
from wsim.physics.selfcontact.crossings import crossings
from wsim.simulation.simulation import Simulation


def test_a_draw_holds_and_without_self_collision_it_does_not():
    """The same places in the author's order and in ours: a scrunched sheet of 64 points, by XPBD."""
    row = draws.tried(5, "xpbd", 8, 3, "cpu")
    assert draws.held(row) and row["tested"] == 3 and row["kind"] == "scrunch" and 0.0 < row["least_gap"] < 1e-2
    scene = draws.drawn(5, 8, "xpbd")
    scene.cloths[0].self_collision = False
    sim = Simulation(scene, device="cpu")
    sim.run(3)
    assert len(crossings(*draws.written(sim))) > 0


def test_what_is_beyond_a_bound_fails():
    row = {"crossed": 0, "cut_energy": 1e-3, "cut_run": 10.0}
    assert draws.held(row)
    assert not any(draws.held(row | more) for more in ({"crossed": 1}, {"cut_energy": 2e-3}, {"cut_run": 11.0}))
