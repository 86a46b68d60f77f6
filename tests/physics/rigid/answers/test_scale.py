"""Contacts know no length, speed or time of their own: a heap of millimetres moves as one of kilometres.

Lengths times L and times times sqrt(L) leave weights, frictions and blows alike. For L a power of 4 nothing rounds anew, so
that motions agree to the bit; a constant in metres or metres a second anywhere shows.
"""

import numpy as np
import pytest

from tools.bench.rigid.answers.shapes import grid, prism
from tools.bench.rigid.answers.stage import Stage, turned
from wsim.physics.rigid import contacts
from wsim.scene import Box, Capsule, Cone, Cylinder, Sphere

SHAPES = (Sphere(0.3), Box((0.3, 0.4, 0.2)), Capsule(0.2, 0.3), Cylinder(0.4, 0.2), Cone(0.4, 0.4), prism(8, 0.4, 0.2))


def scaled(shape, L: float):
    """A shape L times as large."""
    if isinstance(shape, Box):
        return Box(tuple(L * a for a in shape.half))
    if isinstance(shape, Sphere):
        return Sphere(L * shape.radius)
    return type(shape)(L * shape.radius, L * shape.half_height)


def heap(L: float) -> np.ndarray:
    """Places of bodies [L] over 20 frames: a heap that overlaps at first, a plate that flies at a wall."""
    t, turns = np.sqrt(L), np.random.default_rng(3)
    stage = Stage(24.0 / t, 10)
    stage.collider("/floor", grid(13, 8.0 * L, jitter=0.2), rest=0.5)
    stage.collider("/wall", Box((0.02 * L, 2.0 * L, 2.0 * L)), (6.0 * L, 0.0, 6.0 * L))
    for k in range(12):
        shape = SHAPES[k % len(SHAPES)]
        each = prism(8, 0.4 * L, 0.2 * L) if shape is SHAPES[-1] else scaled(shape, L)
        at = np.array([0.125 * (k % 3), -0.125 * (k % 2), 0.25 + 0.25 * k])
        stage.body(f"/body{k}", each, L * at, turned(turns.normal(size=3), 30.0 * k), rest=0.25 * (k % 2))
    stage.body("/plate", Cylinder(0.5 * L, 0.0625 * L), (0.0, 0.0, 6.0 * L), turned((0.0, 1.0, 0.0), 80.0),
               (60.0 * L / t, 0.0, 0.0), (0.0, 16.0 / t, 4.0 / t))
    return stage.run(20.0 / 24.0 * t).x / L


@pytest.mark.parametrize("L", [4.0**-5, 4.0**5])
def test_paths_do_not_know_the_size_of_the_world(L, monkeypatch):
    one = heap(1.0)
    monkeypatch.setattr(contacts, "LISTED", contacts.LISTED / np.sqrt(L))        # lists of pairs, which are made by the clock
    assert np.array_equal(heap(L), one)
    assert np.abs(one[-1] - one[0]).max(axis=-1).min() > 0.1                     # each has moved
