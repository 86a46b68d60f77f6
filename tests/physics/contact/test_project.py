"""Points against colliders: closed forms of sliding, sticking, impact, carrying; overlap; capacity; bits."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp

from wsim.geometry.rotation import axis_rotation_matrix, matrix_quat
from wsim.kernels.contact.project import TOUCHED
from wsim.kernels.math.real import types
from wsim.physics.contact import CollidablePoints, ColliderContacts
from wsim.scene import Box, Capsule, Collider, Cone, Cylinder, Plane, SceneError, Sphere, Surface, shapes
from wsim.scene.curve import Curve, Motion

G = 9.81
REALS = [wp.float32, wp.float64]


class Driver:
    """Free points by backward Euler or BDF2: predict and finish in NumPy on the arrays that the contacts work on."""

    def __init__(self, colliders, x, v=(0, 0, 0), *, real=wp.float32, mu=(0.5, 0.5), reach=0.0, substeps=10, fps=60.0,
                 gravity=(0, 0, -G), iterations=1, w=1.0, origin=(0, 0, 0), bdf2=False):
        x = np.atleast_2d(np.asarray(x, float))
        n, t = len(x), types(real)
        self.gravity, self.iterations, self.substeps = np.array(gravity, float), iterations, substeps
        self.dt, self.time, self.w = 1.0 / fps, 0.0, np.broadcast_to(w, n)
        self.h = self.dt / substeps
        self.device = {name: wp.zeros(n, dtype=t.vec3, device="cpu") for name in "xedav"}
        self.x, self.e, self.d, self.a, self.v = (self.device[name].numpy() for name in "xedav")   # views, on the CPU
        self.x[:], self.v[:], self.bdf2 = x, v, bdf2
        self.s, self.u = np.zeros_like(self.x), np.zeros_like(self.x)       # step and velocity before this one
        bodies = CollidablePoints([list(colliders)], np.array([origin], float), np.zeros(n, np.int32), self.w,
                                  np.full(n, reach), np.tile(mu, (n, 1)), np.zeros((0, 3)), np.zeros(1), np.zeros(1))
        self.struck = wp.zeros(n, dtype=real, device="cpu")
        self.contacts = ColliderContacts(bodies, device="cpu", real=real, substeps=substeps, dt=self.dt,
                                         struck=self.struck if bdf2 else None)

    def frame(self):
        self.contacts.prepare(self.time)
        for k in range(self.substeps):
            multistep = self.bdf2 and self.time + k > 0                     # the first substep has no history
            g = self.h * (2.0 / 3.0 if multistep else 1.0)
            past = np.array([self.s, self.v - self.u]) / 3.0 if multistep else np.zeros((2, 1, 3))
            self.a[:] = self.e + past[0]
            self.d[:] = self.a + (self.w > 0)[:, None] * g * (self.v + past[1] + g * self.gravity)
            self.contacts.search(k, *(self.device[name] for name in "xda"))
            for _ in range(self.iterations):
                self.contacts.project(g, self.device["d"], self.device["a"])
            if self.bdf2:
                self.contacts.settle(g, *(self.device[name] for name in "edav"))
            self.s, self.u = self.d - self.e, self.v.copy()
            self.v[:] = (self.d - self.a) / self.x.dtype.type(g)
            old = self.x.copy()
            self.x += self.d
            self.e[:] = self.d - (self.x - old)
        self.time += self.dt

    def run(self, seconds):
        for _ in range(round(seconds / self.dt)):
            self.frame()
        return self


def tilted(angle):
    """A plane through the origin, turned about y: down the slope is +x."""
    M = np.eye(4)
    M[:3, :3] = axis_rotation_matrix(np.array([0.0, 1.0, 0.0]), angle)
    return Collider("/slope", Plane(), Motion.still(M))


def slab(kind, thickness=0.01, half=0.5):
    """A wall in the x-y plane of 1 cm: box, closed mesh, or the open mesh of its upper face."""
    if kind == "box":
        return Box((half, half, thickness / 2))
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
    points = corners * np.array((half, half, thickness / 2), np.float32)
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    if kind == "sheet":
        quads = quads[5:]
    return Surface(points, np.full(len(quads), 4), quads.ravel())


def moving(velocity, seconds=1.0, start=(0, 0, 0)):
    keys = np.tile(np.eye(4), (2, 1, 1))
    keys[:, :3, 3] = np.array(start), np.array(start) + seconds * np.array(velocity)
    return Motion(np.array([0.0, seconds]), keys)


@pytest.mark.parametrize("real", REALS)
def test_a_slope_holds_below_the_critical_angle_and_not_above(real):
    mu = 0.5
    held = Driver([tilted(np.arctan(0.99 * mu))], (0, 0, 0), real=real).run(1.0)
    gone = Driver([tilted(np.arctan(1.01 * mu))], (0, 0, 0), real=real).run(1.0)
    slide = 0.5 * G * np.sin(np.arctan(1.01 * mu)) * (1 - 1 / 1.01)         # of friction: 1/1.01 of what pulls
    assert np.linalg.norm(held.x[0]) < 1e-6
    assert np.linalg.norm(gone.x[0]) == pytest.approx(slide, rel=0.01)


@pytest.mark.parametrize("real", REALS)
def test_sliding_down_a_slope_accelerates_by_g_sin_minus_mu_cos(real):
    angle, mu = np.radians(35.0), 0.3
    d = Driver([tilted(angle)], (0, 0, 0), real=real, mu=(0.1, 0.1)).run(0.5)           # mean of 0.1 and 0.5
    down = d.v[0] @ (np.cos(angle), 0, -np.sin(angle))
    assert down / 0.5 == pytest.approx(G * (np.sin(angle) - mu * np.cos(angle)), rel=1e-3)


def test_a_sliding_point_stops_after_v2_over_2_mu_g():
    d = Driver([Collider("/floor", Plane())], (0, 0, 0), v=(2.0, 0, 0)).run(1.0)
    assert d.x[0, 0] == pytest.approx(2.0**2 / (2 * 0.5 * G), rel=0.01)      # backward Euler: h v / 2 = 0.4 % short
    assert np.abs(d.v).max() < 1e-6


def test_sliding_takes_the_dynamic_and_sticking_the_static_coefficient():
    floor = Collider("/floor", Plane(), static_friction=0.8, dynamic_friction=0.2)
    d = Driver([floor], (0, 0, 0), v=(1.0, 0, 0), mu=(0.8, 0.2)).run(0.2)
    assert d.v[0, 0] == pytest.approx(1.0 - 0.2 * G * 0.2, rel=1e-3)
    pushed = Driver([floor], (0, 0, 0), mu=(0.8, 0.2), gravity=(0.5 * G, 0, -G)).run(0.5)      # between the two
    assert np.abs(pushed.x).max() < 1e-6


@pytest.mark.parametrize("speed", [10.0, 100.0])
@pytest.mark.parametrize("kind", ["box", "solid", "sheet"])
def test_nothing_tunnels_through_a_wall_of_1_cm(kind, speed):
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.uniform(-0.3, 0.3, (50, 2)), rng.uniform(0.02, 0.25, (50, 1))], 1)
    v = np.array([0, 0, -speed]) + rng.normal(0, 0.05 * speed, (50, 3)) * (1, 1, 0)
    d = Driver([Collider("/wall", slab(kind))], x, v, gravity=(0, 0, 0), reach=1e-3).run(1 / 60)
    assert (d.x[:, 2] > 0.005 + 1e-3 - 1e-5).all()
    d.run(0.2)
    inside = np.abs(d.x[:, :2]).max(axis=1) < 0.5                            # some slide over the rim
    assert inside.sum() > 25 and (d.x[inside, 2] > 0.005 + 1e-3 - 1e-5).all()


@pytest.mark.parametrize("speed", [10.0, 100.0])
@pytest.mark.parametrize("kind", ["box", "solid", "sheet"])
def test_a_moving_wall_takes_resting_points_along(kind, speed):
    wall = Collider("/wall", slab(kind), moving((0, 0, speed), start=(0, 0, -0.0171)))
    x = np.array([[0.1 * i - 0.2, 0.03, 0.002 * i] for i in range(5)])
    d = Driver([wall], x, gravity=(0, 0, 0), reach=1e-3).run(1 / 60)
    face = -0.0171 + 0.005 + 1e-3 + speed / 60
    np.testing.assert_allclose(d.x[:, 2], face, atol=2e-6 * speed)
    np.testing.assert_allclose(d.v[:, 2], speed, rtol=1e-3)


def test_a_small_fast_ball_misses_nothing():
    """It goes 8 of its own radii in a substep."""
    ball = Collider("/ball", Sphere(0.02), moving((100.0, 0, 0), start=(-1.0, 0, 0)))
    x = np.array([[0.13 * i - 0.9, 0.0, 0.0] for i in range(10)])
    d = Driver([ball], x, gravity=(0, 0, 0)).run(1 / 60)
    np.testing.assert_allclose(d.x[:, 0], -1.0 + 100.0 / 60 + 0.02, atol=1e-4)


def test_a_turning_wall_sweeps_points_before_it():
    times = np.linspace(0.0, 0.1, 11)
    keys = np.tile(np.eye(4), (11, 1, 1))
    keys[:, :3, :3] = [axis_rotation_matrix(np.array([0.0, 1.0, 0.0]), -20.0 * t) for t in times]  # 10 m/s at 0.5 m
    wall = Collider("/wall", Box((0.5, 0.5, 0.005)), Motion(times, keys), static_friction=0.0, dynamic_friction=0.0)
    d = Driver([wall], [[0.4, 0.0, 0.02], [0.2, 0.1, 0.05]], gravity=(0, 0, 0), mu=(0, 0)).run(1 / 60)
    above = d.x.astype(float) @ wall.motion.at(d.time)[:3, :3]                             # in the wall's frame
    np.testing.assert_allclose(above[:, 2], 0.005, atol=(20.0 / 600) ** 2 * 0.4)          # an arc against its chord
    np.testing.assert_allclose(d.v[:, 2], 20.0 * np.cos(1 / 3) * above[:, 0], rtol=0.1)


@pytest.mark.parametrize("real", REALS)
def test_a_moving_plane_carries_a_point_by_friction(real):
    floor = Collider("/floor", Plane(), moving((0.5, 0, 0), 2.0))
    d = Driver([floor], (0, 0, 0), real=real).run(1.0)
    slip = 0.5**2 / (2 * 0.5 * G)                                           # lost until it has the floor's speed
    assert d.x[0, 0] == pytest.approx(0.5 - slip, rel=1e-3)
    assert d.v[0, 0] == pytest.approx(0.5, rel=1e-5)


def test_a_point_rides_on_a_turning_disc():
    turns = np.linspace(0.0, 2.0, 41)
    keys = np.tile(np.eye(4), (41, 1, 1))
    keys[:, :3, :3] = [axis_rotation_matrix(np.array([0.0, 0.0, 1.0]), 2.0 * t) for t in turns]
    disc = Collider("/disc", Cylinder(1.0, 0.1), Motion(turns, keys))
    d = Driver([disc], (0.5, 0, 0.1), v=(0, 1.0, 0)).run(1.0)               # v^2 / r = 2 m/s^2 is under mu g
    np.testing.assert_allclose(d.x[0], (0.5 * np.cos(2), 0.5 * np.sin(2), 0.1), atol=2e-3)   # first order: w^2 r h t
    assert np.linalg.norm(d.v[0]) == pytest.approx(1.0, rel=5e-3)


@pytest.mark.parametrize("shape", [Plane(), Sphere(0.3), Box((0.3, 0.3, 0.3)), slab("solid", 0.6, 0.3)])
def test_an_overlap_ends_without_speed(shape):
    top = 0.0 if isinstance(shape, Plane) else 0.3
    d = Driver([Collider("/solid", shape)], (0.001, 0.002, top - 0.1), gravity=(0, 0, 0))
    fastest = 0.0
    for _ in range(30):
        d.frame()
        fastest = max(fastest, float(np.abs(d.v).max()))
    assert fastest < 1e-4
    assert d.x[0, 2] == pytest.approx(top, abs=2e-5)


def test_an_overlap_ends_at_the_speed_of_recovery():
    d = Driver([Collider("/floor", Plane())], (0, 0, -0.1)).run(0.1)
    assert d.x[0, 2] == pytest.approx(-0.1 + 0.1 * 0.5, abs=1e-4)           # gravity does not sink it meanwhile


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("shape", [Plane(), Sphere(0.3), Box((0.3, 0.3, 0.3)), Capsule(0.1, 0.2), Cylinder(0.3, 0.3),
                                   slab("solid", 0.6, 0.3), slab("sheet", 0.6, 0.3)])
def test_a_resting_point_stays_for_1000_substeps(shape, real):
    top = 0.0 if isinstance(shape, Plane) else 0.3
    start = np.array([[0.0, 0.0, top + 5e-4]]) if isinstance(shape, (Sphere, Capsule)) else np.array(
        [[0.05, 0.02, top + 5e-4], [0.0, 0.0, top + 5e-4]])                 # in a triangle, and on the edge of two
    d = Driver([Collider("/solid", shape)], start, reach=5e-4, real=real, origin=(0, 0, 0)).run(0.2)
    before, fastest = d.x.copy(), 0.0
    for _ in range(100):
        d.frame()
        fastest = max(fastest, float(np.abs(d.v).max()))
    ulp = 3e-8 if real is wp.float32 else 6e-17                             # rounding of 0.3 m, each substep at most
    np.testing.assert_allclose(d.x, before, atol=20 * ulp)
    assert fastest < 4 * ulp * 600                                          # of a rounding a substep of 1/600 s


def test_an_apex_of_a_cone_is_met():
    d = Driver([Collider("/cone", Cone(0.2, 0.3))], (0.0, 0.0, 0.5), v=(0, 0, -50.0), gravity=(0, 0, 0), reach=0.01)
    d.run(0.1)
    np.testing.assert_allclose(d.x[0], (0.0, 0.0, 0.31), atol=1e-6)


def test_a_fold_of_two_planes_holds_by_both():
    slopes = [tilted(np.radians(45)), Collider("/other", Plane(), Motion.still(np.diag([-1.0, -1, 1, 1])
                                                                              @ tilted(np.radians(45)).motion.at(0)))]
    d = Driver(slopes, (0.0, 0.0, 0.3), mu=(0, 0), iterations=20)
    for c in d.contacts.rows.colliders:
        assert c.static_friction == 0.5
    d.run(1.5)
    np.testing.assert_allclose(d.x[0], 0.0, atol=1e-4)


def test_the_floor_receives_the_weight_and_the_impact():
    mass = 0.25
    d = Driver([Collider("/floor", Plane())], (0, 0, 0), w=1 / mass).run(0.5)
    push = d.contacts.impulses(d.h)["/floor"]
    np.testing.assert_allclose(push, (0, 0, -mass * G * d.h), rtol=1e-5, atol=1e-12)


def test_a_mark_tells_from_when_on_a_point_touches():
    d = Driver([Collider("/floor", Plane())], (0, 0, 0.05), substeps=1)
    seen = []
    for _ in range(20):
        d.frame()
        seen.append(bool(d.contacts.mark.numpy()[0] & TOUCHED))
    steps = np.arange(1, 21)                                    # backward Euler falls g h^2 n (n + 1) / 2
    np.testing.assert_array_equal(seen, G * d.h**2 * steps * (steps + 1) / 2 > 0.05)


@pytest.mark.parametrize("height", [0.05, 0.0503, 0.0507, 0.051])        # the impact at several places of a substep
def test_bdf2_does_not_bounce(height):
    d = Driver([Collider("/floor", Plane())], (0, 0, height), bdf2=True)
    highest = 0.0
    for _ in range(30):
        d.frame()
        if d.x[0, 2] < 1e-6:
            highest = max(highest, float(d.v[0, 2]))
    assert d.x[0, 2] == pytest.approx(0.0, abs=1e-7) and highest < 1e-6


def test_bdf2_slides_with_second_order():
    """What is left is of h^2: backward Euler stops 0.4 % off (h v / 2), and is h g_t t / 2 ahead on the slope."""
    d = Driver([Collider("/floor", Plane())], (0, 0, 0), v=(2.0, 0, 0), bdf2=True).run(1.0)
    assert d.x[0, 0] == pytest.approx(2.0**2 / (2 * 0.5 * G), rel=1e-4)
    angle = np.radians(35.0)
    d = Driver([tilted(angle)], (0, 0, 0), mu=(0.1, 0.1), bdf2=True, real=wp.float64).run(0.5)
    length = 0.5 * G * (np.sin(angle) - 0.3 * np.cos(angle)) * 0.5**2
    assert np.linalg.norm(d.x[0]) == pytest.approx(length, rel=1e-4)


def test_too_many_contacts_set_the_status_and_fit_after_growing():
    walls = [Collider(f"/wall{i}", Sphere(0.3), Motion.at_place(0.3 * np.array([np.cos(a), np.sin(a), 0.0])))
             for i, a in enumerate(np.linspace(0, 2 * np.pi, 5, endpoint=False))]
    d = Driver(walls, (0, 0, 0))
    d.frame()
    assert d.contacts.wanted.numpy()[0] == 5
    assert d.contacts.grow() and not d.contacts.grow()
    d.frame()
    assert d.contacts.wanted.numpy()[0] == 0
    assert d.contacts.slots.count.numpy()[0] == 5
    assert (d.contacts.slots.row.numpy() == np.arange(5)).all()              # in the order of the colliders


def test_a_repeated_frame_gives_the_same_bits():
    rng = np.random.default_rng(2)
    colliders = [Collider("/floor", Plane()), Collider("/ball", Sphere(0.3), moving((0, 0.3, 0))),
                 Collider("/slab", slab("solid", 0.1, 0.2), Motion.at_place((0.2, 0.2, 0.2)))]
    x = rng.uniform(-0.5, 0.5, (300, 3)) + (0, 0, 0.5)
    runs = [Driver(colliders, x, v=(0.1, 0, -3.0)).run(0.3) for _ in range(2)]
    assert runs[0].x.tobytes() == runs[1].x.tobytes()
    d = runs[0]
    kept, v, time = [a.copy() for a in (d.x, d.e, d.d, d.a)], d.v.copy(), d.time
    d.frame()
    once = d.x.copy()
    for array, values in zip((d.x, d.e, d.d, d.a), kept, strict=True):
        array[:] = values
    d.v[:], d.time = v, time
    d.frame()
    assert once.tobytes() == d.x.tobytes()


def test_far_from_the_origin_nothing_is_lost():
    def make(origin, real):
        ball = Collider("/ball", Sphere(0.3), Motion.at_place(np.array(origin) + (0.0, 0.0, 0.3)))
        return Driver([ball], [[0.1, 0.05, 0.7]], origin=origin, real=real).run(0.5)
    near, far = make((0, 0, 0), wp.float32), make((1000.0, -2000.0, 500.0), wp.float32)
    np.testing.assert_allclose(far.x, near.x, atol=2e-6)


def test_a_deforming_mesh_carries_and_stops_points():
    """A floor that rises at 10 m/s by its points, and one that flows sideways under a point."""
    points, counts, indices = shapes.sheet(1.0, 1.0, 8, 8)[:3]
    points = np.asarray(points, np.float32) - np.asarray(points, np.float32).mean(axis=0)
    up = int(np.argmin(np.ptp(points, axis=0)))
    lift = np.zeros(3, np.float32)
    lift[up] = 1.0
    for velocity in (10.0 * lift, np.roll(lift, 1) * 0.5):
        poses = Curve(np.array([0.0, 0.2]), np.stack([points, points + np.float32(0.2) * velocity]))
        floor = Collider("/floor", Surface(points, counts, indices, poses))
        start = 0.02 * lift + 0.013 * (1 - lift)
        d = Driver([floor], start, reach=1e-3, gravity=-G * lift).run(0.15)
        assert d.x[0, up] > 0.15 * velocity[up]
        np.testing.assert_allclose(d.v[0], velocity, atol=2e-3)


def test_pinned_points_are_left_alone():
    d = Driver([Collider("/floor", Plane())], [[0, 0, -0.1], [0, 0, -0.1]], w=np.array([0.0, 1.0])).run(1 / 60)
    assert d.x[0, 2] == np.float32(-0.1) and d.x[1, 2] > -0.1
    assert d.contacts.slots.count.numpy().tolist() == [0, 1]


def test_indicators_tell_how_deep_points_are():
    d = Driver([Collider("/box", Box((0.5, 0.5, 0.5))), Collider("/mesh", slab("solid", 1.0), thickness=0.01)],
               [[0, 0, 0.45], [0, 0, 3.0]], reach=0.02)
    d.contacts.prepare(0.0)
    found = d.contacts.indicators(d.device["x"])
    assert found["penetration"] == pytest.approx(0.05, abs=1e-6)
    assert found["too_near"] == pytest.approx(0.05 + 0.03, abs=1e-6)
    assert found["contacts"] == 0


def test_only_the_shapes_of_the_scene_are_compiled():
    d = Driver([Collider("/floor", Plane()), Collider("/ball", Sphere(1.0))], (0, 0, 1.0))
    d.frame()
    assert d.contacts.kinds == ("plane", "sphere")
    module = d.contacts.search_kernel.module.name
    sources = [p.read_text() for p in Path(wp.config.kernel_cache_dir).glob(f"wp_{module}*/*.cpp")]
    assert any("sphere_" in text for text in sources)
    assert not any(word in text for text in sources for word in ("box_", "capsule_", "cone_", "mesh_query"))


def test_a_graph_of_a_frame_gives_the_bits_of_its_launches():
    def make():
        return Driver([Collider("/ball", Sphere(0.3), moving((0, 0, 1.0)))], [[0.0, 0.1, 0.33]], v=(0, 0, -1.0))
    plain, graph = make(), make()
    plain.contacts.prepare(0.0)
    graph.contacts.prepare(0.0)
    for d in (plain, graph):
        d.d[:] = d.h * d.v

    def work(d):
        d.contacts.search(0, *(d.device[name] for name in "xda"))
        d.contacts.project(d.h, d.device["d"], d.device["a"])
    work(plain)
    with wp.ScopedCapture(device="cpu") as capture:
        work(graph)
    graph.d[:] = graph.h * graph.v
    wp.capture_launch(capture.graph)
    assert plain.d.tobytes() == graph.d.tobytes()


@pytest.mark.parametrize("collider, words", [
    (Collider("/a", Sphere(-1.0)), "/a.*sizes.*positive"),
    (Collider("/a", Box((1.0, 0.0, 1.0))), "/a.*sizes.*positive"),
    (Collider("/a", Sphere(1.0), static_friction=-0.1), "/a.*static_friction is -0.1"),
    (Collider("/a", Sphere(1.0), thickness=np.nan), "/a.*thickness is nan"),
    (Collider("/a", Sphere(1.0), Motion.still(np.diag([2.0, 1, 1, 1]))), "/a.*not rigid"),
    (Collider("/a", Surface(np.zeros((3, 3)), [3], [0, 1, 2])), "/a.*no triangle with an area"),
    (Collider("/a", Surface(np.eye(3), [3], [0, 1, 3])), "/a.*names a point outside"),
    (Collider("/a", Surface(np.full((3, 3), np.nan), [3], [0, 1, 2])), "/a.*finite"),
])
def test_a_collider_that_makes_no_sense_is_named(collider, words):
    with pytest.raises(SceneError, match=words):
        Driver([collider], (0, 0, 1))


def test_quaternions_turn_as_their_matrices():
    rng = np.random.default_rng(6)
    for angle in (0.0, 1e-9, 0.7, np.pi - 1e-9, np.pi, 4.0):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        q = matrix_quat(axis_rotation_matrix(axis, angle))
        half = 0.5 * angle if angle <= np.pi else 0.5 * angle - np.pi
        expected = np.array([*(axis * np.sin(half)), np.cos(half)])
        assert min(np.abs(q - expected).max(), np.abs(q + expected).max()) < 1e-15
