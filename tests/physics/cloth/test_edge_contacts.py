"""Contacts of a cloth's edges and triangles with sharp edges and corners of colliders."""

import numpy as np
import pytest

from tests.make.physics.rigid.contact import box
from tests.make.physics.rigid.touch.blows import by
from tests.physics.rigid.touch.touching import Mixed, run, scene
from wsim import Box, Cone, Cylinder, Fabric, Motion, Scene, Simulation, fabric, shapes
from wsim.geometry.rotation import axis_rotation_matrix

APART = 3.0            # [m] between the cloths of a scene, each above a collider of its own
STANDS_OUT = 1e-3      # [m]


UP, TILT = axis_rotation_matrix(np.array([1.0, 0, 0]), -np.pi / 2), axis_rotation_matrix(np.array([0.6, 0, 0.8]), 0.6)
STRAIGHT = np.eye(3)
SOLIDS = [(Box((0.4, 0.02, 0.3)), (0, 0, 0), STRAIGHT), (Box((0.2, 0.15, 0.2)), (0, -0.25, 0), TILT),
          (Box((0.01, 0.2, 0.3)), (0, -0.16, 0), STRAIGHT), (Cylinder(0.25, 0.1), (0, -0.1, 0), UP)]


def placed(turn, at):
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = turn, at
    return Motion.still(M)


def test_nothing_sharp_stands_out_between_points():
    s = Scene(frames=14)
    for k, (shape, at, turn) in enumerate(SOLIDS):
        sheet = shapes.sheet(1.2, 1.0, 24, 20, horizontal=True, at=(APART * k, 0.06, 0))
        s.cloth(f"/cloth{k}", *sheet, material=fabric("cotton"))
        s.collider(f"/solid{k}", shape, motion=placed(turn, np.add(at, (APART * k, 0, 0))))
    sim, deep = Simulation(s, device="cpu"), []
    for _ in range(s.frames):
        sim.step()
        deep.append(sim.report()["error"]["penetration"])
    assert max(deep[-3:]) < STANDS_OUT, deep
    x, keeps = sim.positions("/cloth0"), 0.5 * fabric("cotton").thickness
    inner = (np.abs(x[:, 0]) < 0.35) & (np.abs(x[:, 2]) < 0.25)                          # a cell from the rim, which bends it
    assert np.median(x[inner, 1] - 0.02 - keeps) < 1e-4
    assert sim.positions("/cloth3")[:, 1].max() < 0.06 and [k for k in sim.report()["kept"] if "solid3" in k["collider"]] == []


def test_sweeps_let_edges_turn_about_a_rim():
    """As many sweeps as a stage has: nothing stands out, no energy is gained, and the flat top is lain on."""
    s = Scene(frames=36, solver="xpbd")
    s.cloth("/cloth", *shapes.sheet(1.2, 1.0, 24, 20, horizontal=True, at=(0, 0.06, 0)), material=fabric("cotton"))
    s.collider("/box", Box((0.4, 0.02, 0.3)))
    sim = Simulation(s, device="cpu")
    sim.run()
    report, x = sim.report(), sim.positions("/cloth")
    on = (np.abs(x[:, 0]) < 0.401) & (np.abs(x[:, 2]) < 0.301)
    told = [w for w in report["warnings"] if "edges strain by" not in w]           # which sweeps leave, and the run says so
    assert told == [] and report["error"]["penetration"] < STANDS_OUT
    assert x[on, 1].max() - 0.02 < 2e-3


def test_folds_beside_a_corner_gain_no_energy():
    """A still box does no work. A fold that hung across an edge of the box had its corner 5 mm deep in a triangle that leaned
    over that edge: what carried it out gave 7.7 % of the largest kinetic energy in frame 11."""
    s = Scene(solver="explicit", integrator="leapfrog", substeps=127, iterations=1)
    s.cloth("/cloth", *shapes.sheet(1.2, 1.0, 24, 20, horizontal=True, at=(0, 0.06, 0)), material=fabric("cotton"))
    s.collider("/box", Box((0.4, 0.02, 0.3)))
    sim = Simulation(s, device="cpu")
    sim.run(12)
    assert sim.report()["balance"]["rise"] < 2e-3 and sim.report()["error"]["penetration"] < STANDS_OUT


@pytest.mark.parametrize("way", ["leapfrog", "xpbd"])
def test_a_box_that_flies_between_points_of_a_sheet_is_met_and_momentum_is_kept(way):
    sim = run(scene(box("/box", (0.03, 0.15, 0.02), (0.05, 0.1, 0.05), velocity=(0.0, -2.0, 0.0), mass=0.2), gravity=(0, 0, 0),
                    **by(way)))
    before = Mixed(sim)
    sim.run(6)
    after = Mixed(sim)
    assert after.speeds[0, 1] > -1.9 and sim.report()["error"]["penetration"] < STANDS_OUT
    assert np.abs(after.momentum - before.momentum).max() < 1e-6 * after.moved


def test_a_blow_at_a_site_is_that_of_its_weights():
    """A free triangle meets the apex of a cone: the impulse J n at the weights b leaves no speed there, v_k = v (1 - b_k / b.b)
    for points of one mass. The law of a plastic blow."""
    points = np.array([[-0.1, 0.011, -0.1], [0.2, 0.011, -0.1], [-0.1, 0.011, 0.2]])
    s = Scene(frames=1, gravity=(0, 0, 0))
    material = Fabric(stretch=1.0, shear=0.0, bend=0.0, thickness=1e-3)          # so soft that it turns freely in a frame
    s.cloth("/cloth", points, np.array([3]), np.array([0, 2, 1]), material=material, velocities=np.tile((0, -0.5, 0), (3, 1)))
    s.collider("/cone", Cone(0.05, 0.1), motion=placed(UP, (0, -0.1, 0)))
    sim = Simulation(s, device="cpu", precision="float64")
    sim.step()
    b = np.linalg.solve(np.vstack([points[:, [0, 2]].T, np.ones(3)]), (0.0, 0.0, 1.0))
    assert np.allclose(sim.velocities("/cloth")[:, 1], -0.5 * (1.0 - b / (b @ b)), atol=0.02)
