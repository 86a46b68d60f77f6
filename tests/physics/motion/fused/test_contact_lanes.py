"""Contacts of points whose threads try a collider each, here of one thread and one collider: as
kernels/motion/fused/contact.py."""

import numpy as np
import pytest
import warp as wp

import wsim
from tests.make.physics.motion.fused.contact_lanes import TURN
from tests.make.physics.motion.fused.kernel_fusion import moved
from wsim.kernels.contact.project import contact_tables, slot_type
from wsim.kernels.math.real import types
from wsim.kernels.motion.fused import contact, contact_lanes
from wsim.kernels.motion.fused.hold import point_holdings
from wsim.kernels.motion.fused.own import thread_points
from wsim.model.structs import fill_struct
from wsim.scene import Box, Capsule, Motion, Plane, Scene, Sphere, shapes

N, SUBSTEPS = 400, 40
SHAPES = {"plane": Plane(), "box": Box((0.3, 0.2, 0.3)), "sphere": Sphere(0.2), "capsule": Capsule(0.1, 0.4)}


def scene(shape, width: float) -> Scene:
    """Points about a collider that turns and moves."""
    made = Scene(solver="explicit", substeps=SUBSTEPS, contact_width=width)
    points, counts, indices = shapes.sheet(0.4, 0.4, 19, 19, horizontal=True)
    made.cloth("/cloth", points + [0.0, 0.25, 0.0], counts, indices)
    made.collider("/it", shape, static_friction=0.4, dynamic_friction=0.3,
                  motion=Motion([0.0, 0.1], [moved(0.0, 0.0, 0.0), TURN @ moved(0.0, 0.1, 0.0)]))
    return made


def frames(kinds, real, by_lanes: bool):
    """Kernel over points: a frame of substeps in which points fall freely but for contacts."""
    t, Own, Slots, Held, Written = (types(real), thread_points(real), slot_type(real), point_holdings(real),
                                    contact.written_frames(real))
    (Rows, Points), vectors = contact_tables(real), wp.array(dtype=types(real).vec3)
    act = contact.contact_action_function(contact.Acts(kinds), real)
    meet, look = contact_lanes.lane_contact_function(kinds, real, 1), contact_lanes.look_function(real)

    @wp.kernel(module="unique", enable_backward=False)
    def frame(rows: Rows, points: Points, s: Slots, hold: Held, out: Written, v: vectors, d_out: vectors, v_out: vectors):
        own = Own()
        own.point = wp.tid()
        own.w = points.w[own.point]
        own.x = out.x[own.point]
        own.v = v[own.point]
        seen = look(rows, points, own)
        for k in range(SUBSTEPS):
            before = own.d
            own.v = own.v + hold.h * t.vec3(real(0.0), real(-9.81), real(0.0))
            own.d = own.d + hold.h * own.v
            if wp.static(by_lanes):
                meet(rows, s, out, own, seen, before, wp.vec2i(k, wp.where(k == SUBSTEPS - 1, 1, 0)))
            else:
                act(rows, points, s, hold, out, own, before, k)
        d_out[own.point] = own.d
        v_out[own.point] = own.v

    return frame


@pytest.mark.parametrize("width", [0.0, 1e-3])
@pytest.mark.parametrize("name", SHAPES)
def test_threads_that_try_a_collider_each_find_the_contacts_of_one_that_tries_all(name, width):
    sim = wsim.Simulation(scene(SHAPES[name], width), device="cpu", precision="float64")
    sim.step()
    c, real, random = sim.plan.ports.contacts, wp.float64, np.random.default_rng(0)
    n = sim.state.x.shape[0]
    x = random.uniform(-0.35, 0.35, (n, 3))                                     # some begin within
    v = random.normal(size=(n, 3)) - 16.0 * x
    found = []
    for by_lanes in (False, True):
        out = fill_struct(contact.written_frames(real), x=wp.array(x, dtype=wp.vec3d), push=c.push, iterations=1)
        hold, d, rate = fill_struct(point_holdings(real), h=c.table.h), wp.zeros(n, dtype=wp.vec3d), wp.zeros(n, dtype=wp.vec3d)
        c.slots.mark.zero_()
        wp.launch(frames(c.kinds, real, by_lanes), n,
                  [c.table, c.points, c.slots, hold, out, wp.array(v, dtype=wp.vec3d), d, rate], device="cpu")
        found.append((d.numpy(), rate.numpy(), c.slots.mark.numpy(), c.slots.count.numpy(), c.push.numpy() + 0.0))
    (d, rate, mark, count, push), (d1, rate1, mark1, count1, push1) = found
    h = c.table.h
    fallen = SUBSTEPS * h * v + h * h * SUBSTEPS * (SUBSTEPS + 1) / 2 * np.array([0.0, -9.81, 0.0])
    met = np.abs(d - fallen).max(axis=1) > 1e-6
    assert met.mean() > 0.05 and np.abs(d - d1).max() < 1e-9 and np.abs(rate - rate1).max() < 1e-6
    assert np.array_equal(mark & 1, mark1 & 1) and (count1 <= count).all()
    assert np.abs(push[:n] - push1[:n])[(mark & 1) > 0].max(initial=0.0) < 1e-9
