"""Passes of bodies that joints and contacts move: in each sweep the islands of joints, a thread each, then the contacts.

The bodies of an island of joints sleep together (kernels/rigid/graph/sleep.py); one that sleeps has no passes.
"""

import warp as wp

from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.steps import joint_step_functions
from wsim.kernels.rigid.kinds import first_of_thread
from wsim.kernels.rigid.lists.worlds import body_straying_func, straying_reset_func
from wsim.kernels.rigid.motion import double_vec3, kick_momentum
from wsim.kernels.rigid.passes import constraint_walks, over_bodies
from wsim.kernels.rigid.soft_step import body_steps

MODULES = "joint_places", "joint_impulses", "joint_relaxation"       # names of the modules that `joint_pass_kernels` asks for


def linked_body_passes(real):
    """(begun, placed, ended) as `over_bodies`; bodies of joints are placed by what joints expect."""
    Rig, (_, _, forces, place), (_, placed, _) = rig_type(real), body_steps(real), over_bodies(real)
    linked, stray, clear = joint_step_functions(real).place, body_straying_func(real), straying_reset_func(real)

    @wp.func(inline=False)
    def begin_linked_bodies(i: int, threads: int, h: real, rig: Rig, J: Linked):
        half = real(0.5) * h
        clear(i, threads, rig)
        for b in range(first_of_thread(i, threads), rig.b.w.shape[0], threads):
            p = rig.now.p[b]
            L = rig.now.L[b]
            J.p[b] = double_vec3(p)
            J.L[b] = double_vec3(L)
            forces(b, h, rig)
            J.dp[b] = double_vec3(kick_momentum(p, rig.b.push[b], rig.b.drag[b], half)) - double_vec3(rig.now.p[b])
            J.dL[b] = double_vec3(kick_momentum(L, rig.b.torque[b], rig.b.spin_drag[b], half)) - double_vec3(rig.now.L[b])

    @wp.func(inline=False)
    def end_linked_bodies(i: int, threads: int, k: int, h: real, rig: Rig, J: Linked):
        for b in range(first_of_thread(i, threads), rig.b.w.shape[0], threads):
            if J.t.linked[b] == 0:
                place(b, h, rig)
            elif rig.work.asleep[b] == 0:
                linked(b, h, rig.b, rig.now, J)
            stray(b, h, rig)
        placed(i, threads, k + 1, rig)

    return begin_linked_bodies, placed, end_linked_bodies


def joint_island_passes(real):
    """(placed, begun, solve, relax): functions of all islands, by thread i of so many."""
    Rig, f = rig_type(real), joint_step_functions(real)
    placed_one, begun_one, solve_one, relax_one = f.placed, f.begun, f.solve, f.relax

    @wp.func
    def island_is_active(g: int, rig: Rig, J: Linked):
        """Whether island g has joints, and is awake."""
        return J.t.first_joint[g + 1] > J.t.first_joint[g] and rig.work.asleep[J.t.body[J.t.first_body[g]]] == 0

    @wp.func(inline=False)
    def place_joint_islands(i: int, threads: int, k: int, rig: Rig, J: Linked):
        for g in range(i, J.t.first_joint.shape[0] - 1, threads):
            if rig.work.asleep[J.t.body[J.t.first_body[g]]] == 0:
                placed_one(g, k, rig.b, rig.now, J)

    @wp.func(inline=False)
    def begin_joint_islands(i: int, threads: int, k: int, h: real, J: Linked):
        for g in range(i, J.t.first_joint.shape[0] - 1, threads):
            begun_one(g, k, wp.float64(h), J)

    @wp.func(inline=False)
    def solve_joint_islands(i: int, threads: int, k: int, h: real, rig: Rig, J: Linked):
        for g in range(i, J.t.first_joint.shape[0] - 1, threads):
            if island_is_active(g, rig, J):
                solve_one(g, k, wp.float64(h), rig.b, rig.now, J)

    @wp.func(inline=False)
    def relax_joint_islands(i: int, threads: int, k: int, h: real, rig: Rig, J: Linked):
        for g in range(i, J.t.first_joint.shape[0] - 1, threads):
            if island_is_active(g, rig, J):
                relax_one(g, k, wp.float64(h), rig.now, J)

    return place_joint_islands, begin_joint_islands, solve_joint_islands, relax_joint_islands


