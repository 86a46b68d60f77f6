"""Impacts of bodies that joints hold: each sweep over the contacts of a blow is followed by one over the islands of joints.

A blow P at a body of a joint is borne by all that the joint moves. A hinged ball of mass m, moment I about its centre, at a
distance r from the hinge, leaves an elastic wall at the speed it came with. Where joints had the word behind the blow alone,
it left with (m r^2 - I) / (m r^2 + I) of it. Contacts and locks follow one another as in a sweep of Gauss-Seidel, until the
contacts change no more (kernels/rigid/impact.py); limits that are met give their impulse too, drives none.
"""

from functools import cache

import warp as wp

from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.impact import MET, ROUNDS, SWEEPS, flag_reading_func, impact_mark_functions
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.steps import joint_step_functions, relaxed_row
from wsim.kernels.rigid.kinds import ConstraintKind, at_once_func, by_colour
from wsim.kernels.rigid.motion import body_structs


@cache
def holding_rates(real):
    """(clear, hold): functions of an island g. hold takes away what a blow has given to the rates of rows that are held."""
    Moving, f = body_structs(real)[1], joint_step_functions(real)
    rate_of, given = f.rate_of, f.given

    @wp.func
    def clear_joint_impulses(g: int, J: Linked):
        six = int(6)
        for j in range(J.t.first_joint[g], J.t.first_joint[g + 1]):
            for r in range(six):
                J.hold[j, r] = wp.float64(0.0)
                J.push[j, r] = wp.float64(0.0)
                J.active[j, r] = -1

    @wp.func(inline=False)
    def hold_joint_rates(g: int, k: int, h: wp.float64, now: Moving, J: Linked):
        three = int(3)
        for j in range(J.t.first_joint[g], J.t.first_joint[g + 1]):
            u, omega = rate_of(j, k, wp.float64(0.0), now, J)
            u = J.axis[j] * u
            omega = J.turn[j] * omega
            for r in range(three):
                relaxed_row(j, r, 0, h, u[r], J)
                relaxed_row(j, 3 + r, 0, h, omega[r], J)
        given(g, 0, now, J)

    return clear_joint_impulses, hold_joint_rates


def linked_impacts(kind: ConstraintKind, meet, real):
    """Function as `wsim.kernels.rigid.impact.impact_func`, with the joints behind."""
    mark, strike = impact_mark_functions(real, MET)
    look, sweep = at_once_func(kind, mark, real), by_colour(kind, strike, meet, real)
    Rig, told, (clear, hold) = rig_type(real), flag_reading_func(meet, real), holding_rates(real)

    @wp.func
    def resolve_linked_impacts(i: int, threads: int, k: int, h: real, rig: Rig, J: Linked):
        islands = J.t.first_joint.shape[0] - 1
        for round in range(int(ROUNDS)):
            look(i, threads, k, h, 0, rig)
            if told(0, i, rig) == 0:
                break
            if round == 0:
                for g in range(i, islands, threads):
                    clear(g, J)
            for _sweep in range(int(SWEEPS)):
                sweep(i, threads, k, h, 0, rig)
                more = told(1, i, rig)
                for g in range(i, islands, threads):
                    if J.t.first_joint[g + 1] > J.t.first_joint[g] and rig.work.asleep[J.t.body[J.t.first_body[g]]] == 0:
                        hold(g, k, wp.float64(h), rig.now, J)
                meet()
                if more == 0:
                    break

    return resolve_linked_impacts


def linked_thrown(kinds, real, module, meet, threads: int, cluster: int):
    """Kernel of the impacts of a substep, of the last kind."""
    Rig, throw = rig_type(real), linked_impacts(kinds[-1], meet, real)

    def rigid_linked_thrown(threads: int, k: int, h: real, rig: Rig, J: Linked):
        throw(wp.tid(), threads, k, h, rig, J)

    return wp.kernel(rigid_linked_thrown, name="rigid_linked_thrown", module=module, enable_backward=False, grid_stride=False,
                     **({"launch_bounds": threads} if threads else {}), **({"cluster_dim": cluster} if cluster else {}))
