"""Edges of rods against rigid bodies that are narrower than points are apart: falls, momentum, weight, friction."""

import numpy as np
import pytest

from tests.make.physics.rods.bodies import THICK, G, at, box, line, lying, masses
from tests.make.physics.rods.body_edges import EDGE, blow, landing, ropes, turned
from tests.physics.rods.rig import simulated
from wsim.geometry import primitives
from wsim.physics.rigid.objects import Body
from wsim.physics.rods.objects import Rods
from wsim.scene import Collider, Scene, Surface
from wsim.scene.check.scene import check_scene
from wsim.scene.solids import Capsule

FLAT = np.eye(3)
CORNER = np.array([[np.sqrt(3.0), -np.sqrt(3.0), 0.0], [np.sqrt(2.0)] * 3, [-1.0, -1.0, 2.0]]) / np.sqrt(6.0)


@pytest.mark.parametrize("on", [False, True], ids=["alone", "touching"])
@pytest.mark.parametrize("R", [FLAT, EDGE, CORNER], ids=["flat", "edge", "corner"])
def test_a_box_that_falls_between_points_is_caught(R, on):
    """Without edges it falls past, by 0.34 m in these frames, and no rope is strained by 1e-3."""
    simulation, method = simulated(landing(R, on))
    rigid, heights = simulation.plan.method("rigid"), []
    for _ in range(20):
        simulation.step()
        heights.append(rigid.poses()[0, 1, 3])
    assert min(heights) > -0.05 and heights[-1] > min(heights) + 0.01          # it was thrown back
    assert method.indicators(None, None)["rod_strain"] > 1e-4
    assert not [w for w in simulation.warnings if "Newton" in w or "by their points" in w]


def test_a_mesh_is_caught_as_the_box_that_it_is():
    points, triangles = primitives.box_outline((0.05,) * 3)
    mesh = Surface(np.asarray(points, np.float32), np.full(len(triangles), 3), np.asarray(triangles).ravel())
    places = []
    for shape in (None, mesh):
        simulation, _ = simulated(landing(FLAT, shape=shape))
        simulation.run(14)
        places.append(simulation.plan.method("rigid").poses()[0])
    assert np.abs(places[1] - places[0]).max() < 1e-4 and places[0][1, 3] < 0.06


def test_it_is_the_same_a_kilometre_away():
    places = []
    for far in (np.zeros(3), np.array([1000.0, -700.0, 300.0])):
        scene = landing(EDGE)
        rods, body = scene.things("Rods")[0], scene.things("Body")[0]
        rods.points = rods.points + far
        for pin in rods.pins:
            pin.motion = at(far)
        body.motion = turned(np.array([0.03, 0.12, 0.0]) + far, EDGE)
        simulation, _ = simulated(scene)
        simulation.run(14)
        places.append(simulation.plan.method("rigid").poses()[0, :3, 3] - far)
    assert np.abs(places[1] - places[0]).max() < 1e-4


def crossed(x: np.ndarray, frame: np.ndarray) -> float:
    """Distance [m] from a bar's axis to the edge of a rope that crosses it, along the normal of both: below 0 where the rope
    has passed."""
    c, axis = frame[:3, 3], frame[:3, 2]
    y = x - c
    side = y @ np.cross((0.0, 1.0, 0.0), axis)
    k = int(np.flatnonzero(side[:-1] * side[1:] <= 0.0)[0])
    n = np.cross(y[k + 1] - y[k], axis)
    return float(y[k] @ n / np.linalg.norm(n))


@pytest.mark.parametrize("on", [False, True], ids=["alone", "touching"])
def test_a_thin_bar_thrown_across_a_rope_is_caught_and_momentum_kept(on):
    """Linear and angular momentum: of a step of Euler's, sum x1 x m (v1 - v0) is what forces in pairs leave 0."""
    simulation, method = simulated(blow(3.0, on))
    rigid = simulation.plan.method("rigid")
    m, M = masses(method, rigid)
    v, V, L = method.points(0)[1], rigid.velocities(), rigid.read("L")
    p, hit = m @ v + M @ V, 0
    least, twist = np.inf, 0.0
    for _ in range(40):
        simulation.step()
        x, now = method.points(0)
        c = rigid.poses()[0, :3, 3]
        turn = np.cross(x, m[:, None] * (now - v)).sum(axis=0) + np.cross(c, M[0] * (rigid.velocities()[0] - V[0]))
        turn += rigid.read("L")[0] - L[0]
        v, V, L = now, rigid.velocities(), rigid.read("L")
        assert np.abs(m @ v + M @ V - p).max() < 1e-6 * 0.3
        twist = max(twist, np.abs(turn).max())
        least = min(least, crossed(x, rigid.poses()[0]))
        hit += int(method.indicators(None, None)["rod_bodies"] > 0.0)
    assert hit > 2 and least > 0.005 and V[0, 1] > -1.5
    assert twist < 1e-6 * 0.3 * 0.4                                            # iterations end at 1e-6 of an edge


