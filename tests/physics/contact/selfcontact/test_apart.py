"""Frames in which no surfaces come near each other have no stages of self-contact, and the bits of those that have."""

import numpy as np
import pytest

from tests.conftest import first_and_slow
from tests.physics.contact.selfcontact.rig import SOLVERS, crumple, run, solvers
from wsim.physics.contact.selfcontact import apart
from wsim.scene import Scene, shapes
from wsim.scene.fabric import Fabric

COTTON = Fabric(stretch=500.0, shear=100.0, bend=1e-5, thickness=1e-3, density=150.0)


def hung(corners: bool, on: bool, side: int = 16, **more) -> Scene:
    """A sheet that hangs by its upper edge, or starts flat and swings down by two corners, in a frame further
    than its edges are long."""
    points, counts, indices = shapes.sheet(1.0, 1.0, side - 1, side - 1, horizontal=corners)
    p, scene = np.asarray(points), Scene(fps=60.0, **more)
    scene.cloth("/sheet", points, counts, indices, material=COTTON, self_collision=on)
    near = (p[:, 2] == p[:, 2].min()) & (np.abs(p[:, 0]) == p[:, 0].max()) if corners else p[:, 1] == p[:, 1].max()
    scene.pin("/pin", "/sheet", np.flatnonzero(near))
    return scene


@pytest.mark.parametrize("solver", first_and_slow(solvers("xpbd", "newton", "leapfrog")))
def test_a_sheet_that_meets_nothing_has_no_stages_of_it(solver):
    """But in the first frame, hanging and swinging; it has the bits of a sheet that does not collide with itself."""
    solver = solver | {"substeps": 80} if solver["solver"] == "explicit" else solver
    for corners in (False, True):
        found = []
        for on in (False, True):
            sim = run(hung(corners, on, **solver))
            sim.run(12)
            found.append(sim.positions())
        assert sim.forms["free"] >= 11 and not sim.forms["repeated"]
        if solver["solver"] != "explicit":                   # whose first frame with contacts begins with half a kick
            assert np.array_equal(*found)


@pytest.mark.parametrize("solver", first_and_slow(solvers("xpbd", "xpbd bdf2")))
def test_frames_without_stages_have_the_bits_of_frames_with_them(solver, monkeypatch):
    """Of a sheet that flies, crumples and flies apart."""
    found, enter = [], apart.SurfaceFreeFlight.choose_frame_form
    for always in (False, True):
        def of_all(self, clock, always=always):
            self.wait = 1 if always else self.wait
            enter(self, clock)
        monkeypatch.setattr(apart.SurfaceFreeFlight, "choose_frame_form", of_all)
        sim = run(crumple(4, 12, 1.5, **solver))
        sim.run(24)
        found.append(sim.positions())
        assert (sim.forms["free"] > 2) == (not always) and sim.forms["met"] > 2
    assert np.array_equal(*found)


def test_no_frame_is_tried_without_stages_behind_one_that_would_not_have_held_so():
    """A sheet that crumples lists pairs in all of its frames; none is repeated."""
    sim = run(crumple(3, 24, 8.0, **SOLVERS["xpbd"]))
    sim.run(4)
    assert sim.forms == {"free": 0, "met": 4, "repeated": 0}


@pytest.mark.parametrize("solver", solvers("leapfrog", "xpbd"))
def test_a_restart_goes_on_to_the_bit_behind_frames_without_stages(solver):
    """Leapfrog begins otherwise behind one."""
    solver = solver | {"substeps": 80} if solver["solver"] == "explicit" else solver
    sim = run(hung(True, True, 10, **solver))
    sim.run(5)
    kept = {path: {name: values.copy() for name, values in sim.fields(path).items()} for path in sim.state.paths()}
    sim.run(3)
    other = run(hung(True, True, 10, **solver))
    other.restart(5, kept)
    other.run(3)
    assert sim.forms["free"] > 5 and np.array_equal(sim.positions(), other.positions())


def test_frames_tried_in_vain_are_tried_more_rarely():
    """One behind another, then two, four and eight, until one holds."""
    sim = run(hung(False, True, 6, **SOLVERS["xpbd"]))
    own, clock, waits = sim.plan.method("selfcontact").apart, sim.plan.clock, []
    for _ in range(5):
        own.vain, clock.free = True, False
        own.end(clock, False)
        waits.append(own.wait)
        while own.wait:
            own.vain = False
            own.end(clock, False)
    assert waits == [1, 2, 4, 8, 8]
    clock.free = True
    own.end(clock, False)
    assert (own.wait, own.tried) == (0, 0)
    clock.free = False
    own.end(clock, True)
    assert own.wait == 1
