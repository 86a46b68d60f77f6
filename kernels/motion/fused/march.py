"""Kernels of whole frames of explicit steps of sheets and solids in one launch, by a cluster or a grid of blocks (CUDA): what a
block does is kernels/motion/fused/sheet.py, how a point moves own.py."""

from functools import cache

import warp as wp

from wsim.kernels.cloth.spring import spring_nets
from wsim.kernels.contact.project import contact_tables, slot_type
from wsim.kernels.math.real import types
from wsim.kernels.motion.explicit import explicit_steps
from wsim.kernels.motion.fused.contact import Acts, contact_action_function, settling_function, written_frames
from wsim.kernels.motion.fused.contact_lanes import lane_contact_function as meeting
from wsim.kernels.motion.fused.contact_lanes import look_function
from wsim.kernels.motion.fused.domain_decomposition import sheet_patch_table
from wsim.kernels.motion.fused.hold import point_holdings
from wsim.kernels.motion.fused.limits import limit_sweep_functions
from wsim.kernels.motion.fused.own import frame_end_function, load_bearing_function, own_point_functions, thread_points
from wsim.kernels.motion.fused.sheet import sheet_pass_functions


@cache
def frame_march_kernel(real, module, plan, damped: bool, bounded: bool = False):
    """Kernel, launched over plan.size blocks of plan.threads (`wsim.physics.motion.fused.domain_decomposition.BlockPlan`): as
    kernels/motion/fast_paths/cluster.py has it. bounded: frames are watched."""
    Net, Sheets, Step = spring_nets(real), sheet_patch_table(real, plan.materials), explicit_steps(real)
    Own, vectors = thread_points(real), wp.array(dtype=types(real).vec3)
    enter, forces, send, leave = sheet_pass_functions(real, plan, damped, bounded)
    (kicked, moved), finish, bear = own_point_functions(real), frame_end_function(real), load_bearing_function(real)

    def march_frame(c: Net, h: Sheets, x: vectors, step: Step, x_out: vectors, e_out: vectors, v_out: vectors, r_out: vectors):
        room = wp.tile_empty(shape=wp.static(plan.words), dtype=float, storage="shared")      # `sheet_room`   # noqa: F841
        own = Own()
        enter(c, h, step, x, e_out, v_out, r_out, own)
        for sub in range(step.count + wp.where(step.close > real(0.0), 1, 0)):
            kick = wp.where(sub == 0, step.kick, step.later)
            if sub == step.count:
                kick = step.close
            if wp.static(plan.loaded):
                bear(h.borne, own, 2 * sub)
            forces(own, kick, sub)
            if sub < step.count:
                moved(own, kick, step, sub)
                send(c, h, step, own, sub)
            else:
                kicked(own, kick)
        leave()
        if wp.static(bounded):
            if own.room < real(-1.5):
                wp.atomic_max(h.met, 0, 1)
        if own.point >= 0 and own.lane == 0:
            finish(own, own.v, x_out, e_out, v_out, r_out)

    return wp.kernel(march_frame, name="frame_sheets" + "_bounded" * bounded, module=module, enable_backward=False,
                     grid_stride=False, launch_bounds=(plan.threads, 1), cluster_dim=1 if plan.grid else plan.size)


@cache
def acted_frame_kernel(real, module, plan, damped: bool, acts: Acts):
    """Kernel of frames in which others act on points, as `frame_march_kernel`: leapfrog that goes on from half a step before,
    see kernels/motion/fused/contact.py."""
    Net, Sheets, Step = spring_nets(real), sheet_patch_table(real, plan.materials), explicit_steps(real)
    Own, Written = thread_points(real), written_frames(real)
    (Rows, Points), Slots, Held = contact_tables(real), slot_type(real), point_holdings(real)
    enter, forces, send, leave = sheet_pass_functions(real, plan, damped, acts=True)
    (_, moved), finish, settle, look, bear = (own_point_functions(real), frame_end_function(real), settling_function(real),
                                              look_function(real), load_bearing_function(real))
    act, meet = contact_action_function(acts, real), meeting(acts.kinds, real, acts.lanes) if acts.lanes else None
    fill = limit_sweep_functions(real, acts.limits, acts.damped)[0] if acts.limits else None

    def march_acted_frame(c: Net, h: Sheets, step: Step, s: Written, rows: Rows, points: Points, at: Slots, hold: Held):
        room = wp.tile_empty(shape=wp.static(plan.words), dtype=float, storage="shared")      # `sheet_room`   # noqa: F841
        own = Own()
        if wp.static(acts.limits is not None):
            fill(c, h, hold.limits)
        enter(c, h, step, s.x, s.e, s.v, s.r, own)
        if own.point >= 0 and own.w > real(0.0) and s.halved == 0:
            own.v = s.half[own.point]
        first = own.point >= 0 and own.lane == 0
        if wp.static(acts.lanes > 0):
            seen = look(rows, points, own)
        for sub in range(step.count + 1):
            kick = wp.where(sub == 0, step.kick, step.later)
            if sub == step.count:
                kick = step.close
            if wp.static(plan.loaded):
                bear(h.borne, own, 2 * sub)
            forces(own, kick, sub)
            if sub < step.count:
                before = own.d
                moved(own, kick, step, sub)
                if wp.static(acts.lanes > 0):
                    meet(rows, at, s, own, seen, before, wp.vec2i(sub, wp.where(sub == step.count - 1, 1, 0)))
                elif first or wp.static(acts.together):
                    act(rows, points, at, hold, s, own, before, sub)
                send(c, h, step, own, sub)
        leave()
        if first:
            s.half[own.point] = own.v
            v = own.v
            if own.w > real(0.0):
                v = settle(own, own.v + (step.close * own.a + own.r))
            finish(own, v, s.x, s.e, s.v, s.r)

    also = {"pins": acts.pinned, "tethers": acts.tethered, "limits": acts.limits is not None, "lanes": acts.lanes > 0,
            "faces": acts.shared > 0}
    name = "_".join(("acted_sheets", *acts.kinds, *(what for what, there in also.items() if there)))
    return wp.kernel(march_acted_frame, name=name, module=module, enable_backward=False, grid_stride=False,
                     launch_bounds=(plan.threads, 1), cluster_dim=1 if plan.grid else plan.size)
