"""Contacts with meshes by lists of faces, in frames: those of a search of the whole mesh in every substep.

Points go on their own, at up to 15 m/s, through colliders that stand, turn or deform, and the slots of both are compared.
Bodies: a blob (closed, 320 faces), one with all of its faces within a list's reach, an open sheet, a plate of 2 mm.
"""

import numpy as np
import pytest
import warp as wp

from tests.make.physics.contact.candidate_lists import SHAPES, Pair, apart, blob, sheet, slab, surface
from wsim.physics.contact import broad
from wsim.scene import Scene, shapes
from wsim.scene.curve import Curve, Motion
from wsim.simulation.simulation import Simulation

CASES = [(shape, how, wp.float32) for shape in SHAPES for how in ("stands", "moves", "deforms")]
CASES += [("blob", "moves", wp.float64), ("sheet", "deforms", wp.float64)]


@pytest.mark.parametrize("shape, how, real", CASES)
def test_lists_find_what_a_search_of_the_whole_mesh_finds(shape, how, real):
    pair = Pair(np.random.default_rng(3), shape, how, real=real)
    met, differ = np.sum([apart(*found) for found in pair.substeps()], axis=0)
    assert met > 150 and differ == 0


@pytest.mark.parametrize("shape, how", [("blob", "stands"), ("blob", "moves"), ("slab", "moves"), ("blob", "deforms")])
def test_points_that_begin_inside_are_on_the_side_that_the_winding_number_says(shape, how):
    pair = Pair(np.random.default_rng(7), shape, how, deep=True, speed=0.3)
    met, differ = np.sum([apart(*found) for found in pair.substeps()], axis=0)
    assert met > 1000 * (shape == "blob") and differ == 0


def test_lists_that_have_no_room_ask_for_it_and_change_nothing():
    """By then most lists of a fine mesh are whole."""
    pair, whole, wanted = Pair(np.random.default_rng(3), "fine", "moves"), [], 0
    contacts = pair.of[1]
    for room in (2, None):
        if room:
            contacts.points.room = room                           # of more in its arrays
        else:
            contacts.points.wanted.zero_()
            assert broad.grow_face_lists(contacts.points, wanted) and contacts.points.room == min(wanted, broad.MOST)
        found = np.sum([apart(*found) for found in pair.substeps()], axis=0)
        wanted, lists = int(contacts.points.wanted.numpy()[0]), contacts.points.radius.numpy() > 0
        whole.append((contacts.points.count.numpy()[lists] <= contacts.points.room).mean())
        assert found[0] > 100 and found[1] == 0 and (wanted > 2 if room else True)
    assert whole[0] < 0.5 and whole[1] > 0.9


def fallen(rng) -> Scene:
    """A net thrown onto a plate that turns, a still sheet that is open, and a blob of many faces that breathes."""
    scene = Scene(fps=60.0, solver="explicit", gravity=(0.0, 0.0, -9.81), up="Z")
    scene.net("/net", *shapes.spring_sheet(0.3, 8, stretch=200.0, up="Z"), velocities=[(0.3, 0.0, -1.5)] * 64)
    tilt = np.array([np.sin(0.3), 0.0, 0.0, np.cos(0.3)])
    rises = Motion.through([0.0, 0.1], [(0.2, 0, -0.16), (0.2, 0, -0.1)], [(0, 0, 0, 1), tilt])
    scene.collider("/plate", surface(*slab(rng)), motion=rises)
    scene.collider("/sheet", surface(*sheet(rng)), at=(0.0, 0.0, -0.19))
    p, f = blob(rng, 0.05, 0.05)
    scene.collider("/blob", surface(p, f, Curve([0.0, 0.1], np.stack([p, 1.3 * p]))), at=(0.0, 0.0, -0.17))
    return scene


def test_a_run_is_that_of_searches_in_every_substep(monkeypatch):
    """Of two worlds, and once more after a reset, when lists are those of another time; room grows on the way."""
    def run() -> Simulation:
        sim = Simulation(fallen(np.random.default_rng(5)), device="cpu", precision="float64", worlds=2)
        sim.run(6)
        return sim
    sim = run()
    x, v, lists = sim.state.x.numpy(), sim.state.v.numpy(), sim.plan.ports.contacts.points
    assert lists.every > 0 and lists.room > 2 and np.abs(v - v.mean(axis=0)).max() > 0.5
    assert np.array_equal(x[:64], x[64:])
    sim.reset()
    sim.run(6)
    assert np.array_equal(sim.state.x.numpy(), x)
    with monkeypatch.context() as m:
        m.setattr(broad, "use_face_lists", lambda *_: None)
        whole = run()
    assert whole.plan.ports.contacts.points.every == 0
    np.testing.assert_allclose(whole.state.x.numpy(), x, rtol=0.0, atol=1e-6)
    monkeypatch.setattr(broad, "ROOM", 2)
    small = run()
    assert small.plan.ports.contacts.points.room > 2 and np.array_equal(small.state.x.numpy(), x)
