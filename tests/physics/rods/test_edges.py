"""Edges of strands meet colliders between their points: what is narrower than these are apart holds them."""

import numpy as np
import pytest
import warp as wp

from tests.physics.rods.rig import RADIUS, scene, simulated
from wsim.geometry import primitives
from wsim.kernels.rods.contact import Colliders
from wsim.kernels.rods.edges.edge_contact_points import TURN, edge_flank_functions
from wsim.kernels.rods.march import TOLERANCE
from wsim.scene import Box, Motion, Plane, Sphere, Surface
from wsim.scene.solids import Capsule

TUBE, FACES = primitives.capsule_outline(0.02, 0.02, 0.3, 48)
MESH = Surface(TUBE, np.full(len(FACES), 3), FACES.ravel())


def placed(turn: float = 0.0, shift=(0.0, 0.0, 0.0)) -> Motion:
    """Turned about z [rad], then shifted."""
    frame = np.eye(4)
    frame[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    frame[:3, 3] = shift
    return Motion.still(frame)


def laid(points: int, height: float, *shapes, friction: float = 0.5, shift=(0.0, 0.0, 0.0)):
    """A metre of rope over shapes (shape, its motion), which stand between two of its points."""
    x = np.zeros((points, 3))
    x[:, 0], x[:, 1] = np.linspace(-0.55, 0.45, points), height
    made, rods = scene(x + shift, gravity=(0.0, -9.81, 0.0), young=1e6, static_friction=friction, dynamic_friction=friction)
    made.substeps = 4
    for k, (shape, motion) in enumerate(shapes):
        made.collider(f"/shape{k}", shape, motion=motion)
    return made


def run(made, frames: int = 30):
    """Points in the end, and the most that an edge was in a shape [m] and that Newton's method left."""
    simulation, method = simulated(made)
    told = []
    for _ in range(frames):
        simulation.step()
        told.append(method.said.numpy().max(axis=0))
    assert not [w for w in simulation.warnings if "do not bend" not in w]                # of two points
    return method.points(0)[0], *np.max(told, axis=0)[[2, 1]]


@pytest.mark.parametrize("points, height, shape, turn", [
    (11, 0.05, Sphere(0.03), 0.0), (11, 0.04, Capsule(0.02, 0.3), 0.0), (11, 0.0125, Capsule(0.002, 0.3), 0.0),
    (11, 0.04, MESH, 0.0), (11, 0.035, Box((0.02, 0.02, 0.3)), 0.0), (6, 0.055, Box((0.04, 0.04, 0.3)), 0.0),
    (6, 0.09, Box((0.05, 0.05, 0.3)), 0.1), (11, 0.09, Box((0.05, 0.05, 0.3)), 0.25 * np.pi)],
    ids=["ball", "bar", "wire", "mesh", "flat", "wide", "tilted", "ridge"])
def test_a_shape_between_two_points_holds_a_rope(points, height, shape, turn):
    x, deep, left = run(laid(points, height, (shape, placed(turn))), 20)
    assert left <= float(TOLERANCE) and deep < 0.1 * RADIUS
    assert x[:, 1].max() > height - 0.03 and x[[0, -1], 1].max() < height - 0.05         # it hangs over the shape


def test_a_rope_far_away_is_held_as_well():
    far = np.array([1000.0, 50.0, -300.0])
    x, *_ = run(laid(11, 0.04, (Capsule(0.02, 0.3), placed(0.0))), 12)
    y, *_ = run(laid(11, 0.04, (Capsule(0.02, 0.3), placed(0.0, far)), shift=far), 12)
    assert np.abs(y - far - x).max() < 1e-6


def test_edges_alone_bear_the_weight_and_keep_what_the_law_says():
    """A rope of one edge across two bars, its ends clear: it sinks by its weight over the stiffness, and rests."""
    made = laid(2, 0.03, *((Capsule(0.02, 0.3), placed(0.0, (x, 0.0, 0.0))) for x in (-0.25, 0.15)))
    x, deep, left = run(made, 60)
    assert np.ptp(x[:, 1]) < 1e-5 and left <= float(TOLERANCE)
    assert x[:, 1].mean() == pytest.approx(0.02 + RADIUS, abs=0.06 * RADIUS)             # floats within SOFT of a radius


def test_a_rope_on_a_plane_and_on_a_round_shape_has_no_contacts_between_its_points():
    for shape, height in ((Plane(), RADIUS), (Sphere(1.0), 1.0 + RADIUS)):
        made = laid(21, height + 0.001)
        made.collider("/shape", shape, at=(0.0, 0.0, 0.0))
        simulation, method = simulated(made)
        simulation.run(10)
        part = method.part.arrays
        assert part["load"].numpy().max() > 0.0 and part["load1"].numpy().max() == part["load2"].numpy().max() == 0.0


def test_a_rope_over_a_bar_between_its_points_is_held_by_friction():
    """55 cm on one side and 45 on the other: e^(mu pi) of 4.8 holds it, without friction it slides off."""
    slid = []
    for mu in (0.5, 0.0):
        made = laid(11, 0.04, (Capsule(0.02, 0.3), placed(0.0)), friction=mu)
        for c in made.colliders:
            c.static_friction = c.dynamic_friction = mu
        x, *_ = run(made, 30)
        k = int(np.argmax((x[:-1, 0] < 0.0) & (x[1:, 0] >= 0.0)))
        slid.append(abs((k - x[k, 0] / (x[k + 1, 0] - x[k, 0])) * 0.1 - 0.55))
    assert slid[0] < 0.01 and slid[1] > 0.03


@pytest.mark.parametrize("shape", [Capsule(0.02, 0.3), Box((0.01, 0.02, 0.3))], ids=["bars", "boxes"])
def test_an_edge_across_two_shapes_sticks_and_slips_at_the_critical_angle(shape):
    """A rod of two points across both, tilted: each rubs by all that it bears (by the deepest place alone: 20 degrees)."""
    critical, last = np.degrees(np.arctan(0.5)), []
    for degrees in (critical - 1.0, critical + 1.0):
        a = np.radians(degrees)
        x = np.array([[-0.1, 0.02 + RADIUS, 0.0], [0.1, 0.02 + RADIUS, 0.0]])
        made, _ = scene(x, (9.81 * np.sin(a), -9.81 * np.cos(a), 0.0), young=1e7, static_friction=0.5, dynamic_friction=0.5)
        made.substeps = 4
        for k, at in enumerate((-0.05, 0.06)):
            made.collider(f"/shape{k}", shape, motion=placed(0.0, (at, 0.0, 0.0)), static_friction=0.5, dynamic_friction=0.5)
        simulation, method = simulated(made)
        v = []
        for _ in range(24):
            simulation.step()
            v.append(method.points(0)[1][:, 0].mean())
        last.append((v[-1], (v[-1] - v[9]) * 60.0 / 14.0))
    assert abs(last[0][0]) < 1e-4
    assert last[1][1] == pytest.approx(9.81 * (np.sin(a) - 0.5 * np.cos(a)), rel=0.05)


def test_a_world_of_ropes_that_touch_steps_by_backward_euler_where_an_edge_meets_a_collider():
    """Points that step otherwise than those they pull at would make momentum."""
    made = laid(11, 0.04, (Capsule(0.02, 0.3), placed(0.0)))
    made.things("Rods")[0].self_collision = True
    simulation, method = simulated(made)
    for _ in range(12):
        simulation.step()
    part = method.part.arrays
    assert method.points(0)[0][:, 1].max() > 0.01                                        # it is held
    assert part["load"].numpy().max() == 0.0 and part["load1"].numpy().max() + part["load2"].numpy().max() > 0.0
    assert not part["begun"].numpy().any()


def outside(x, half):
    """Distance of x (..., 3) to a box, 0 inside."""
    return np.linalg.norm(np.maximum(np.abs(x) - half, 0.0), axis=-1)


@pytest.mark.parametrize("shape, distance", [
    (Sphere(0.03), lambda x: np.linalg.norm(x, axis=-1) - 0.03),
    (Box((0.03, 0.02, 0.04)), lambda x: outside(x, (0.03, 0.02, 0.04))),
    (Capsule(0.01, 0.1), lambda x: outside(x, (0.0, 0.0, 0.1)) - 0.01), (MESH, None)], ids=["ball", "box", "bar", "mesh"])
def test_an_edge_that_its_ends_leave_out_has_no_place_nearer_than_they_are(shape, distance):
    """Random edges near a shape, short and long: `turns` against the search that it spares, and against distances along them,
    below which no more than TURN is hidden."""
    _, method = simulated(laid(2, 1.0, (shape, placed(0.0))))
    method.obstacles.pose(np.zeros(method.substeps + 1))
    of = edge_flank_functions(method.obstacles.kinds)
    flanks, turns = of.flanks, of.turns

    @wp.kernel(enable_backward=False, module="unique")
    def look(C: Colliders, a: wp.array(dtype=wp.vec3d), b: wp.array(dtype=wp.vec3d), reach: wp.float64,
             turn: wp.array(dtype=int), near: wp.array(dtype=wp.vec3d)):
        i = wp.tid()
        turn[i] = int(turns(C, 0, 0, a[i], b[i], reach))
        both = flanks(C, 0, 0, a[i], b[i], reach)
        far = wp.float64(1e9)
        near[i] = wp.vec3d(wp.where(both.a.u > wp.float64(0.0), both.a.phi, far),
                           wp.where(both.b.u > wp.float64(0.0), both.b.phi, far), both.ends)

    rng, n, reach = np.random.default_rng(5), 20000, 0.01
    a = rng.uniform(-0.06, 0.06, (n, 3))
    b = a + rng.normal(size=(n, 3)) * 10.0 ** rng.uniform(-3.0, -1.0, (n, 1))
    turn, near = wp.zeros(n, dtype=int), wp.zeros(n, dtype=wp.vec3d)
    wp.launch(look, n, [method.obstacles.table, *(wp.array(v, dtype=wp.vec3d) for v in (a, b)), reach], [turn, near])
    out, (first, second, ends) = turn.numpy() == 0, near.numpy().T
    place = np.minimum(first, second)
    assert 0.3 < out.mean() < 0.99 and (place[~out] < ends[~out]).sum() > 100
    assert not (place[out] < np.minimum(reach, ends[out]) - 1e-7).any()
    if distance:
        phi = distance(a + (b - a) * np.linspace(0.0, 1.0, 101)[:, None, None])
        least, length = phi.min(axis=0), np.linalg.norm(b - a, axis=1)
        hidden = out & (least > 0.0) & (least < reach)
        assert hidden.any() and (np.minimum(phi[0], phi[-1]) - least <= 0.5 * float(TURN) * length + 1e-9)[hidden].all()