def test_the_weight_of_a_bar_is_borne_by_edges_alone():
    """5 kg on two ropes of 32 g, between points: where statics have it, and their ends bear both."""
    M, n, half, zs = 5.0, 6, 0.5, (0.05, -0.05)
    scene = Scene(gravity=(0.0, -G, 0.0), fps=60.0, substeps=4)
    ropes(scene, zs, n, static_friction=0.0, dynamic_friction=0.0)
    c = Collider("/bar/shape", Capsule(0.01, 0.1), static_friction=0.0, dynamic_friction=0.0)
    scene.add(Body("/bar", [c], at((0.0, 0.016, 0.0)), mass=M, drag=12.0, spin_drag=12.0))
    simulation, method = simulated(scene)
    simulation.run(150)
    rigid, x = simulation.plan.method("rigid"), method.points(0)[0]
    assert np.abs(rigid.velocities()).max() < 2e-3
    N = method.touching.bodies.borne.N.numpy()
    assert not N[:, 0].any() and (N[:, 1:] > 0.0).sum() == 4                   # two places within each of two edges
    e = x[[1, n - 2, n + 1, 2 * n - 2]] - x[[0, n - 1, n, 2 * n - 1]]
    size = np.linalg.norm(e, axis=1)
    borne = -(2e4 * (size / (2.0 * half / (n - 1)) - 1.0) * e[:, 1] / size).sum()
    assert borne == pytest.approx((M + masses(method, rigid)[0].sum()) * G, rel=0.01)


def test_a_box_on_single_edges_sticks_and_slips_at_the_critical_angle():
    """On held rods of two points, which it lies between: 0.5 is the friction of its two places together."""
    critical = np.degrees(np.arctan(0.5))
    assert abs(lying(critical - 1.0, 30, 2)) < 1e-5
    a = np.radians(critical + 1.0)
    gain = lying(critical + 1.0, 24, 2) - lying(critical + 1.0, 9, 2)
    assert gain == pytest.approx(0.25 * G * (np.sin(a) - 0.5 * np.cos(a)), rel=0.05)


def test_two_boxes_on_the_same_edges_stick_and_slip_at_the_critical_angle():
    """Of 1 and 2 kg: one of them glided without any friction."""
    critical = np.degrees(np.arctan(0.5))
    for degrees in (critical - 1.0, critical + 1.0):
        a = np.radians(degrees)
        scene = Scene(gravity=(G * np.sin(a), -G * np.cos(a), 0.0), fps=60.0, substeps=4)
        x = np.concatenate([line(2, 1.0, 0.0, z) for z in (0.08, -0.08)])
        rods = scene.add(Rods("/rails", x, [2, 2], THICK, young=1e9))
        rods.pin("/held", np.arange(4))
        for k, side in enumerate((-0.3, 0.25)):
            box(scene, f"/box{k}", (0.02, 0.02, 0.15), (side, 0.02 + 0.5 * THICK, 0.0), mass=1.0 + k)
        simulation, _ = simulated(scene)
        simulation.run(9)
        before = simulation.plan.method("rigid").velocities()[:, 0]
        simulation.run(15)
        now = simulation.plan.method("rigid").velocities()[:, 0]
        if degrees < critical:
            assert np.abs(now).max() < 1e-5
    assert now - before == pytest.approx(0.25 * G * (np.sin(a) - 0.5 * np.cos(a)), rel=0.05)


def test_a_rope_that_lies_flat_has_no_contact_within_its_edges():
    scene = Scene(gravity=(0.0, -G, 0.0), fps=60.0, substeps=4)
    scene.add(Rods("/rope", line(9, 0.2, 0.06), [9], 0.01, young=1e7))
    box(scene, "/box", (0.5, 0.05, 0.2), (0.0, 0.0, 0.0), mass=100.0, inertia=np.full(3, 1e6))
    simulation, method = simulated(scene)
    simulation.set("/box", "force", (0.0, 100.0 * G, 0.0))
    for _ in range(20):
        simulation.step()
        N = method.touching.bodies.borne.N.numpy()
        assert not N[:, 1:].any()
    assert (N[:, 0] > 0.0).sum() > 6


def test_more_bars_on_an_edge_than_there_is_room_for():
    """Six bars on one edge: the frame is repeated with room, all are caught, and momentum kept."""
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=60.0, substeps=4)
    scene.add(Rods("/rope", line(4, 0.3), [4], 0.01, young=1e7))
    for k in range(6):
        c = Collider(f"/bar{k}/shape", Capsule(0.005, 0.05), static_friction=0.5, dynamic_friction=0.5)
        scene.add(Body(f"/bar{k}", [c], at((0.025 * (k - 2.5), 0.0102 * (-1) ** k, 0.0)), mass=0.01,
                       velocity=np.array([0.0, -0.5 * (-1) ** k, 0.0])))
    simulation, method = simulated(scene)
    rigid = simulation.plan.method("rigid")
    m, M = masses(method, rigid)
    simulation.run(4)
    assert method.touching.bodies.depth > 6
    assert np.abs(m @ method.points(0)[1] + M @ rigid.velocities()).max() < 1e-6 * 0.03
    assert (rigid.poses()[:, 1, 3] * (-1.0) ** np.arange(6)).min() > 0.007


def test_results_are_the_same_from_run_to_run_and_in_worlds():
    found = []
    for worlds in (1, 1, 2):
        simulation, method = simulated(blow(3.0), worlds=worlds)
        simulation.run(12)
        found += [(method.points(k)[0], simulation.plan.method("rigid").poses()[k]) for k in range(worlds)]
    assert all(np.array_equal(a, b) for each in found[1:] for a, b in zip(found[0], each, strict=True))


def test_a_body_that_begins_within_an_edge_is_told():
    scene = blow(3.0)
    scene.things("Body")[0].motion = at((0.045, 0.006, 0.005))
    said = [p.text for p in check_scene(scene) if p.path == "/rope"]
    assert len(said) == 1 and "edge" in said[0] and "/bar/shape" in said[0]
