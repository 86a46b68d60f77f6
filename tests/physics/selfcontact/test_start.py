"""Reports of starts: intersections with their places, and thicknesses that edges or files cannot hold."""

import numpy as np

from tests.physics.selfcontact.rig import THIN, run
from wsim.scene import Scene, shapes
from wsim.scene.fabric import Fabric


def scene(*places, material=THIN, **more) -> Scene:
    found = Scene(gravity=(0.0, -9.81, 0.0), fps=60.0, substeps=4, iterations=2, solver="xpbd")
    for k, (horizontal, at) in enumerate(places):
        points, counts, indices = shapes.sheet(0.4, 0.4, 8, 8, horizontal=horizontal, at=at)
        found.cloth(f"/cloth{k}", points, counts, indices, material=material, self_collision=True, **more)
    return found


def test_a_start_that_intersects_is_told_with_its_place_and_held():
    crossed = scene((True, (0.0, 0.0, 0.0)), (False, (0.01, 0.0, 0.01)))
    sim = run(crossed)
    before = sim.positions("/cloth0")
    sim.run(4)
    (text,) = [w for w in sim.warnings if "intersect where surfaces start" in w]
    assert "/cloth0 and /cloth1 at (" in text and "move them apart" in text
    assert np.abs(sim.positions("/cloth0") - before).max() < 0.03               # held, or fallen freely, never thrown


def test_surfaces_that_start_apart_are_told_of_nothing():
    sim = run(scene((True, (0.0, 0.0, 0.0)), (True, (0.0, 0.02, 0.0))))
    sim.run(2)
    assert not [w for w in sim.warnings if "start" in w or "thickness" in w]


def test_a_thickness_beyond_the_edges_is_told_with_the_largest_that_does():
    fat = Fabric(stretch=500.0, shear=100.0, bend=1e-6, thickness=0.03, density=100.0)
    sim = run(scene((True, (0.0, 0.0, 0.0)), material=fat))
    sim.step()
    (text,) = [w for w in sim.warnings if "shortest edge" in w]
    assert "give at most 0.02 m" in text                                        # 0.4 of 5 cm


def test_a_thickness_that_a_file_cannot_hold_is_told():
    far = scene((True, (0.0, 0.0, 0.0)))
    far.cloths[0].points = far.cloths[0].points + np.array([3e4, 0.0, 0.0], np.float32)       # rounded to 2 mm there
    sim = run(far)
    sim.step()
    (text,) = [w for w in sim.warnings if "results round" in w]
    assert "give 0.0156 m or more" in text