def joint_pass_kernels(real, places: str, joins: str, looses: str) -> dict:
    """Kernels of the same passes, each a launch: placed, begun and ended of bodies, and those of islands, a thread each.

    places, joins, looses: modules of MODULES, compiled side by side; the second and third solve for impulses."""
    Rig, (_, place, _) = rig_type(real), over_bodies(real)
    begin, _, end = linked_body_passes(real)
    line, clear, join, loose = joint_island_passes(real)

    def linked_placed(threads: int, k: int, rig: Rig):
        place(wp.tid(), threads, k, rig)

    def linked_begun(threads: int, h: real, rig: Rig, J: Linked):
        begin(wp.tid(), threads, h, rig, J)

    def linked_ended(threads: int, k: int, h: real, rig: Rig, J: Linked):
        end(wp.tid(), threads, k, h, rig, J)

    def linked_lined(k: int, rig: Rig, J: Linked):
        line(wp.tid(), J.t.first_joint.shape[0], k, rig, J)

    def linked_reset(k: int, h: real, rig: Rig, J: Linked):
        clear(wp.tid(), J.t.first_joint.shape[0], k, h, J)

    def linked_joined(k: int, h: real, rig: Rig, J: Linked):
        join(wp.tid(), J.t.first_joint.shape[0], k, h, rig, J)

    def linked_loosed(k: int, h: real, rig: Rig, J: Linked):
        loose(wp.tid(), J.t.first_joint.shape[0], k, h, rig, J)

    every = {places: (linked_placed, linked_begun, linked_ended, linked_lined, linked_reset),
             joins: (linked_joined,), looses: (linked_loosed,)}
    return {f.__name__.removeprefix("linked_"): wp.kernel(f, name=f.__name__, module=module, enable_backward=False)
            for module, fs in every.items() for f in fs}


def contact_passes(kinds, real, module, meet, threads: int = 0, cluster: int = 0):
    """Kernel of one pass over all contacts, by so many threads that `meet`: which is 0 prepare, 1 warm, 2 solve."""
    Rig, w = rig_type(real), constraint_walks(kinds, real, meet, False)
    prepare, warm, solve = w.prepare, w.warm, w.solve

    def rigid_contact_pass(which: int, threads: int, k: int, h: real, biased: int, rig: Rig):
        i = wp.tid()
        if which == 0:
            prepare(i, threads, k, h, biased, rig)
        elif which == 1:
            warm(i, threads, k, h, biased, rig)
        else:
            solve(i, threads, k, h, biased, rig)

    more = {"launch_bounds": threads} if threads else {}
    return wp.kernel(rigid_contact_pass, name="rigid_contact_pass", module=module, enable_backward=False, grid_stride=False,
                     **more, **({"cluster_dim": cluster} if cluster else {}))


def linked_substep_kernel(kinds, real, module, meet, threads: int = 0, cluster: int = 0, bouncing: bool = False):
    """Kernel as `wsim.kernels.rigid.passes.body_substep_kernel`, with islands of joints in front of the kinds. bouncing:
    impacts are in a kernel of their own, launched before each substep (`joint/impacts.py`: in one kernel they took minutes to
    compile for a GPU). At the start of a frame, a launch with steps = (0, 0, sweeps) prepares for it."""
    Rig, w = rig_type(real), constraint_walks(kinds, real, meet, False)
    begun, placed, ended = linked_body_passes(real)
    lined, reset, joined, loosed = joint_island_passes(real)
    prepare, warm, solve = w.prepare, w.warm, w.solve
    apart = wp.constant(int(bouncing))

    def rigid_linked(steps: wp.vec3i, h: real, threads: int, rig: Rig, J: Linked):
        i = wp.tid()
        first = steps[0] - 1
        if apart == 1 and steps[1] > 0:
            first = steps[0]
        if first < 0:
            placed(i, threads, 0, rig)
        meet()
        n = steps[2]
        for k in range(first, steps[1]):                     # each pass at one place, see kernels/rigid/passes.py
            if k >= steps[0]:
                begun(i, threads, h, rig, J)
                reset(i, threads, k, h, J)
                meet()
                warm(i, threads, k, h, 1, rig)
            for turn in range(n + 3):                        # joints, n times contacts and joints; twice without bias
                biased = int(1)
                if turn > n:
                    biased = 0
                if turn == n + 1:
                    if k >= steps[0]:
                        ended(i, threads, k, h, rig, J)
                        meet()
                    if k >= steps[0] or k < 0:
                        lined(i, threads, k + 1, rig, J)
                        prepare(i, threads, k + 1, h, biased, rig)
                    meet()
                if k >= steps[0]:
                    if turn != 0 and turn != n + 1:
                        solve(i, threads, k, h, biased, rig)
                        meet()
                    if biased == 1:
                        joined(i, threads, k, h, rig, J)
                    else:
                        loosed(i, threads, k, h, rig, J)
                    meet()

    more = {"launch_bounds": threads} if threads else {}
    return wp.kernel(rigid_linked, name="rigid_linked", module=module, enable_backward=False, grid_stride=False,
                     **more, **({"cluster_dim": cluster} if cluster else {}))
