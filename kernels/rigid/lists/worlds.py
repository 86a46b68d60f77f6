"""Lists of manifolds of several worlds: when a body goes farther than the list of its world allows for, that world's list is
made anew, and rows of the others only move to other places. So no bit of a world depends on what another does.

    work.strayed      (1 + worlds,): 1 once a body of any world has strayed; of each world, whether its list is to be made anew

Rows of a world stand together, as those of its shapes do. A row that moves is copied whole from the list set aside, and
prepared again for the substep, which gives what it had: arms and gaps follow from the poses of now.
"""

from functools import cache

import warp as wp

from wsim.kernels.rigid.contact import rig_type, rigid_contact_structs
from wsim.kernels.rigid.impulse import impulse_formulas


@cache
def body_straying_func(real):
    """Function (i, h, rig): says whether body i, where it is, or is after another substep of h [s], is beyond its way."""
    Rig = rig_type(real)

    @wp.func
    def mark_strayed_body(i: int, h: real, rig: Rig):
        if rig.work.asleep[i] == 0 and rig.work.way.shape[0] > 0:
            q = rig.now.q[i]
            d = q - rig.work.from_q[i]
            if wp.dot(q, rig.work.from_q[i]) < real(0.0):
                d = q + rig.work.from_q[i]
            spin = wp.length(wp.cw_mul(rig.b.inverse[i], wp.quat_rotate_inv(q, rig.now.L[i])))
            goes = wp.length(rig.now.x[i] - rig.work.from_x[i]) + real(2.0) * wp.length(d) * rig.work.arm[i]
            goes += h * (rig.b.w[i] * (wp.length(rig.now.p[i]) + h * wp.length(rig.b.push[i])) + spin * rig.work.arm[i])
            if goes > rig.work.way[i]:
                worlds = rig.work.strayed.shape[0] - 1
                rig.work.strayed[0] = 1
                rig.work.strayed[1 + i * worlds // rig.b.w.shape[0]] = 1

    return mark_strayed_body


@cache
def straying_reset_func(real):
    """Function (i, threads, rig): no body has strayed, of all worlds by so many threads."""
    Rig = rig_type(real)

    @wp.func
    def clear_straying(i: int, threads: int, rig: Rig):
        for e in range(i, rig.work.strayed.shape[0], threads):
            rig.work.strayed[e] = 0

    return clear_straying


@cache
def listed_anew_func(real):
    """Function (shape of a body, rig): whether the list of its world is made anew."""
    Rig = rig_type(real)

    @wp.func
    def world_is_listed_anew(shape: int, rig: Rig):
        return rig.work.strayed[1 + rig.s.world[shape]] == 1

    return world_is_listed_anew


@cache
def kept_pairs_func(real):
    """Function (i, at, write, taken, aside, first_before, rig): the rows that shape i had, at their new place; their number."""
    Rig, Table = rig_type(real), rigid_contact_structs(real)[2]

    @wp.func
    def keep_pair_rows(i: int, at: int, write: int, taken: int, aside: Table, first_before: wp.array(dtype=int), rig: Rig):
        before = first_before[i] - taken
        if write == 1:
            for e in range(taken):
                if at + e < rig.c.a.shape[0] and before + e < rig.c.a.shape[0]:
                    rig.c.a[at + e] = aside.a[before + e]
                    rig.c.b[at + e] = aside.b[before + e]
        return taken

    return keep_pair_rows


@cache
def row_copy_func(real):
    """Function (from, of, m, out): row m of one table of manifolds becomes row `from` of another, whole."""
    Table = rigid_contact_structs(real)[2]

    @wp.func(inline=False)
    def copy_manifold_row(row: int, of: Table, m: int, out: Table):
        out.count[m] = of.count[row]
        out.colour[m] = of.colour[row]
        out.n[m] = of.n[row]
        out.skin[m] = of.skin[row]
        out.from_a[m] = of.from_a[row]
        out.from_b[m] = of.from_b[row]
        out.turn_a[m] = of.turn_a[row]
        out.turn_b[m] = of.turn_b[row]
        points = int(4)
        for i in range(points):
            j = 4 * m + i
            e = 4 * row + i
            out.key[j] = of.key[e]
            out.core_a[j] = of.core_a[e]
            out.core_b[j] = of.core_b[e]
            out.rim[j] = of.rim[e]
            out.first_a[j] = of.first_a[e]
            out.first_b[j] = of.first_b[e]
            out.gap[j] = of.gap[e]
            out.push[j] = of.push[e]
            out.rub[j] = of.rub[e]
            out.drift[j] = of.drift[e]

    return copy_manifold_row


@cache
def row_move_func(real):
    """Function (m, from, aside, k, rig): row m is what row `from` was, of a world whose list stays."""
    Rig, Table = rig_type(real), rigid_contact_structs(real)[2]
    copy, prepare = row_copy_func(real), impulse_formulas(real)[1]

    @wp.func(inline=False)
    def move_manifold_row(m: int, row: int, aside: Table, k: int, rig: Rig):
        copy(row, aside, m, rig.c)
        if rig.c.count[m] > 0:
            prepare(m, k, rig)

    return move_manifold_row


def set_aside_kernel(real, module):
    """Kernel over the rows of a list, which are copied whole to another table."""
    Table, copy = rigid_contact_structs(real)[2], row_copy_func(real)

    def rigid_set_aside(c: Table, aside: Table):
        m = wp.tid()
        aside.a[m] = c.a[m]
        aside.b[m] = c.b[m]
        copy(m, c, m, aside)

    return wp.kernel(rigid_set_aside, name="rigid_set_aside", module=module, enable_backward=False)
