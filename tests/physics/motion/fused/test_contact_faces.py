"""Contacts of points whose threads share the faces of a list of candidates, here of one thread: as kernels/contact/search.py.
Of more threads: tests/gpu/solver/test_sheet_contacts.py."""

import numpy as np
import pytest
import warp as wp

import wsim
from tests.make.physics.contact.candidate_lists import blob, surface
from tests.make.physics.contact.candidate_lists import sheet as open_sheet
from tests.make.physics.motion.fused.contact_lanes import TURN
from tests.make.physics.motion.fused.kernel_fusion import moved
from wsim.kernels.contact.project import contact_tables, slot_type
from wsim.kernels.math.real import types
from wsim.kernels.motion.fused import contact
from wsim.kernels.motion.fused.hold import point_holdings
from wsim.kernels.motion.fused.own import thread_points
from wsim.model.structs import fill_struct
from wsim.scene import Motion, Scene, Sphere, shapes

SUBSTEPS = 80
SHAPES = {"closed": blob, "open": open_sheet}


def scene(name: str) -> Scene:
    """Points about a mesh that turns and moves, and a ball."""
    made = Scene(solver="explicit", substeps=SUBSTEPS)
    points, counts, indices = shapes.sheet(0.4, 0.4, 19, 19, horizontal=True)
    made.cloth("/cloth", points + [0.0, 0.4, 0.0], counts, indices)
    made.collider("/mesh", surface(*SHAPES[name](np.random.default_rng(0))), static_friction=0.4, dynamic_friction=0.3,
                  motion=Motion([0.0, 0.1], [moved(0.0, 0.0, 0.0), TURN @ moved(0.0, 0.1, 0.0)]))
    made.collider("/ball", Sphere(0.1), at=(0.3, 0.0, 0.0))
    return made


def frames(kinds, real, shared: int):
    """Kernel over points: a frame of substeps in which points fall freely but for contacts."""
    t, Own, Slots, Held, Written = (types(real), thread_points(real), slot_type(real), point_holdings(real),
                                    contact.written_frames(real))
    (Rows, Points), vectors = contact_tables(real), wp.array(dtype=types(real).vec3)
    act = contact.contact_action_function(contact.Acts(kinds, listed=True, shared=shared), real)

    @wp.kernel(module="unique", enable_backward=False)
    def frame(rows: Rows, points: Points, s: Slots, hold: Held, out: Written, v: vectors, d_out: vectors, v_out: vectors):
        own = Own()
        own.point = wp.tid()
        own.w = points.w[own.point]
        own.x = out.x[own.point]
        own.v = v[own.point]
        for k in range(SUBSTEPS):
            before = own.d
            own.v = own.v + hold.h * t.vec3(real(0.0), real(-9.81), real(0.0))
            own.d = own.d + hold.h * own.v
            act(rows, points, s, hold, out, own, before, k)
        d_out[own.point] = own.d
        v_out[own.point] = own.v

    return frame


@pytest.mark.parametrize("room", [None, 2], ids=["lists", "lists without room"])
@pytest.mark.parametrize("name", SHAPES)
def test_threads_that_share_faces_find_the_contacts_of_one_that_tries_all(name, room):
    sim = wsim.Simulation(scene(name), device="cpu", precision="float64")
    sim.step()
    c, random = sim.plan.ports.contacts, np.random.default_rng(0)
    assert c.points.every > 0
    c.points.room = room or c.points.room
    n = sim.state.x.shape[0]
    x = random.uniform(-0.5, 0.5, (n, 3))                                       # some begin within
    v = random.normal(size=(n, 3)) - 25.0 * x
    found = []
    for shared in (0, 1):
        with wp.ScopedDevice("cpu"):
            out = fill_struct(contact.written_frames(wp.float64), x=wp.array(x, dtype=wp.vec3d), push=c.push, iterations=2)
            hold, d, rate = (fill_struct(point_holdings(wp.float64), h=c.table.h), wp.zeros(n, dtype=wp.vec3d),
                             wp.zeros(n, dtype=wp.vec3d))
            c.slots.mark.zero_()
            wp.launch(frames(c.kinds, wp.float64, shared), n,
                      [c.table, c.points, c.slots, hold, out, wp.array(v, dtype=wp.vec3d), d, rate])
        found.append((d.numpy(), rate.numpy(), c.slots.mark.numpy(), c.slots.count.numpy(), c.push.numpy()))
    h = c.table.h
    fallen = SUBSTEPS * h * v + h * h * SUBSTEPS * (SUBSTEPS + 1) / 2 * np.array([0.0, -9.81, 0.0])
    assert (np.abs(found[0][0] - fallen).max(axis=1) > 1e-6).mean() > 0.05
    assert all(np.array_equal(*both) for both in zip(*found, strict=True))
