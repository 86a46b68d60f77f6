"""Points of mesh colliders among those of surfaces: inverse mass 0, and a path that nothing changes.

A point q of a collider in its own frame, at substep k of a frame, stands at p_k = fl(M_k q_k - base), worked out in float64 and
rounded once, so that the end of a substep is the start of the next one. It goes along a straight line between:

    x = p_k,   e = 0,   d = p_{k+1} - p_k,   a = (1 - g / h) d

with a the anchor that makes (d - a) / g the velocity d / h of the collider, g the integrator's effective step.

Motion, friction and thickness are those of the collider's row in the table (`wsim.physics.contact.contacts`). Its pose is not:
the table has it in the precision of the run, a translation and a quaternion each rounded, and a place made of these is several
roundings of the collider's size off. The proof is of where the collider is, and its margin is three roundings of a place.

Cuts about colliders: motions of free points are shortened towards one rigid motion (kernels/contact/selfcontact/step_clamp.py).
A collider is never cut, so that where one takes part it is the motion of its points that all are cut towards: the least squares
fit of what those of pairs without a proof do, exact for a rigid collider, 0 for one at rest.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.selfcontact import pairs, step_clamp
from wsim.kernels.contact.selfcontact.motion_bounds import frame_type
from wsim.kernels.math.real import substep_number, types
from wsim.kernels.motion.points import point_states


@cache
def obstacle_place_kernel(real, module):
    """Kernel: x, d, a of the points of one collider in substep k, in arrays of their own. own: numbers of the points of its
    mesh, (m,); M: its frames at the ends of substeps; track: its points at these, (substeps + 1, n), or always, (1, n); now: as
    `substep_number` has it; part: 1 - g / h."""
    t, State = types(real), point_states(real)

    @wp.func
    def obstacle_point_at(M: wp.array(dtype=wp.mat44d), track: wp.array2d(dtype=wp.vec3f), k: int, j: int):
        q = track[wp.min(k, track.shape[0] - 1), j]
        p = wp.transform_point(M[k], wp.vec3d(wp.float64(q[0]), wp.float64(q[1]), wp.float64(q[2])))
        return t.vec3(real(p[0]), real(p[1]), real(p[2]))

    @wp.kernel(module=module, enable_backward=False)
    def place_obstacle_points(own: wp.array(dtype=int), M: wp.array(dtype=wp.mat44d), track: wp.array2d(dtype=wp.vec3f), k: int,
                              now: wp.array(dtype=int), part: real, to: State):
        i = wp.tid()
        j = own[i]
        row = substep_number(k, now)
        begin = obstacle_point_at(M, track, row, j)
        way = obstacle_point_at(M, track, row + 1, j) - begin
        to.x[i] = begin
        to.d[i] = way
        to.a[i] = part * way

    return place_obstacle_points


@cache
def obstacle_weight_kernel(real, module):
    """Kernel: 1 for the points of colliders whose pairs lack a proof, else 0."""
    Sums = pairs.sum_type(real)

    @wp.kernel(module=module, enable_backward=False)
    def weigh_points(point: wp.array(dtype=int), words: wp.array(dtype=int), to: Sums, w: wp.array(dtype=real)):
        i = point[wp.tid()]
        w[i] = wp.where(to.cut[i] == words[pairs.EPOCH], real(1.0), real(0.0))

    return weigh_points


@cache
def cut_frame_kernel(real, module):
    """Kernel: the rigid motion that cuts are towards: that of colliders where they take part, which rigid[3] says, else that
    of all. a: sums of `tubes.tally` over points of colliders."""
    vec3, Frames = types(real).vec3, frame_type(real)

    @wp.kernel(module=module, enable_backward=False)
    def pick_motion(a: wp.array2d(dtype=real), solid: Frames, common: Frames, out: Frames):
        led = a[0, 0] > real(0.0)
        for k in range(3):
            if led:
                out.rigid[k] = solid.rigid[k]
            else:
                out.rigid[k] = common.rigid[k]
        out.rigid[3] = vec3(wp.where(led, real(1.0), real(0.0)), real(0.0), real(0.0))

    return pick_motion


@cache
def infeasible_pair_kernel(real, module):
    """Kernel: counts the pairs of a collider that no cut has given a proof. first: place of the first point of a collider."""
    Surfaces, Pairs = pairs.surface_type(real), pairs.pair_type(real)

    @wp.kernel(module=module, enable_backward=False)
    def count_pinched(s: Surfaces, first: int, threads: int, near_at: wp.array(dtype=Pairs), words: wp.array(dtype=int),
                      said: wp.array(dtype=int)):
        near = near_at[0]
        i = wp.tid()
        if i == 0:
            words[pairs.PINCH] = 0
        while i < wp.min(near.count[0], near.capacity):
            ids = near.ids[i]
            free = wp.min(ids[0], ids[3])
            theirs = wp.max(ids[0], ids[3])
            if near.bad[i] == 1 and theirs >= first:
                wp.atomic_add(said, step_clamp.PINCHED, 1)
                wp.atomic_max(said, step_clamp.LATTER, -s.body[theirs])
                wp.atomic_max(said, step_clamp.FORMER, step_clamp.MOST + 1 + s.body[theirs])
                wp.atomic_max(said, step_clamp.WHERE, free + 1)
            i += threads

    return count_pinched


@cache
def free_state_copy_kernel(real, module):
    """Kernel: state of free points to the longer arrays that hold colliders' points as well."""
    State = point_states(real)

    @wp.kernel(module=module, enable_backward=False)
    def lend_points(at: State, to: State):
        i = wp.tid()
        to.x[i] = at.x[i]
        to.e[i] = at.e[i]
        to.d[i] = at.d[i]
        to.a[i] = at.a[i]

    return lend_points
