"""Liquid in cups of walls that are thinner than a cell, or some cells thick: none comes through, and it stands as high as it
should.

A cup's frame has its origin in the middle of the floor. Tilted by an angle a, a level surface in it is y = h - x tan a, and the
centre of what is below stands  cos a (h / 2 + T / 24) - sin a T / (12 tan a)  above the origin, T = W^2 tan^2 a / h.
"""

import numpy as np
import pytest

from tests.make.physics.fluid.liquid.cups import FPS, KINDS, Cup, boxes, mesh, pose, still, tilted
from wsim.scene import Surface


def inside_out(size, wall: float) -> list:
    """The mesh with its faces the other way round, and corners of their own for each: as some files have them."""
    (shape, place), = mesh(size, wall)
    corners = np.split(shape.indices, np.cumsum(shape.counts)[:-1])
    points = shape.points[np.concatenate([face[::-1] for face in corners])]
    return [(Surface(points, shape.counts, np.arange(len(points))), place)]








@pytest.mark.parametrize("cells", [0.1, 1.0, 3.0])
def test_liquid_stands_in_a_cup_off_the_grid(cells):
    """Its middle within a tenth of a cell: particles are half a cell apart, and the lattice begins within a quarter of one."""
    cup = Cup(boxes, cells, 0.3, still(0.0))
    assert cup.outside() == 0 and cup.center() == pytest.approx(cup.stands(0.0), abs=0.1 / 32.0)


@pytest.mark.parametrize("cells", [0.1, 0.25])
def test_a_cup_that_tilts_spills_nothing(cells):
    cup = Cup(boxes, cells, 0.3, tilted(1.0), frames=2 * FPS)
    assert cup.outside() == 0 and cup.center() == pytest.approx(cup.stands(30.0), abs=0.1 / 32.0)


@pytest.mark.parametrize("cells", [0.25, 3.0])
def test_a_mesh_holds_its_liquid_whichever_way_its_faces_are_wound(cells):
    cup = Cup(inside_out, cells, 0.3, still(0.0), frames=12)
    assert cup.outside() == 0 and cup.center() == pytest.approx(cup.stands(0.0), abs=0.1 / 32.0)


def test_a_closed_box_that_is_shaken_and_turned_leaks_nothing():
    """1.5 m/s along and a turn a second: parts of the box go by one screw in a frame, and no gap opens between them."""
    def path(t, at):
        return pose(360.0 * t, at + [0.12 * np.sin(4.0 * np.pi * t), 0.15, 0.0])
    assert Cup(boxes, 0.25, 0.3, path, size=(0.3, 0.3), lid=True, fill=0.15, frames=2 * FPS).outside() == 0




@pytest.mark.slow
@pytest.mark.parametrize("off", [0.0, 0.3])
@pytest.mark.parametrize(("kind", "cells"), [
    *((kind, cells) for kind in ("box", "mesh") for cells in (0.1, 0.25, 1.0, 3.0)), ("sheet", 0.0)])
def test_no_particle_comes_out_in_ten_seconds(kind, cells, off):
    """Still, on the diagonal, and tilted in two seconds; heights as above, on the diagonal that of a corner's filling."""
    make, frames = KINDS[kind], 10 * FPS
    for path, degrees in ((still(0.0), 0.0), (tilted(2.0), 30.0)):
        cup = Cup(make, cells, off, path, frames=frames)
        assert cup.outside() == 0 and cup.center() == pytest.approx(cup.stands(degrees), abs=0.1 / 32.0)
    assert Cup(make, cells, off, still(45.0), frames=frames, fill=0.08, size=(0.4, 0.6)).outside() == 0


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "cells"), [("box", 0.25), ("mesh", 0.2), ("sheet", 0.0)])
def test_no_particle_comes_out_in_three_dimensions(kind, cells):
    for path, degrees in ((still(0.0), 0.0), (tilted(1.0), 30.0)):
        cup = Cup(KINDS[kind], cells, 0.3, path, dim=3, n=20, size=(0.4, 0.5), frames=2 * FPS)
        assert cup.outside() == 0 and cup.center() == pytest.approx(cup.stands(degrees), abs=0.1 / 20.0)
